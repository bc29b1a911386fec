"""A structure takes energy from its shaker: what is read the other way round is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsgen.measurement import MeasuredTest, Signal, read_measurement

MASS, STIFFNESS, DAMPING = 2.0, 2e4, 6.0
FREQUENCY = np.arange(13.0, 20.0, 0.1)


def receptance(frequency: np.ndarray) -> np.ndarray:
    omega = 2 * np.pi * frequency
    return np.asarray(1 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING))


def notes(folder: Path, response: np.ndarray, *, lag: bool = False, known: bool = True) -> tuple[str, ...]:
    path = folder / "a.csv"
    rows = np.column_stack(
        (FREQUENCY, np.ones_like(FREQUENCY), np.abs(response), np.degrees(np.angle(response)))
    )
    np.savetxt(path, rows, delimiter=",")
    sign = -np.pi / 180 if lag else np.pi / 180
    signal = Signal(amplitude=3, phase=4 if known else None, phase_factor=sign)
    return read_measurement(
        MeasuredTest(path, 1, Signal(amplitude=2), signal, "displacement", phase_known=known)
    ).notes


def test_what_is_read_rightly_is_not_remarked(tmp_path: Path) -> None:
    right = receptance(FREQUENCY)
    assert notes(tmp_path, right) == ()
    assert notes(tmp_path, right.conj(), lag=True) == ()
    assert notes(tmp_path, right.conj(), known=False) == ()
    # a phase that is off by the delay of an amplifier
    assert notes(tmp_path, right * np.exp(0.2j)) == ()
    # above the resonance alone, in noise, beside a neighbour
    assert notes(tmp_path, np.where(FREQUENCY > 16.5, right, receptance(FREQUENCY + 5))) == ()
    noise = np.random.default_rng(1).normal(size=(2, len(FREQUENCY)))
    assert notes(tmp_path, right + 0.1 * np.abs(right).max() * (noise[0] + 1j * noise[1])) == ()
    assert notes(tmp_path, right + 0.3 * receptance(FREQUENCY - 2.5)) == ()


@pytest.mark.parametrize("lag", [False, True])
@pytest.mark.parametrize(
    ("phase", "sign", "told"),
    [
        (True, False, "feed energy into the shaker: the phase is probably reversed"),
        (False, True, "the moving mass would be negative: a channel is probably reversed"),
        (True, True, "the moving mass would be negative: a channel and its phase are probably reversed"),
    ],
)
def test_what_is_reversed_is_told(tmp_path: Path, lag: bool, phase: bool, sign: bool, told: str) -> None:
    response = receptance(FREQUENCY) * (-1 if sign else 1)
    (note,) = notes(tmp_path, response.conj() if phase != lag else response, lag=lag)
    assert told in note
    assert ("factor" in note) == sign
    assert (f'phase_sense = "{"lead" if lag else "lag"}"' in note) == phase
