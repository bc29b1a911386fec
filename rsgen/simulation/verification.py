"""Brute force on a sample: is a surface from rest what a long transient gives?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array
from rsgen.errors import RsgenError
from rsgen.kernel import compile_kernel
from rsgen.oscillator import Oscillator
from rsgen.surface import ResponseSurface

__all__ = ["Verification", "verify"]

_STEPS = 256
"""Steps a period: errors of fourth order below 1e-8."""
_PERIODS, _LOOKS = 512, 40
"""Periods between two looks, and looks: 20 000 periods settle a damping ratio of 1e-4."""
_REPEATS = 1e-9
"""Change of the state in a period, of the amplitude, below which a motion repeats."""


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """What brute force said about k points of a surface.

    ``points`` (k,) are its rows, ``difference`` (k,) is |X1 - X1 by brute force| relative to the latter (inf
    where only one of the two has settled), ``periods`` the longest transient that was carried.
    """

    points: NDArray[np.intp]
    difference: Array
    periods: int

    @property
    def largest(self) -> float:
        """The largest difference."""
        return float(self.difference.max(initial=0.0))


def verify(
    oscillator: Oscillator, surface: ResponseSurface, *, sample: int = 200, seed: int = 1
) -> Verification:
    """Integrate some points from rest until their motion repeats by itself, and compare.

    Nothing is extrapolated and no steady state is solved for: only transients, with many fixed steps.

    Parameters
    ----------
    oscillator, surface
        The structure, and its surface simulated from rest, without noise.
    sample, seed
        How many points, all when there are fewer, and the seed of their choice.

    Raises
    ------
    RsgenError
        The surface does not come from rest.
    """
    if not (surface.sweep == "rest").all():
        raise RsgenError("verify: only points from rest can be found again from rest; sweep must be 'rest'")
    surface = surface.on_mass(oscillator.mass)
    points = np.sort(np.random.default_rng(seed).permutation(len(surface))[:sample])
    kernel = compile_kernel(oscillator.force, values=oscillator.values, locate_all=True)
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    F, omega = surface.force[points], surface.omega[points]
    force = np.column_stack([F.real, F.imag])
    state = np.zeros((kernel.rows.count, len(points)))
    repeats = np.zeros(len(points), dtype=bool)
    found = np.full(len(points), complex(np.nan, np.nan))
    active = np.arange(len(points))
    look = 0
    while look < _LOOKS and len(active):
        look += 1
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
        repeats[active[done]] = True
        found[active[done]] = moved.harmonics[done, 1]
        active = active[~done & np.isfinite(size)]
    X = surface.harmonics[points, 1]
    both = repeats & surface.settled[points]
    gap, amplitude = np.abs(X - found), np.abs(found)
    relative = np.divide(gap, amplitude, out=np.where(gap > 0, np.inf, 0.0), where=amplitude > 0)
    difference = np.where(both, relative, np.where(repeats == surface.settled[points], 0.0, np.inf))
    return Verification(points, difference, look * _PERIODS)
