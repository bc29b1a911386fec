"""Steady states of an oscillator, from rest or near given states."""

from __future__ import annotations

from numpy.typing import ArrayLike

from rsgen.oscillator import Oscillator
from rsgen.steady_state.solution import SteadyStates

__all__ = ["solve_steady_states"]


def solve_steady_states(
    oscillator: Oscillator,
    force: ArrayLike,
    frequency: ArrayLike,
    *,
    harmonics: int = 7,
    accuracy: float = 1e-4,
    start: ArrayLike | None = None,
) -> SteadyStates:
    """Find where the response to f(t) = Re F exp(i omega t) repeats with the period of the force.

    Parameters
    ----------
    oscillator
        The structure; its parameter values are run-time arguments of the compiled law.
    force
        (n,) complex amplitude F [N].
    frequency
        (n,) [Hz], positive.
    harmonics
        H, how many harmonics of the displacement are returned besides the mean.
    accuracy
        Largest relative error of the fundamental, 1e-9 to 1e-2.
    start
        (n, 2) displacement [m] and velocity [m/s] at t = 0 from which each point starts; None: from rest.

    Raises
    ------
    RsgenError
        Shapes do not fit, a frequency is not positive, harmonics or accuracy are out of range.
    """
    raise NotImplementedError
