"""In which parameters the loop of a law with states is linear: tried on loops along random motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsgen.common.arrays import Array
from rsgen.law.loops import compile_loops
from rsgen.law.memory import MemoryForm

__all__ = ["TriedLoops"]

_SAMPLES = 32
"""A period: an identity of loops holds for the rule that closes them, however coarse it is."""

_MOTIONS = 3
"""Random motions at each size."""

_SIZES = (0.1, 1.0, 10.0)
"""Of random motions: a loop that saturates shows at one size what another hides."""

_SAME = 1e-6
"""Relative size at which differences of forces cancel; loops close to 1e-10."""

_FACTORS = (-1.0, 1.0, 3.0)
"""Factors of a parameter, evenly spaced, at which a force must be affine; that of abs(z) in an equation is
affine for positive ones only."""

_POSITIVE = (1.0, 2.0, 3.0)
"""The same for a common factor of a group."""


class TriedLoops:
    """Loops of a law along random motions at random values, of those that close."""

    def __init__(self, form: MemoryForm, parameters: tuple[str, ...]) -> None:
        generator = np.random.default_rng(0)
        count = _MOTIONS * len(_SIZES)
        harmonics = generator.normal(size=(2, count, 3)) / np.array([1.0, 4.0, 9.0])
        harmonics *= np.repeat(_SIZES, _MOTIONS)[:, None]
        omega = np.exp(generator.normal(size=(count, 1)))
        phase = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
        wave = np.exp(1j * np.arange(1, 4)[:, None] * phase)
        rate = 1j * omega * np.arange(1, 4)
        self._motion = [((harmonics[0] + 1j * harmonics[1]) * rate**power @ wave).real for power in range(3)]
        self._step = 2 * np.pi / _SAMPLES / omega
        self._values = np.exp(generator.normal(size=(len(parameters), count, 1)))
        self._loops = compile_loops(form, parameters)
        closed = np.isfinite(self._forces([([], 1.0)])[0]).all(axis=1)
        self._motion = [part[closed] for part in self._motion]
        self._step = self._step[closed]
        self._values = self._values[:, closed]

    def bends(self, i: int) -> bool:
        """Decide whether the force is not affine in a parameter."""
        return not self._affine([i], _FACTORS)[0]

    def couples(self, i: int, j: int) -> bool:
        """Decide whether the force is not jointly affine in two parameters, affine in each."""
        return not self._separate([i], [j], _FACTORS[0])

    def scales(self, group: Sequence[int], linear: Sequence[int]) -> bool:
        """Decide whether a common factor of a group acts, and the force is affine in it.

        ``linear`` are the parameters in which the force has to be affine at the same time.
        """
        affine, acts = self._affine(group, _POSITIVE)
        return affine and acts and all(self._separate(group, [other], _POSITIVE[1]) for other in linear)

    def _affine(self, group: Sequence[int], factors: Sequence[float]) -> tuple[bool, bool]:
        """Decide whether the force is affine in a common factor, and whether the factor acts."""
        forces = self._forces([(group, factor) for factor in factors])
        return (
            _vanishes(forces[0] - 2 * forces[1] + forces[2], forces),
            not _vanishes(forces[1] - forces[0], forces),
        )

    def _separate(self, group: Sequence[int], other: Sequence[int], factor: float) -> bool:
        """Decide whether a factor of two groups changes the force for one independently of the other."""
        forces = self._forces([(each, factor) for each in ([], group, other, [*group, *other])])
        return _vanishes(forces[0] - forces[1] - forces[2] + forces[3], forces)

    def _forces(self, trials: Sequence[tuple[Sequence[int], float]]) -> Array:
        """(t, n, s) loops with a group of parameters multiplied by a factor, for every trial."""
        values = np.repeat(self._values[:, None], len(trials), axis=1)
        for place, (group, factor) in enumerate(trials):
            values[list(group), place] *= factor
        x, v, a = (np.tile(part, (len(trials), 1)) for part in self._motion)
        step = np.tile(self._step, (len(trials), 1))
        sample = self._loops.sample(x, v, a, step, list(values.reshape(len(values), len(x), 1)))
        return sample.force.reshape(len(trials), -1, _SAMPLES)


def _vanishes(difference: Array, forces: Array) -> bool:
    """Decide whether a combination of forces (n, s) cancels on every loop that closes."""
    size = np.max(np.abs(forces), axis=(0, 2), initial=0.0)
    closed = np.isfinite(size) & (size > 0)
    return bool(closed.any() and np.all(np.abs(difference[closed]).max(axis=1) <= _SAME * size[closed]))
