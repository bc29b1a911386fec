"""The exact frequency of free vibration, by energy: what no describing function approximates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsgen.common.arrays import Array

__all__ = ["free_frequency"]


def free_frequency(force: Callable[[float], float], mass: float, high: float) -> float:
    """Compute the frequency [Hz] of undamped free vibration with the upper turning point at ``high``.

    The period is 2 integral dx / sqrt(2 (U(high) - U(x)) / m) between the turning points; x is a sine of
    an angle, which removes the singular ends.

    Parameters
    ----------
    force
        Spring force [N] at x [m], pushing back on both sides of zero; a corner there costs no accuracy.
    mass
        m [kg].
    high
        Upper turning point [m], above zero.

    Returns
    -------
    float
        NaN where the spring does not push back, so that there is no vibration.

    Examples
    --------
    A bilinear spring has exactly omega = 2 w6 w7/(w6 + w7) (docs/method.md, 2):

    >>> bilinear = free_frequency(lambda x: 4.0 * x if x > 0 else 9.0 * x, 1.0, 1.0)
    >>> round(bilinear * 2 * np.pi, 9), round(2 * 2.0 * 3.0 / 5.0, 9)
    (2.4, 2.4)
    """

    # a third of a second, and needed only for laws with a formula in print
    from scipy.integrate import quad
    from scipy.optimize import brentq

    def work(x: float) -> float:
        return float(quad(force, 0.0, x, epsabs=0.0, epsrel=1e-11, limit=200)[0])

    energy = work(high)
    reach = high
    if not (energy > 0 and force(high) > 0):
        return float("nan")
    for _ in range(60):
        if work(-reach) >= energy:
            break
        reach *= 1.3
    else:
        return float("nan")
    low = float(brentq(lambda x: work(x) - energy, -reach, 0.0, xtol=1e-15 * high, rtol=1e-14))
    half = sum(_time(force, mass, end) for end in (low, high))
    return 1 / (2 * half)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def _time(force: Callable[[float], float], mass: float, end: float) -> float:
    """Compute the time [s] from zero to the turning point ``end``.

    With x = end sin(a), the energy left at x is integrated from x on, so that it keeps
    its digits where it vanishes.
    """
    angles: Array = np.pi / 4 * (_NODES + 1)
    total = 0.0
    for angle, weight in zip(angles.tolist(), _WEIGHTS.tolist(), strict=True):
        x = end * np.sin(angle)
        # end - x without cancellation: 1 - sin(a) = 2 sin^2((pi/2 - a)/2)
        left = end * 2 * np.sin((np.pi / 2 - angle) / 2) ** 2
        points = x + left * (_NODES + 1) / 2
        energy = left / 2 * float(np.dot(_WEIGHTS, [force(point) for point in points.tolist()]))
        total += weight * abs(end) * np.cos(angle) / np.sqrt(2 * energy / mass)
    return float(np.pi / 4 * total)
