"""Rows of the balance at a reference: neighbouring exact motions fulfil them to second order."""

import numpy as np
import pytest

from rsgen.common.tolerances import BALANCE_HARMONICS
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import following_harmonics, hold_amplitude
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import select_points
from rsgen.identification.ranking.balance import predicted_motion, whiten_balance
from rsgen.law.numeric import compile_law
from tests.surfaces import LAWS, MASS, model

LAW = compile_law(model("quintic").force)
VALUES = np.array([LAWS["quintic"][1][name] for name in LAW.parameters])
OMEGA = 2 * np.pi * np.array([8.0, 9.5, 10.0, 11.0, 12.5])
SIZE = np.array([0.02, 0.03, 0.04, 0.05, 0.03])
TURN = np.array([0.4, -1.0, 2.0, 0.1, -2.5])


def exact(size: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and harmonics of exact motions of these sizes and phases."""
    follow = following_harmonics(LAW, BALANCE_HARMONICS)
    held = hold_amplitude(
        LAW, VALUES, MASS, OMEGA, size, np.zeros((5, BALANCE_HARMONICS + 1), complex), follow, 256
    )
    phase = np.exp(1j * turn)
    return held.force * phase, held.harmonics * phase[:, None] ** np.arange(BALANCE_HARMONICS + 1)


def left(distance: float) -> float:
    """Largest residual of rows at motions that are so far off the reference in size and phase."""
    force, harmonics = exact(SIZE, np.zeros(5))
    seen_force, seen = exact(SIZE * (1 + distance), TURN + distance)
    surface = ResponseSurface(1.0, OMEGA / 2 / np.pi, seen_force, seen)
    observed = Observed.of(select_points(surface, model("quintic")))
    motion = predicted_motion(observed, np.zeros(0), harmonics, force, TURN)
    rows = whiten_balance(motion, LAW, VALUES, MASS, np.full(BALANCE_HARMONICS + 1, 0.01), balanced=True)
    rest = rows.right - rows.of_law(LAW, VALUES)[0] - MASS * rows.inertia
    return float(np.abs(rest[:, rows.compared]).max())


def test_neighbouring_motions_fulfil_the_rows_to_second_order() -> None:
    assert left(0.0) < 1e-8
    assert left(1e-2) / left(1e-3) == pytest.approx(100, rel=0.2)
    # a tenth of the noise of a hundredth, in motions that are a thousandth off, is not first order
    assert left(1e-3) < 1e-2
