"""Laws of the response surface table and of its file."""

from __future__ import annotations

from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsgen.errors import MeasurementError, RsgenError
from rsgen.finding import Finding, Quantity
from rsgen.report.wording import sentence
from rsgen.surface import OUTCOMES, ResponseSurface, load_surface, save_surface


def random_surface(seed: int, n: int, harmonics: int) -> ResponseSurface:
    """A surface of arbitrary values: the file format must not care what they mean."""
    random = np.random.default_rng(seed)

    def complex_normal(*shape: int) -> np.ndarray:
        return random.normal(size=shape) + 1j * random.normal(size=shape)

    return ResponseSurface(
        level=random.uniform(0, 10, n),
        frequency=random.uniform(1, 100, n),
        force=complex_normal(n),
        harmonics=complex_normal(n, harmonics + 1),
        peak=np.where(random.random((n, 1)) < 0.3, np.nan, random.normal(size=(n, 2))),
        sweep=random.choice(["rest", "up", "down"], n),
        outcome=random.integers(0, len(OUTCOMES), n),
        residual=random.exponential(size=n),
        error=np.full(n, np.nan),
        origin=str(random.choice(["simulated", "measured"])),
        phase_known=bool(random.random() < 0.5),
        findings=tuple(
            Finding("a-code", "info", "ζ", {"x": Quantity(random.random(), "N/m")}, {"of": "größer"})
            for _ in range(random.integers(0, 3))
        ),
    )


def assert_same(one: ResponseSurface, two: ResponseSurface) -> None:
    for column in fields(ResponseSurface):
        a, b = getattr(one, column.name), getattr(two, column.name)
        if column.name in ("origin", "phase_known", "control", "findings"):
            assert a == b
        else:
            assert a.dtype == b.dtype
            assert a.tobytes() == b.tobytes(), column.name


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), n=st.integers(1, 40), harmonics=st.integers(1, 9))
def test_saving_and_loading_is_the_identity(
    tmp_path_factory: pytest.TempPathFactory, seed: int, n: int, harmonics: int
):
    path = tmp_path_factory.mktemp("surface") / "surface.h5"
    surface = random_surface(seed, n, harmonics)
    save_surface(path, surface)
    assert_same(load_surface(path), surface)


def test_the_same_surface_gives_the_same_bytes(tmp_path):
    surface = random_surface(3, 20, 7)
    save_surface(tmp_path / "a.h5", surface)
    save_surface(tmp_path / "b.h5", surface)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "b.h5"]


def test_sentences_of_older_files_come_as_findings(tmp_path):
    save_surface(tmp_path / "s.h5", random_surface(1, 5, 3))
    with h5py.File(tmp_path / "s.h5", "a") as file:
        file.attrs["notes"] = ["the force was not recorded"]
        del file.attrs["findings"]
    (finding,) = load_surface(tmp_path / "s.h5").findings
    assert sentence(finding) == "the force was not recorded"


def test_every_array_of_the_file_carries_its_unit(tmp_path):
    save_surface(tmp_path / "s.h5", random_surface(1, 5, 3))
    with h5py.File(tmp_path / "s.h5") as file:
        units = {name: data.attrs["units"] for name, data in file.items()}
    assert units["force"] == "N"
    assert units["harmonics"] == units["peak"] == "m"
    assert units["frequency"] == "Hz"
    assert set(units) == {f.name for f in fields(ResponseSurface)} - {
        "origin",
        "phase_known",
        "control",
        "findings",
    } | {"settled"}


def test_amplitude_and_phase_follow_from_force_and_fundamental():
    # receptance of a damped oscillator below resonance lags by less than a right angle, above by more
    m, c, k = 2.0, 3.0, 5000.0
    frequency = np.array([2.0, 7.0, 7.9577, 12.0])
    omega = 2 * np.pi * frequency
    force = 3.0 * np.exp(1j * np.array([0.0, 1.0, -2.0, 3.0]))
    x1 = force / (k - m * omega**2 + 1j * c * omega)
    n = len(frequency)
    surface = ResponseSurface(
        np.full(n, 3.0), frequency, force, np.stack([0 * x1, x1], axis=1), np.full((n, 2), np.nan),
        np.full(n, "rest"), np.zeros(n), np.zeros(n), np.zeros(n), "measured",
    )  # fmt: skip
    expected = np.arctan2(c * omega, k - m * omega**2)
    np.testing.assert_allclose(surface.phase, expected, rtol=1e-12)
    np.testing.assert_allclose(surface.amplitude, np.abs(x1), rtol=1e-15)


def test_arrays_cannot_be_changed_and_do_not_alias_the_input():
    source = random_surface(5, 4, 2)
    level = np.ones(4)
    surface = replace(source, level=level)
    with pytest.raises(ValueError, match="read-only"):
        surface.level[0] = 2
    level[0] = 7
    assert surface.level[0] == 1


def test_selecting_keeps_rows_together():
    surface = random_surface(8, 30, 4)
    mask = surface.frequency > 50
    part = surface.select(mask)
    assert len(part) == mask.sum()
    np.testing.assert_array_equal(part.harmonics, surface.harmonics[mask])
    np.testing.assert_array_equal(part.force, surface.force[mask])
    assert (part.origin, part.phase_known) == (surface.origin, surface.phase_known)


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("frequency", [1.0, 2.0, -3.0], "positive"),
        ("frequency", [1.0, 2.0, np.inf], "finite"),
        ("force", [1.0, 2.0], "force"),
        ("harmonics", np.ones((3, 1)), "fundamental"),
        ("sweep", ["rest", "up", "left"], "sweep"),
        ("outcome", [0, 0, 99], "outcome"),
        ("origin", "invented", "origin"),
    ],
)
def test_a_wrong_column_is_named(column, value, said):
    with pytest.raises(RsgenError, match=said):
        replace(random_surface(2, 3, 2), **{column: value})


def test_a_file_that_is_no_surface_is_refused(tmp_path):
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(MeasurementError, match=r"text\.h5"):
        load_surface(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["level"] = [1.0]
    with pytest.raises(MeasurementError, match="not an rsgen response surface"):
        load_surface(tmp_path / "other.h5")


def test_links_out_of_the_file_are_refused(tmp_path):
    surface = random_surface(2, 3, 2)
    save_surface(tmp_path / "secret.h5", surface)
    save_surface(tmp_path / "s.h5", surface)
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        del file["force"]
        file["force"] = h5py.ExternalLink("secret.h5", "force")
    with pytest.raises(MeasurementError, match="force"):
        load_surface(tmp_path / "s.h5")


def test_a_failed_save_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "s.h5"
    save_surface(path, random_surface(1, 3, 2))
    before = path.read_bytes()

    def full_disk(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(RsgenError, match="no space"):
        save_surface(path, random_surface(2, 3, 2))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["s.h5"]
