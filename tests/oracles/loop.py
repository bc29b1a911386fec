"""Loops of a Masing law stepped through time from rest, and states by DOP853: nothing of rsgen but NumPy."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
ENOUGH = 1e-13  # of a panel against its halves, relative to the largest force times pi

AGREED = 1e-11  # of two partitions that differ everywhere but at the turning points


def stepped(n: Callable, x: np.ndarray) -> np.ndarray:
    """Force along a path that starts at rest and turns at larger and larger, or equal, displacements."""
    ways = np.sign(np.diff(x, prepend=0.0))
    force, turned, last = np.zeros(len(x)), None, 0
    for stop in [*(np.flatnonzero(ways[1:] != ways[:-1]) + 1), len(x)]:
        part = slice(last, stop)
        if turned is None:
            force[part] = np.sign(x[part]) * n(np.abs(x[part]))
        else:
            force[part] = turned[1] + ways[last] * 2 * n(np.abs(x[part] - turned[0]) / 2)
        turned, last = (x[stop - 1], force[stop - 1]), stop
    return force


def equivalent(n: Callable, X: float, omega: float) -> tuple[float, float]:
    """k and c of the second cycle, agreed by two partitions: a corner near the end of a panel is unseen."""
    before = (np.nan, np.nan)
    for parts in (4, 5, 7, 9, 11, 13):
        k, c = _partitioned(n, X, omega, parts)
        if abs(k - before[0]) + omega * abs(c - before[1]) <= AGREED * (abs(k) + omega * abs(c)):
            return k, c
        before = (k, c)
    raise AssertionError("no two partitions agree")


def _partitioned(n: Callable, X: float, omega: float, parts: int) -> tuple[float, float]:
    """k and c; panels that are not yet accurate are halved and time runs again."""
    edges = np.linspace(0, 4.5 * np.pi, 9 * parts + 1)
    for _ in range(60):
        middle = np.sort(np.concatenate((edges, (edges[1:] + edges[:-1]) / 2)))
        values = []
        for cuts in (edges, middle):
            width = np.diff(cuts)[:, None] / 2
            phi = cuts[:-1, None] + width * (NODES + 1)
            # the ends of the panels are stepped through as well, so that the turning points are met
            path = np.concatenate((phi, cuts[1:, None]), axis=1).ravel()
            force = stepped(n, X * np.sin(path)).reshape(len(width), -1)[:, :-1]
            weighted = force * WEIGHTS * width
            values.append(np.stack([(weighted * wave).sum(1) for wave in (np.sin(phi), np.cos(phi))]))
        halves = values[1].reshape(2, -1, 2).sum(axis=2)
        bad = np.flatnonzero(np.abs(halves - values[0]).max(axis=0) > ENOUGH * np.pi * np.abs(force).max())
        if not len(bad):
            break
        edges = np.sort(np.concatenate((edges, (edges[bad] + edges[bad + 1]) / 2)))
    turn = edges[:-1] >= 2.5 * np.pi - 1e-12
    sine, cosine = halves[:, turn].sum(axis=1)
    return sine / (np.pi * X), cosine / (np.pi * omega * X)


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

    z, step = 0.0, 1e-3 * size
    lack = turned(z)[0] + z
    # the secant method; what is smaller than the error of the stepping does not move it any more
    for _ in range(40):
        if abs(step) <= 1e-11 * size:
            break
        before, z = lack, z + step
        lack = turned(z)[0] + z
        step *= -lack / (lack - before) if lack != before else 0.0
    _, sine, cosine = turned(z)
    return 2 * sine / (np.pi * X), 2 * cosine / (np.pi * omega * X)
