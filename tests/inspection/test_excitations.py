"""The excitation of records and what a table held are recognised by their values, and the records read so."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.signal

from rsgen.app.cli.inspect_command import Trial, proposal_text, try_proposal
from rsgen.data.history import TimeHistory
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface
from rsgen.files.inspection import list_contents, propose
from rsgen.files.inspection.corrections import dies_away, excitation_of

MASS, DAMPING, STIFFNESS = 1.5, 8.0, 6000.0
RATE = 256.0
SHARE = 0.4
"""Motion of the second sensor over that of the first."""


def seconds(duration: float) -> np.ndarray:
    return np.arange(int(duration * RATE)) / RATE


def sine(frequency: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * np.cumsum(frequency) / RATE)


def sweep(first: float = 6, last: float = 14, duration: float = 80) -> np.ndarray:
    return sine(np.linspace(first, last, int(duration * RATE)))


def logarithmic() -> np.ndarray:
    return sine(np.geomspace(3, 30, int(80 * RATE)))


def rests() -> np.ndarray:
    return sine(np.concatenate([np.full(1000, 6.0), np.linspace(6, 14, 16_000), np.full(4000, 14.0)]))


def up_and_down() -> np.ndarray:
    frequency = np.concatenate([np.linspace(6, 14, 10_000), np.linspace(14, 6, 10_000)])
    return (1 - 0.7 * np.exp(-((frequency - 10) ** 2))) * sine(frequency)


def steps(dwell: float = 4.0, width: float = 0.4) -> np.ndarray:
    return sine(np.repeat(np.arange(7, 13.1, width), int(dwell * RATE)))


def levels() -> np.ndarray:
    frequency = np.repeat(np.tile(np.arange(8, 12.1, 0.5), 3), int(4 * RATE))
    return np.repeat([1.0, 2.0, 4.0], len(frequency) // 3) * sine(frequency)


def multisine(low: float = 3, high: float = 20, period: float = 4, count: int = 6) -> np.ndarray:
    rng = np.random.default_rng(5)
    spectrum = np.zeros(int(period * RATE) // 2 + 1, dtype=complex)
    lines = np.arange(int(low * period), int(high * period))
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    one = np.fft.irfft(spectrum)
    return np.asarray(np.tile(one / one.std(), count))


def blow() -> np.ndarray:
    force = np.zeros(int(20 * RATE))
    force[200:204] = 50.0
    return force


def released() -> np.ndarray:
    return np.asarray(np.where(seconds(20) < 8, sine(np.full(int(20 * RATE), 10.0)), 0))


def swept_with_an_end() -> np.ndarray:
    return np.concatenate([sweep(), np.zeros(10_000)])


def noise_of(count: int, cut: float = 1.0) -> np.ndarray:
    white = np.random.default_rng(2).normal(size=count)
    return white if cut == 1 else np.asarray(scipy.signal.lfilter(*scipy.signal.butter(4, cut), white))


def random_force() -> np.ndarray:
    return noise_of(12_000)


def slow_random_force() -> np.ndarray:
    return noise_of(12_000, 0.2)


def kind(force: np.ndarray, noise: float) -> str:
    """What a force is read as, with noise relative to its largest value."""
    noisy = force + noise * np.abs(force).max() * np.random.default_rng(1).normal(size=len(force))
    return excitation_of(TimeHistory(rate=RATE, force=noisy, response=noisy, quantity="acceleration"))


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (sweep, "swept-sine"),
        (lambda: sweep(14, 6), "swept-sine"),
        (lambda: sweep(9.5, 10.5), "swept-sine"),
        (logarithmic, "swept-sine"),
        (rests, "swept-sine"),
        (up_and_down, "swept-sine"),
        (steps, "stepped-sine"),
        (lambda: steps(3.0, 0.1), "stepped-sine"),
        (lambda: steps(1.5, 0.2), "stepped-sine"),
        (levels, "stepped-sine"),
        (multisine, "multisine"),
        (lambda: multisine(9, 11, 10, 3), "multisine"),
        (lambda: multisine(2, 100, 2, 2), "multisine"),
        (blow, "ring-down"),
        (released, "ring-down"),
        (swept_with_an_end, "swept-sine"),
        (random_force, ""),
        (slow_random_force, ""),
    ],
)
def test_a_force_says_how_it_excites(make: Callable[[], np.ndarray], expected: str, noise: float) -> None:
    assert kind(make(), noise) == expected


SILENCE = np.zeros(int(5 * RATE))


def up(spacing: Callable[..., np.ndarray], first: float = 5, last: float = 16) -> np.ndarray:
    return spacing(first, last, int(30 * RATE))


@pytest.mark.parametrize("spacing", [np.linspace, np.geomspace])
@pytest.mark.parametrize(
    "runs",
    [
        lambda run: sine(run),
        lambda run: np.repeat([1.0, 3.0], len(run)) * sine(np.tile(run, 2)),
        lambda run: sine(np.tile(run, 3)),
        lambda run: sine(np.tile(run[::-1], 12)),
        lambda run: sine(np.tile(np.concatenate([run, run[::-1]]), 2)),
        lambda run: sine(np.concatenate([run, np.full(len(SILENCE), run[-1]), run])),
        lambda run: np.concatenate([sine(run), SILENCE, 3 * sine(run)]),
    ],
)
def test_sweeps_one_after_the_other_are_no_steps(
    runs: Callable[[np.ndarray], np.ndarray], spacing: Callable[..., np.ndarray]
) -> None:
    """The jump back from the last frequency to the first is larger than any step, and the only one."""
    for noise in (0.0, 0.02):
        for first, last in ((5, 16), (5, 25), (8, 12)):
            force = runs(up(spacing, first, last))
            assert kind(force, noise) == "swept-sine", (noise, first, last)


@pytest.mark.parametrize("count", [3, 10, 40])
def test_few_steps_and_many_are_steps(count: int) -> None:
    frequency = np.linspace(5, 16, count)
    dwell = int(max(4, 30 / count) * RATE)
    held = np.repeat(frequency, dwell)
    apart = [np.concatenate([sine(np.full(dwell, f)), SILENCE]) for f in frequency]
    for noise in (0.0, 0.02):
        assert kind(sine(held), noise) == "stepped-sine", noise
        assert kind(sine(np.tile(held, 2)), noise) == "stepped-sine", noise
        if count > 3:
            assert kind(np.concatenate(apart), noise) == "stepped-sine", noise


def response(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and acceleration of the oscillator under a force."""
    system = ([0, 1], [[0, 1], [-STIFFNESS / MASS, -DAMPING / MASS]])
    matrices = (system[1], [[0], [1 / MASS]], [[1, 0], system[1][1]], [[0], [1 / MASS]])
    _, found, _ = scipy.signal.lsim(matrices, force, np.arange(len(force)) / RATE)
    return found[:, 0], found[:, 1]


def tried(path: Path, columns: dict[str, np.ndarray]) -> tuple[dict[str, Any], Trial]:
    """Give the [test] tables that are proposed for a file of these columns, and what they read."""
    rows = [";".join(f"{value:.8g}" for value in row) for row in np.column_stack(list(columns.values()))]
    path.write_text("\n".join([";".join(columns), *rows, ""]), encoding="utf-8")
    contents = list_contents(path)
    proposal = propose(contents)
    assert proposal is not None
    trial = try_proposal(contents, proposal)
    tables: dict[str, Any] = tomllib.loads(proposal_text(trial.proposal))["test"]
    return tables, trial


def dynamic_stiffness(frequency: np.ndarray) -> np.ndarray:
    """Force over displacement [N/m]."""
    omega = 2 * np.pi * frequency
    return STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING


@pytest.mark.slow
@pytest.mark.parametrize("name", ["run.csv", "decay_of_a_multisine_step.csv"])
@pytest.mark.parametrize(
    ("make", "kind"), [(sweep, "swept-sine"), (steps, "stepped-sine"), (multisine, "multisine")]
)
def test_a_record_is_read_by_what_it_is(
    tmp_path: Path, make: Callable[[], np.ndarray], kind: str, name: str
) -> None:
    """Whatever the file is called, force over response is the stiffness of the oscillator."""
    force = make()
    acceleration = response(force)[1]
    columns = {"Time [s]": seconds(len(force) / RATE), "Acc root [g]": SHARE * acceleration / 9.80665}
    columns |= {"Acc tip [g]": acceleration / 9.80665, "Force [N]": force}
    tables, trial = tried(tmp_path / name, columns)
    assert not trial.fault
    assert tables["excitation"] == kind
    assert tables["response"] == {"channels": "acc_root"}
    assert set(tables["channels"]) == {"acc_root", "acc_tip"}
    for other in {"swept-sine", "stepped-sine", "multisine", "ring-down"} - {kind}:
        assert other in trial.proposal.doubts["test.excitation"]
    surface = trial.surface
    if isinstance(surface, MultisineSpectra):
        assert surface.periods * 1024 <= len(force)
        lines = surface.excited()[0]
        ratio = surface.force.mean(axis=1)[0, lines] / surface.response.mean(axis=1)[0, lines]
        exact = dynamic_stiffness(surface.frequency[lines])
    else:
        assert surface is not None
        ratio, exact = surface.force / surface.harmonics[:, 1], dynamic_stiffness(surface.frequency)
    # straight lines between the samples of the force, and the rate of a sweep, leave a per cent
    assert np.median(np.abs(SHARE * ratio / exact - 1)) < 0.02


@pytest.mark.parametrize(
    ("make", "kind"), [(sweep, "swept-sine"), (steps, "stepped-sine"), (multisine, "multisine")]
)
def test_a_record_without_its_sampling_rate_shows_its_excitation(
    tmp_path: Path, make: Callable[[], np.ndarray], kind: str
) -> None:
    force = make()
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, {"force": force, "acceleration": response(force)[1]})
    contents = list_contents(path)
    trial = try_proposal(contents, propose(contents))
    assert trial.surface is None
    assert trial.proposal.tables["test"]["excitation"] == kind
    assert "?" in trial.proposal.tables["test.time"]["rate"]


@pytest.mark.slow
@pytest.mark.parametrize("reference", ["absolute", "relative"])
def test_a_base_that_sweeps_is_recognised(tmp_path: Path, reference: str) -> None:
    base = sweep()
    # relative motion of a kilogram under minus the acceleration of the base
    relative = response(-MASS * base)[1]
    columns = {"t [s]": seconds(len(base) / RATE), "Table [m/s^2]": base}
    columns["Mass [m/s^2]"] = relative + (base if reference == "absolute" else 0)
    tables, trial = tried(tmp_path / "a.csv", columns)
    assert tables["base"]["samples"] == "Table [m/s^2]"
    assert tables["base"]["response"] == reference
    assert tables["response"]["samples"] == "Mass [m/s^2]"
    surface = trial.surface
    assert isinstance(surface, ResponseSurface)
    exact = dynamic_stiffness(surface.frequency) / MASS
    assert np.median(np.abs(surface.force / surface.harmonics[:, 1] / exact - 1)) < 0.02


@pytest.mark.slow
def test_a_decay_is_told_from_a_response_whose_force_is_missing(tmp_path: Path) -> None:
    after = response(blow())[1][210:]
    tables, trial = tried(tmp_path / "a.csv", {"t [s]": seconds(len(after) / RATE), "Acc [m/s²]": after})
    assert tables["excitation"] == "ring-down"
    surface = trial.surface
    assert isinstance(surface, ResponseSurface)
    natural = np.sqrt(STIFFNESS / MASS) / 2 / np.pi
    assert surface.frequency == pytest.approx(np.full(len(surface), natural), rel=2e-3)
    driven = response(multisine())[1]
    assert not dies_away(driven)
    assert not dies_away(response(sweep())[1])
    columns = {"t [s]": seconds(len(driven) / RATE), "Acc 1 [m/s²]": driven, "Acc 2 [m/s²]": 0.5 * driven}
    _, missing = tried(tmp_path / "b.csv", columns)
    assert missing.surface is None
    assert "name the force" in missing.proposal.doubts["test.excitation"]


LOCKED = np.geomspace(1e-3, 2e-2, 9)
"""Amplitudes of a hardening spring in a phase-locked loop [m]."""


@pytest.mark.parametrize(
    ("titles", "phase"),
    [
        (("f [Hz]", "F [N]", "x [mm]", "lag [deg]"), 90.0),
        (("Level [N]", "f_res [Hz]", "Force [N]", "Acc [g]", "Phase [deg]"), 90.0),
        (("Stufe", "Eigenfrequenz [Hz]", "Kraft [N]", "Weg [mm]", "Phase [°]"), -90.0),
        (("f [Hz]", "F [N]", "v [mm/s]", "phase [rad]"), 0.0),
        (("f [Hz]", "F [N]", "x [mm]"), None),
        (("freq_hz", "f_re_N", "f_im_N", "x_re_mm", "x_im_mm"), 90.0),
    ],
)
def test_a_table_of_resonances_is_recognised(
    tmp_path: Path, titles: tuple[str, ...], phase: float | None
) -> None:
    """One row a level at phase resonance: k(X) = m omega^2 at each, however it is written."""
    omega = np.sqrt((STIFFNESS + 0.75 * 3e6 * LOCKED**2) / MASS)
    force = omega * DAMPING * LOCKED
    motion = -1j * LOCKED * np.exp(0.004j * np.arange(9))
    order = 2 if "Acc [g]" in titles else 1 if "v [mm/s]" in titles else 0
    recorded = motion * (1j * omega) ** order * (1 / 9.80665 if order == 2 else 1e3)
    angle = -np.angle(recorded) if phase == 90.0 and order == 0 else np.angle(recorded)
    turned = recorded * np.exp(0.3j)
    values = {
        **dict.fromkeys(("f [Hz]", "f_res [Hz]", "Eigenfrequenz [Hz]", "freq_hz"), omega / 2 / np.pi),
        **dict.fromkeys(("F [N]", "Force [N]", "Kraft [N]"), force),
        **dict.fromkeys(("x [mm]", "Acc [g]", "Weg [mm]", "v [mm/s]"), np.abs(recorded)),
        **dict.fromkeys(("lag [deg]", "Phase [deg]", "Phase [°]"), np.degrees(angle)),
        "phase [rad]": angle,
        "Level [N]": np.round(force, 1),
        "Stufe": np.arange(1.0, 10.0),
        "f_re_N": force * np.cos(0.3),
        "f_im_N": force * np.sin(0.3),
        "x_re_mm": turned.real,
        "x_im_mm": turned.imag,
    }
    columns = {title: values[title] for title in titles}
    tables, trial = tried(tmp_path / "a.csv", columns)
    assert tables["control"] == "phase"
    assert '"force"' in trial.proposal.doubts["test.control"]
    surface = trial.surface
    assert isinstance(surface, ResponseSurface)
    assert len(surface.levels) == 9
    assert surface.control == "phase"
    np.testing.assert_allclose(surface.amplitude, LOCKED, rtol=1e-6)
    assert np.abs(np.degrees(surface.phase) - 90).max() < 3


def test_a_sweep_without_phases_is_no_table_of_resonances(tmp_path: Path) -> None:
    frequency = np.linspace(8, 12, 12)
    amplitude = 1e3 * 2.0 / np.abs(dynamic_stiffness(frequency))
    for drop in (0.0, 0.6):
        force = 2.0 * (1 - drop * np.exp(-((frequency - 10) ** 2)))
        columns = {"f [Hz]": frequency, "F [N]": force, "x [mm]": amplitude * force}
        tables, _ = tried(tmp_path / "a.csv", columns)
        assert "control" not in tables


def test_a_quantity_that_no_name_tells_is_that_of_the_phases(tmp_path: Path) -> None:
    frequency = np.tile(np.linspace(7, 13, 21), 2)
    force = np.repeat([1.0, 3.0], 21)
    a = -((2 * np.pi * frequency) ** 2) * force / dynamic_stiffness(frequency)
    columns = {"f [Hz]": frequency, "F [N]": force, "Tip re": a.real, "Tip im": a.imag}
    tables, trial = tried(tmp_path / "a.csv", columns)
    assert (tables["response"]["quantity"], tables["response"]["unit"]) == ("acceleration", "m/s^2")
    assert "by its phase" in trial.proposal.doubts["test.response.quantity"]
    assert "not in the file" in trial.proposal.doubts["test.response.unit"]
