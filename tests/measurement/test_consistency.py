"""Runs that do not fit together, and structures that would feed the exciter: copies, branches, signs."""

import numpy as np
import pytest

from rsgen import Finding, ResponseSurface, sentence
from rsgen.common.errors import MeasurementError
from rsgen.files.files_to_surface import passivity_findings, read_measurement
from rsgen.files.plan import HistoryRule, LevelRule, MeasuredTest
from rsgen.files.signals import Channel
from tests.measurement.tables import read_planned, write_columns
from tests.surfaces import severities

pytestmark = pytest.mark.usefixtures("read_here")

FREQUENCY = np.linspace(8, 12, 41)
OMEGA = 2 * np.pi * FREQUENCY
NOISY = np.abs(1 / (5920 - 1.5 * OMEGA**2 + 7.5j * OMEGA)) * (
    1 + 1e-3 * np.random.default_rng(1).standard_normal(41)
)
NEWTON = Channel(amplitude=2, unit="N")


def read(*paths) -> ResponseSurface:
    return read_planned(paths, 1, NEWTON, Channel(amplitude=3, unit="m"), frequency_unit="Hz")


def test_a_copy_in_place_of_another_run_is_doubted(tmp_path):
    runs = zip("abc", (1.0, 2.0, 5.0), (NOISY, NOISY, 5 * NOISY), strict=True)
    surface = read(*(write_columns(tmp_path / f"{n}.csv", "", FREQUENCY, *run) for n, *run in runs))
    assert severities(surface) == {"run-repeated": "doubt"}
    assert surface.findings[0].names == {"first": "a.csv", "second": "b.csv"}


def steps(folder, levels: tuple[float, ...], forces: tuple[float, ...]) -> ResponseSurface:
    """Write records of two steps, of equal forces equal ones, as of a file that was copied, and read them."""
    instants = np.arange(0, 60, 0.01)
    wave = 2 * np.pi * np.where(instants < 30, 5, 6) * instants
    paths = tuple(folder / f"{number}.npz" for number in range(len(levels)))
    for path, force in zip(paths, forces, strict=True):
        noise = 1e-5 * np.random.default_rng(round(force)).standard_normal(len(wave))
        np.savez(path, F=force * np.cos(wave), x=1e-3 * force * np.cos(wave - 1) + noise)
    signals = Channel(samples="F", unit="N"), Channel(samples="x", unit="m")
    rule = HistoryRule("stepped-sine", rate=100.0)
    plan = MeasuredTest(paths, None, *signals, "displacement", level=LevelRule(values=levels), history=rule)
    return read_measurement(plan)


def test_a_record_copied_over_another_is_doubted_and_one_of_the_same_level_and_force_is_its_run(tmp_path):
    surface = steps(tmp_path, (1.0, 2.9, 3.1), (1.0, 3.0, 3.0))
    assert severities(surface) == {"run-repeated": "doubt"}
    assert surface.findings[0].names == {"first": "1.npz", "second": "2.npz"}
    assert severities(steps(tmp_path, (1.0, 3.0, 3.0), (1.0, 3.0, 3.6))) == {}
    (found,) = steps(tmp_path, (1.0, 3.0, 3.0), (1.0, 3.0, 6.0)).findings
    said = "1.npz and 2.npz have one level, 3 N, but were driven with 3 N and 5.99 N"
    assert sentence(found).startswith(said)


def test_rows_written_twice_count_once_and_a_file_stands_once_in_a_plan(tmp_path):
    path = write_columns(tmp_path / "a.csv", "", np.repeat(FREQUENCY, 2), 1.0, np.repeat(NOISY, 2))
    with pytest.raises(MeasurementError, match=r"'a\.csv' stands twice"):
        read(path, path)
    surface = read(path)
    assert len(surface) == 41
    assert severities(surface) == {"rows-left-out": "warning"}
    assert surface.findings[0]["rows"] == 41


BAND = np.arange(13.0, 20.0, 0.1)


def receptance(frequency: np.ndarray) -> np.ndarray:
    omega = 2 * np.pi * frequency
    return np.asarray(1 / (2e4 - 2.0 * omega**2 + 6j * omega))


def findings(folder, response: np.ndarray, *, lag: bool = False, known: bool = True, order: int = 0):
    """Read a table of receptances, mobilities or accelerances: of that order."""
    size, turn = np.abs(response) * (2 * np.pi * BAND) ** order, np.degrees(np.angle(response))
    path = write_columns(folder / "a.csv", "", BAND, 1.0, size, turn)
    sense, unit = "lag" if lag else "lead", ("m", "m/s", "m/s^2")[order]
    signal = Channel(amplitude=3, phase=4 if known else None, phase_sense=sense, unit=unit)
    more = {"quantity": ("displacement", "velocity", "acceleration")[order], "frequency_unit": "Hz"}
    return read_planned(path, 1, NEWTON, signal, phase_known=known, **more).findings


@pytest.mark.parametrize("order", [0, 1, 2])
def test_what_is_read_rightly_is_not_remarked(tmp_path, order):
    def read(response: np.ndarray, lag: bool = False, known: bool = True) -> tuple[Finding, ...]:
        motion = response * 1j**order
        return findings(tmp_path, motion.conj() if lag else motion, lag=lag, known=known, order=order)

    right = receptance(BAND)
    assert read(right, lag=True) == ()
    assert read(right.conj(), known=False) == ()
    # a phase that is off by the delay of an amplifier
    assert read(right * np.exp(0.2j)) == ()
    # above the resonance alone, in noise, beside a neighbour
    assert read(np.where(BAND > 16.5, right, receptance(BAND + 5))) == ()
    noise = np.random.default_rng(1).normal(size=(2, len(BAND)))
    assert read(right + 0.1 * np.abs(right).max() * (noise[0] + 1j * noise[1])) == ()
    assert read(right + 0.3 * receptance(BAND - 2.5)) == ()


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("lag", [False, True])
@pytest.mark.parametrize(("phase", "sign", "reversed_part"), [
    (True, False, "phase"), (False, True, "channel"), (True, True, "channel and phase"),
])  # fmt: skip
def test_a_reversed_channel_or_phase_is_found(tmp_path, order, lag, phase, sign, reversed_part):
    response = receptance(BAND) * 1j**order * (-1 if sign else 1)
    (finding,) = findings(tmp_path, response.conj() if phase != lag else response, lag=lag, order=order)
    assert finding.names["reversed"] == reversed_part
    text = sentence(finding)
    assert ("factor" in text) == sign
    assert (f'phase_sense = "{"lead" if lag else "lag"}"' in text) == phase


@pytest.mark.parametrize("turned", [0.0, 0.1, -0.1])
@pytest.mark.parametrize("reverse", [False, True])
def test_a_reversed_phase_is_found_where_the_response_jumps_past_resonance(reverse, turned):
    """The power of the shaker is small there; an error of all phases turns that of one side only."""
    frequency = np.concatenate([np.linspace(6, 8.8, 20), np.linspace(11.2, 14, 20)])
    omega = 2 * np.pi * frequency
    response = np.exp(1j * turned) / (5920 - 1.5 * omega**2 + 3j * omega)
    surface = ResponseSurface(1.0, frequency, 1.0, response.conj() if reverse else response)
    found = [one.names["reversed"] for one in passivity_findings(surface, "lead", "displacement")]
    assert found == ["phase"] * (reverse and not turned)
