"""Half a loop of a Masing law by QUADPACK, and of a state by LSODA: nothing of rsgen but NumPy and SciPy."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import newton


def equivalent(n: Callable, X: float, omega: float) -> tuple[float, float]:
    """k and c of a loop: after the turn at -X the force grows by twice the virgin curve of half the way."""

    def projected(wave: Callable) -> float:
        along = lambda phi: (2 * n(X * (1 + np.sin(phi)) / 2) - n(X)) * wave(phi)  # noqa: E731
        return quad(along, -np.pi / 2, np.pi / 2, epsabs=1e-13 * abs(n(X)), epsrel=0, limit=500)[0]

    return 2 * projected(np.sin) / (np.pi * X), 2 * projected(np.cos) / (np.pi * omega * X)


def odd_loop(rate: Callable, force: Callable, X: float, omega: float) -> tuple[float, float]:
    """k and c of an odd law of one state: half a turn, stepped by LSODA, turns its sign."""
    size = abs(rate(0.0, omega * X, 0.0)) / omega

    def along(phi, y):
        x, v = X * np.sin(phi), omega * X * np.cos(phi)
        load = force(x, v, y[0])
        return [rate(x, v, y[0]) / omega, load * np.sin(phi), load * np.cos(phi)]

    def turned(z):
        span, limits = (-np.pi / 2, np.pi / 2), {"rtol": 1e-11, "atol": 1e-14 * size, "max_step": 0.05}
        return solve_ivp(along, span, [z, 0.0, 0.0], "LSODA", **limits).y[:, -1]

    _, sine, cosine = turned(newton(lambda z: turned(z)[0] + z, 0.0, x1=1e-3 * size, tol=1e-11 * size))
    return 2 * sine / (np.pi * X), 2 * cosine / (np.pi * omega * X)
