"""Laws of the response surface table and of its file; copies of rows count once."""

import tracemalloc
from collections.abc import Callable
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rsgen as rs
from rsgen import load_surface, sentence
from rsgen.common.errors import MeasurementError, RsgenError
from rsgen.common.finding import Finding, Quantity
from rsgen.data.surface.response_surface import Outcome, ResponseSurface, save_surface, without_copies
from tests.attacks.traps_hdf5 import outside_ways
from tests.samples import cubic_surface
from tests.surfaces import noisy
from tests.virtual import fundamentals, only


def random_surface(seed: int, n: int, harmonics: int) -> ResponseSurface:
    """A surface of arbitrary values: the file format must not care what they mean."""
    random = np.random.default_rng(seed)

    def complex_normal(*shape: int) -> np.ndarray:
        return random.normal(size=shape) + 1j * random.normal(size=shape)

    return ResponseSurface(
        level=random.uniform(0, 10, n), frequency=random.uniform(1, 100, n),
        force=complex_normal(n, random.integers(2, 5)), harmonics=complex_normal(n, harmonics + 1),
        peak=np.where(random.random((n, 1)) < 0.3, np.nan, random.normal(size=(n, 2))),
        sweep=random.choice(["rest", "up", "down"], n), outcome=random.integers(0, len(Outcome), n),
        residual=random.exponential(size=n), error=np.full(n, np.nan),
        origin=str(random.choice(["simulated", "measured"])), phase_known=bool(random.random() < 0.5),
        across=complex_normal(n, harmonics + 1) if random.random() < 0.5 else None,
        label=random.integers(0, 4, n) if random.random() < 0.5 else None,
        per_mass=bool(random.random() < 0.5), base=str(random.choice(["", "velocity"])),
        findings=tuple(
            Finding("a-code", "info", "ζ", {"x": Quantity(random.random(), "N/m")}, {"of": "größer"})
            for _ in range(random.integers(0, 3))
        ),
        overlapping=bool(random.random() < 0.5),
    )  # fmt: skip


def assert_same(one: ResponseSurface, two: ResponseSurface) -> None:
    for column in fields(ResponseSurface):
        a, b = getattr(one, column.name), getattr(two, column.name)
        if not isinstance(a, np.ndarray):
            assert a == b
        else:
            assert a.dtype == b.dtype
            assert a.tobytes() == b.tobytes(), column.name


@pytest.mark.slow
@settings(max_examples=8)
@given(seed=st.integers(0, 2**31), n=st.integers(1, 40), harmonics=st.integers(1, 9))
@pytest.mark.usefixtures("read_here")
def test_saving_and_loading_is_the_identity(tmp_path_factory, seed, n, harmonics):
    path = tmp_path_factory.mktemp("surface") / "surface.h5"
    surface = random_surface(seed, n, harmonics)
    save_surface(path, surface)
    assert_same(load_surface(path), surface)


def test_sentences_of_older_files_come_as_findings(tmp_path):
    save_surface(tmp_path / "s.h5", random_surface(1, 5, 3))
    with h5py.File(tmp_path / "s.h5", "a") as file:
        file.attrs["notes"] = ["the force was not recorded"]
        del file["findings"]
    (finding,) = load_surface(tmp_path / "s.h5").findings
    assert sentence(finding) == "the force was not recorded"


def test_arrays_cannot_be_changed_and_do_not_alias_the_input():
    source = random_surface(5, 4, 2)
    level = np.ones(4)
    surface = replace(source, level=level)
    with pytest.raises(ValueError, match="read-only"):
        surface.level[0] = 2
    level[0] = 7
    assert surface.level[0] == 1


def _made(*shape: int, **how: object) -> Callable[[h5py.File], object]:
    """Return what makes the force, of that shape or of "data"."""
    kind = {} if "data" in how else {"shape": shape, "dtype": "c16"}
    return lambda file: file.create_dataset("force", **kind, **how)


HOSTILE: dict[str, Callable[[h5py.File], object]] = {
    **dict.fromkeys(("external", "virtual", "raw", "soft")),
    "10^8 rows that are not there": _made(10**8),
    "10^8 rows in one chunk": _made(10**8, chunks=(10**7,), compression="gzip"),
    "a few rows, packed": _made(data=np.ones(3) + 0j, compression="gzip"),
    "texts of any length": _made(data=["a", "b", "c"], dtype=h5py.string_dtype()),
    "references": lambda file: file.create_dataset("force", data=[file.ref] * 3, dtype=h5py.ref_dtype),
    "empty": _made(data=h5py.Empty("c16")),
    "a group": lambda file: file.create_group("force"),
    "of another kind": _made(data=np.bytes_("abc")),
    "a long attribute": lambda file: file.attrs.__setitem__("format", np.zeros(8000)),
    "no surface": lambda file: file.attrs.__delitem__("format"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", HOSTILE)
def test_what_a_file_declares_costs_no_more_than_the_file(tmp_path, what):
    save_surface(tmp_path / "s.h5", random_surface(2, 3, 2))
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        if what not in ("a long attribute", "no surface"):
            del file["force"]
        (HOSTILE[what] or outside_ways(tmp_path, "force")[what])(file)
    tracemalloc.start()
    try:
        said = "not an rsgen response surface" if what == "no surface" else ""
        with pytest.raises(MeasurementError, match=rf"s\.h5: .*{said}"):
            load_surface(tmp_path / "s.h5")
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def linear_columns() -> dict[str, np.ndarray]:
    """Two levels of a linear oscillator, swept up; the force lags the clock by 0.4 rad."""
    level, frequency = np.repeat([1.0, 3.0], 20), np.tile(np.linspace(6, 10, 20), 2)
    omega, force = 2 * np.pi * frequency, level * np.exp(-0.4j)
    response = force / (5000.0 - 2.0 * omega**2 + 3j * omega)
    return {"level": level, "frequency": frequency, "force": force, "response": response}


def test_four_columns_are_enough():
    columns = linear_columns()
    surface = ResponseSurface(*columns.values())
    assert (surface.origin, surface.control, surface.findings) == ("measured", "force", ())
    assert (surface.settled & surface.stable & (surface.sweep == "up")).all()
    assert np.isnan([*surface.peak.flat, *surface.error]).all()
    np.testing.assert_array_equal(surface.harmonics[:, 1], columns["response"])
    np.testing.assert_array_equal(surface.harmonics[:, 0], 0)
    assert_same(ResponseSurface(*(column.tolist() for column in columns.values())), surface)


def test_rows_that_are_masked_or_no_numbers_are_left_out_and_counted():
    columns = linear_columns()
    columns["response"] = np.ma.masked_array(columns["response"], np.arange(40) == 3)
    columns["response"][7] = np.nan
    columns["force"][5] = np.inf
    surface = ResponseSurface(*columns.values())
    assert np.flatnonzero(~surface.settled).tolist() == [3, 5, 7]
    np.testing.assert_array_equal(surface.harmonics[8:, 1], columns["response"][8:].data)
    assert [(f.code, f["rows"], f["all"]) for f in surface.findings] == [("rows-left-out", 3, 40)]
    # the finding is made once
    assert replace(surface, level=surface.level).findings == surface.findings
    columns["level"][2] = np.nan
    with pytest.raises(RsgenError, match="level: nan in row 2"):
        ResponseSurface(*columns.values())
    for count in (2, 3):  # of real and imaginary parts, or of amplitudes: neither can be told
        with pytest.raises(RsgenError, match=r"shape \(n,\), complex harmonics \(n, H\+1\), mean first"):
            ResponseSurface(level=[1.0], frequency=[5.0], force=[1.0], response=np.ones((1, count)))


@pytest.mark.parametrize(("name", "rows", "said"), [
    ("response", [1, 5, 30], "3 of 40 rows left out, of level 1, 3, whose"),
    ("force", [7], "1 of 40 rows left out, of level 1, whose"),
])  # fmt: skip
def test_rows_of_exact_zeros_are_left_out_and_counted(name, rows, said):
    columns = linear_columns()
    columns[name][rows] = 0
    surface = ResponseSurface(*columns.values())
    (found,) = surface.findings
    assert sentence(found) == f"{said} force or response is exactly zero"
    kept = np.setdiff1d(np.arange(40), np.arange(40)[rows])
    zeros, without = (rs.identify(one, "k*x + c*v") for one in (surface, surface.select(kept)))
    assert zeros.values == pytest.approx(without.values, rel=1e-9)


def test_a_phase_that_was_not_recorded_is_nan_and_named():
    surface = ResponseSurface(*linear_columns().values())
    assert surface.limits == ()
    assert np.isfinite(surface.phase).all()
    bare = replace(surface, phase_known=False)
    assert [finding.code for finding in bare.limits] == ["not-recorded"]
    assert np.isnan(bare.phase).all()
    assert (surface.units.force, surface.units.of("N/m")) == ("N", "N/m")
    per_mass = replace(surface, per_mass=True)
    assert [finding.code for finding in per_mass.limits] == ["per-unit-mass"]
    assert (per_mass.units.force, per_mass.units.of("N/m")) == ("m/s^2", "N/m/kg")
    assert np.isnan(per_mass.units.kilogram)


LAW = "k1*x + kn1*x**3 + c1*v"


@pytest.mark.parametrize("copied", [np.arange(200), np.full(60, 17)], ids=["many rows", "one row often"])
def test_copies_change_neither_values_nor_intervals(copied):
    surface = fundamentals(noisy(cubic_surface(), 0.01, 3))
    rows = np.concatenate([np.arange(len(surface)), copied])
    assert without_copies(surface) is surface
    found, again = rs.identify(surface, LAW), rs.identify(surface.select(rows), LAW)
    assert again.verdict.state == found.verdict.state
    for name in ("k1", "kn1", "c1", "m"):
        assert again[name].value == pytest.approx(found[name].value, rel=1e-9)
        assert again[name].interval == pytest.approx(found[name].interval, rel=1e-6)
    finding = only(again, "rows-left-out")
    assert finding.names["by"] == "copies"
    assert (finding["rows"], finding["all"]) == (len(copied), len(rows))
    assert finding in rs.modal_table(surface.select(rows)).findings
