"""Projections of a law on a cycle by plain adaptive Gauss quadrature: shares nothing with rsgen but NumPy.

A jump between the end of a panel and its first node is invisible to the rule; therefore the force at the ends
must also be what its nodes extrapolate to. Two partitions that differ everywhere are offered all the same,
and a value counts as right when it agrees with one of them.
"""

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
PANELS = 320
SMOOTH = 1e-6  # how well 12 nodes extrapolate to the ends of a panel without a jump
DEEPEST = 48
ENDS = np.linalg.solve(
    np.polynomial.legendre.legvander(NODES, 11).T, np.polynomial.legendre.legvander([-1.0, 1.0], 11).T
)


def _at(law, start, stop, places):
    """Give the angles at places of panels, -1 their starts and 1 their ends, and the force there."""
    phi = start[:, None] + (stop - start)[:, None] * (places + 1) / 2
    with np.errstate(all="ignore"):
        return phi, np.broadcast_to(law(np.sin(phi), np.cos(phi)), phi.shape)


def _smooth(law, start, stop, size):
    """Tell which panels have end values that fit their nodes."""
    (_, force), (_, at_ends) = (_at(law, start, stop, places) for places in (NODES, np.array([-1.0, 1.0])))
    return np.abs(force @ ENDS - at_ends).max(axis=1) <= SMOOTH * size


def _panel(law, start, stop):
    phi, force = _at(law, start, stop, NODES)
    weighted = force * WEIGHTS * ((stop - start) / 2)[:, None]
    return np.stack([(weighted * part).sum(1) for part in (np.sin(phi), np.cos(phi), 1.0)]
                    + [np.abs(weighted).sum(1)])  # fmt: skip


def _integrate(law, offset):
    edges = np.linspace(0, 2 * np.pi, PANELS) + offset
    start, stop = edges[:-1], edges[1:]
    whole = _panel(law, start, stop)
    if not np.isfinite(whole).all():
        return np.full(4, np.nan)
    total, size = np.zeros(4), whole[3].sum()
    for depth in range(DEEPEST):
        middle = (start + stop) / 2
        left, right = _panel(law, start, middle), _panel(law, middle, stop)
        done = np.abs(left + right - whole).max(axis=0) <= 1e-15 * size
        done &= _smooth(law, start, stop, size)
        done |= depth == DEEPEST - 1
        total += (left + right)[:, done].sum(axis=1)
        start, stop = (
            np.concatenate((start[~done], middle[~done])),
            np.concatenate((middle[~done], stop[~done])),
        )
        whole = np.concatenate((left[:, ~done], right[:, ~done]), axis=1)
        if not len(start):
            break
        if len(start) > 4000:
            return np.full(4, np.nan)
    return total


def relative_errors(law, X, mean, omega, stiffness, damping, least=1e-2):
    """Give the relative error of stiffness and damping, and the mean force, all against |n|; None: undefined.

    ``law`` takes x and v as arrays. ``least`` [N] is the force below which differences are round-off of the
    parts that cancel there (inside a gap); the laws tested have forces of about one.
    """

    def cycle(sine, cosine):
        return law(mean + X * sine, omega * X * cosine)

    best = None
    for offset in (0.1234, 0.5678):
        sine, cosine, level, size = _integrate(cycle, offset)
        if not np.isfinite(size):
            return None
        scale = max(size, least)
        errors = (
            max(abs(stiffness * np.pi * X - sine), abs(damping * np.pi * omega * X - cosine)) / scale,
            abs(level) / scale,
        )
        best = errors if best is None else tuple(min(pair) for pair in zip(best, errors, strict=True))
    return best
