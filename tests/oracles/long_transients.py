"""Brute force on a sample: is a surface from rest what a long transient gives?"""

import numpy as np

from rsgen import Oscillator, ResponseSurface
from rsgen.dynamics.kernel import compile_kernel

_STEPS = 256
"""Steps a period: errors of fourth order below 1e-8."""
_PERIODS, _LOOKS = 512, 40
"""Periods between two looks, and looks: 20 000 periods settle a damping ratio of 1e-4."""
_REPEATS = 1e-9
"""Change of the state in a period, of the amplitude, below which a motion repeats."""


def largest_difference(oscillator: Oscillator, surface: ResponseSurface, sample: int = 200) -> float:
    """Integrate some points from rest until their motion repeats by itself, and compare |X1|, relative.

    Nothing is extrapolated and no steady state is solved for: only transients, with many fixed steps.
    Infinite where only one of the two has settled.
    """
    surface = surface.on_mass(oscillator.mass)
    points = np.sort(np.random.default_rng(1).permutation(len(surface))[:sample])
    kernel = compile_kernel(oscillator.force, values=oscillator.values, locate_all=True)
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    F, omega = surface.force[points], surface.omega[points]
    force = np.column_stack([F.real, F.imag])
    state = np.zeros((kernel.rows.count, len(points)))
    found = np.full(len(points), complex(np.nan, np.nan))
    active = np.arange(len(points))
    for _ in range(_LOOKS):
        if not len(active):
            break
        with np.errstate(over="ignore", invalid="ignore"):
            moved = kernel.integrate(
                active, state[:, active], force, omega, oscillator.mass, values,
                steps=_STEPS, periods=_PERIODS, harmonics=1,
            )  # fmt: skip
            change = np.abs(moved.state[:2] - moved.history[1, :2]).max(axis=0)
            size = np.abs(moved.state[:2]).max(axis=0)
        state[:, active] = moved.state
        # a mass that friction holds does not move at all: nothing changes, and the size is none
        done = change <= _REPEATS * size
        found[active[done]] = moved.harmonics[done, 1]
        active = active[~done & np.isfinite(size)]
    X = surface.harmonics[points, 1]
    repeats = np.isfinite(found)
    both = repeats & surface.settled[points]
    gap, amplitude = np.abs(X - found), np.abs(found)
    relative = np.divide(gap, amplitude, out=np.where(gap > 0, np.inf, 0.0), where=amplitude > 0)
    difference = np.where(both, relative, np.where(repeats == surface.settled[points], 0.0, np.inf))
    return float(difference.max(initial=0.0))
