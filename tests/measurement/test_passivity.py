"""A structure takes energy from its shaker: what is read the other way round is found."""

from pathlib import Path

import numpy as np
import pytest

from rsgen.common.finding import Finding
from rsgen.data.surface import ResponseSurface
from rsgen.files import MeasuredTest, Signal, read_measurement
from rsgen.files.files_to_surface import passivity_findings
from rsgen.report.wording import sentence

MASS, STIFFNESS, DAMPING = 2.0, 2e4, 6.0
FREQUENCY = np.arange(13.0, 20.0, 0.1)


def receptance(frequency: np.ndarray) -> np.ndarray:
    omega = 2 * np.pi * frequency
    return np.asarray(1 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING))


def findings(
    folder: Path, response: np.ndarray, *, lag: bool = False, known: bool = True, order: int = 0
) -> tuple[Finding, ...]:
    """Read a table of receptances, mobilities or accelerances: of that order."""
    path = folder / "a.csv"
    size, turn = np.abs(response) * (2 * np.pi * FREQUENCY) ** order, np.degrees(np.angle(response))
    np.savetxt(path, np.column_stack((FREQUENCY, np.ones_like(FREQUENCY), size, turn)), delimiter=",")
    signal = Signal(amplitude=3, phase=4 if known else None, phase_sense="lag" if lag else "lead")
    quantity = ("displacement", "velocity", "acceleration")[order]
    return read_measurement(
        MeasuredTest(path, 1, Signal(amplitude=2), signal, quantity, phase_known=known)
    ).findings


@pytest.mark.parametrize("order", [0, 1, 2])
def test_what_is_read_rightly_is_not_remarked(tmp_path, order):
    def read(response: np.ndarray, lag: bool = False, known: bool = True) -> tuple[Finding, ...]:
        motion = response * 1j**order
        return findings(tmp_path, motion.conj() if lag else motion, lag=lag, known=known, order=order)

    right = receptance(FREQUENCY)
    assert read(right) == ()
    assert read(right, lag=True) == ()
    assert read(right.conj(), known=False) == ()
    # a phase that is off by the delay of an amplifier
    assert read(right * np.exp(0.2j)) == ()
    # above the resonance alone, in noise, beside a neighbour
    assert read(np.where(FREQUENCY > 16.5, right, receptance(FREQUENCY + 5))) == ()
    noise = np.random.default_rng(1).normal(size=(2, len(FREQUENCY)))
    assert read(right + 0.1 * np.abs(right).max() * (noise[0] + 1j * noise[1])) == ()
    assert read(right + 0.3 * receptance(FREQUENCY - 2.5)) == ()


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("lag", [False, True])
@pytest.mark.parametrize(
    ("phase", "sign", "reversed_part"),
    [(True, False, "phase"), (False, True, "channel"), (True, True, "channel and phase")],
)
def test_a_reversed_channel_or_phase_is_found(tmp_path, order, lag, phase, sign, reversed_part):
    response = receptance(FREQUENCY) * 1j**order * (-1 if sign else 1)
    (finding,) = findings(tmp_path, response.conj() if phase != lag else response, lag=lag, order=order)
    assert finding.names["reversed"] == reversed_part
    text = sentence(finding)
    assert ("factor" in text) == sign
    assert (f'phase_sense = "{"lead" if lag else "lag"}"' in text) == phase


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
@pytest.mark.parametrize("sign", [1, -1])
def test_signs_are_found_in_any_unit_without_overflow(scale, sign):
    frequency = np.linspace(8, 12, 25)
    omega = 2 * np.pi * frequency
    response = sign / (5920 - 1.5 * omega**2 + 6j * omega)
    surface = ResponseSurface(1.0, frequency, 1.0, scale * response)
    assert len(passivity_findings(surface, "lead", "displacement")) == (sign < 0)
