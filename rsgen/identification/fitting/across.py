"""Laws between two sensors, and their forward model along the motion that was measured.

The balance is written at the sensor of the response, F = m x'' + n(x, x') + n_a(z, z'): some elements follow
the response x, others the motion z across them. How z goes with x is measured at every point, and other modes
take part in it; so z is the measured motion, in proportion to the response, harmonics in the phase measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import samples_for
from rsgen.data.oscillator import total_force
from rsgen.identification.fitting.forward import Response
from rsgen.identification.fitting.points import Points
from rsgen.law.element import Element
from rsgen.law.motion import Motion, project
from rsgen.law.numeric import ForceLaw, ForceSample, Part, Waves, compile_law

__all__ = ["MeasuredAcross", "law_of", "motions_of"]

_STEP = 1e-6
"""Relative change of the amplitude by which the slope of a loop is taken: half the digits of a double."""


def law_of(elements: Sequence[Element], *, across: bool, means: tuple[bool, bool] = (True, True)) -> ForceLaw:
    """Compile the law of some elements; those across two sensors need a test that has their motion.

    Parameters
    ----------
    elements
        All of them.
    across
        Whether the test has a motion across two sensors.
    means
        Whether the mean of the response and that of the motion across were recorded.

    Raises
    ------
    RsgenError
        Elements act across two sensors and the motion across is not in the test, or the other way round; they
        act across several; or a law is not odd, whose mean across nobody recorded.
    """
    whole = compile_law(total_force(elements))
    labels = sorted({element.across for element in elements if element.across})
    if not across and not labels:
        return whole
    if len(labels) > 1:
        raise RsgenError(f"across: {', '.join(map(repr, labels))}; one pair of sensors is allowed in a law")
    if not across:
        raise RsgenError(f"across: an element acts across {labels[0]!r}; the test has no motion across")
    if not labels:
        raise RsgenError(
            "across: the test has a motion across two sensors, but no element follows it; say which ones do "
            '(across = "..." of the element)'
        )
    parts = []
    for acts, known in zip((False, True), means, strict=True):
        chosen = [element.force for element in elements if bool(element.across) == acts]
        law = compile_law(sympy.Add(*chosen))
        if not (law.odd or known):
            motion = f"motion across {labels[0]!r}" if acts else "response"
            raise RsgenError(
                f"across: the elements that follow the {motion} are not odd, and the mean of that motion was "
                "not recorded; displacements with their mean, or an odd law, are needed"
            )
        lost = ", ".join(name for name in law.parameters if name not in whole.parameters)
        if lost:
            raise RsgenError(
                f"across: {lost}: cancels in the sum of the elements; give it another name in the elements "
                "that act across"
            )
        places = np.array([whole.parameters.index(name) for name in law.parameters], dtype=np.intp)
        parts.append(Part(law, places, across=acts))
    # along motions that were measured with their mean nothing even is left to be found
    return replace(whole, odd=True, even=(), _parts=tuple(parts))


def motions_of(law: ForceLaw, followed: Motion, points: Points) -> tuple[Motion, ...]:
    """Motions of the parts of a law: of several the measured ones, of one that which is ``followed``."""
    if points.across is None or not law.acts_across:
        return (followed,)
    return points.motion, Motion(points.omega, points.across)


class MeasuredAcross:
    """Force at the response from a law across two sensors, along the measured motion across.

    It goes with the response in the proportion that was measured, as a prediction needs it, and a law that
    misses. Once its noise is weighed it is the one that was measured, whatever the response is taken to be.

    Parameters
    ----------
    law
        The force law.
    response, across
        As measured at the same points: of the mode, and across the elements.
    mass_free
        Whether the mass is a parameter.
    """

    harmonics: tuple[int, ...] = ()
    exact_slopes = True
    step = 1e-4
    """As that of the harmonic balance."""

    def __init__(self, law: ForceLaw, response: Motion, across: Motion, *, mass_free: bool) -> None:
        self._law, self._omega, self._mass_free = law, response.omega, mass_free
        self._columns = max(response.harmonics.shape[1], across.harmonics.shape[1])
        least = 1 << (8 * (self._columns - 1) - 1).bit_length()
        self.samples = max(samples_for(law.switched), least)
        self._step = response.interval(self.samples)
        self._measured = across.waveforms(self.samples)
        self._response, self._across = (
            _per_metre(motion, response.harmonics[:, 1]).waveforms(self.samples)
            for motion in (response, across)
        )
        self._near = response.harmonics[:, 1]
        sensors = self._near, self._near - across.harmonics[:, 1]
        self._sensors = [_sine(self._omega, motion, self.samples) for motion in sensors]
        self.noise: Array | None = None
        """(n,) noise of the force with that of the motion across, relative to its own; None: not weighed."""

    def weigh(self, values: Array, mass: float, force: Array) -> bool:
        """Follow the motion across as it was measured, and count its noise as the law at (p,) values does.

        The motion across is a difference of two sensors, near x and far, each with noise in proportion to
        its motion. Noise of the near one moves the balance F = D x + n_a by D + n_a', where the fit, to which
        the motion across is as measured, expects D; that of the far one by n_a'. What both add to the noise
        of the measured (n,) force |F| counts. The weights stay from here on: no value gains by larger ones.
        """
        self.noise, size, phase = np.ones(len(force)), np.abs(self._near), np.angle(self._near)
        own = self(values, mass, size, phase).force_slope * np.exp(1j * phase)
        near, far = (self._moved(values, motion) for motion in self._sensors)
        more = np.abs(own + near) ** 2 - np.abs(own) ** 2 + np.abs(far) ** 2
        self.noise = np.sqrt(1 + np.nan_to_num(np.maximum(more, 0.0) / force**2, posinf=0.0))
        return True

    def _moved(self, values: Array, motion: Waves) -> ComplexArray:
        """(n,) change of the force across with a part of the motion, by its logarithm."""
        high, low = (
            project(self._law.sample_parts((waves, waves), self._step, values)[1].force, 1)
            for waves in (_plus(self._measured, motion, sign * _STEP) for sign in (1, -1))
        )
        return np.asarray((high - low) / (2 * _STEP))

    def __call__(self, values: Array, mass: float, size: Array, phase: Array | None = None) -> Response:
        """Evaluate at (p,) values, a mass [kg], (n,) amplitudes [m] and phases [rad] of the response."""
        phase = None if self.noise is None else phase
        here, there = self._sample(values, size, phase)
        back = np.ones(len(size), dtype=complex) if phase is None else np.exp(-1j * phase)
        inertia = -(self._omega**2) * size
        joint = project(there.force, 1) * back
        force = project(here.force, 1) + joint + mass * inertia
        slope = mass * inertia + self._slope(here, there, values, size, phase)
        columns = [
            project(a, 1) + project(b, 1) * back
            for a, b in zip(here.by_parameter, there.by_parameter, strict=True)
        ]
        if self._mass_free:
            columns.append(inertia.astype(complex))
        force_by = np.stack(columns, axis=1) if columns else np.zeros((len(size), 0), dtype=complex)
        harmonics = np.zeros((len(size), self._columns), dtype=complex)
        harmonics[:, 1] = size
        none = np.zeros((*harmonics.shape, force_by.shape[1]), dtype=complex)
        valid = np.isfinite(force)
        made = Response(force, harmonics, slope, harmonics, force_by, none, valid)
        if phase is None:
            return made
        return replace(made, force_phase=-1j * joint, force_noise=self.noise)

    def _sample(self, values: Array, size: Array, phase: Array | None) -> tuple[ForceSample, ForceSample]:
        """Both parts of the law at amplitudes (n,) [m] of the response."""
        across = _times(self._across, size) if phase is None else self._measured
        here, there = self._law.sample_parts((_times(self._response, size), across), self._step, values)
        return here, there

    def _slope(
        self, here: ForceSample, there: ForceSample, values: Array, size: Array, phase: Array | None
    ) -> NDArray[np.complex128]:
        """(n,) derivative of the force of the law by the logarithm of the amplitude."""
        parts = [(here, self._response), *([(there, self._across)] if phase is None else [])]
        if not any(sample.by_memory for sample, _ in parts):
            total = np.zeros_like(here.force)
            for sample, motion in parts:
                x, v, _ = _times(motion, size)
                total += sample.by_x * x + sample.by_v * v
            return project(total, 1)
        # a loop changes with the whole motion before it
        high, low = (
            sum(
                (project(part.force, 1) for part in self._sample(values, size * factor, phase)[: len(parts)]),
                np.zeros(1, complex),
            )
            for factor in (1 + _STEP, 1 - _STEP)
        )
        return np.asarray((high - low) / (2 * _STEP))


def _sine(omega: Array, fundamental: ComplexArray, samples: int) -> Waves:
    """One period of sines (n,) [m]."""
    return Motion(omega, np.stack([np.zeros_like(fundamental), fundamental], axis=1)).waveforms(samples)


def _plus(motion: Waves, other: Waves, times: float) -> Waves:
    """Sum of two motions, the second ``times`` as large."""
    x, v, a = (one + times * two for one, two in zip(motion, other, strict=True))
    return x, v, a


def _per_metre(motion: Motion, fundamental: NDArray[np.complex128]) -> Motion:
    """The motion for a response of phase zero and amplitude 1 m."""
    return Motion(
        motion.omega, motion.turned(-np.angle(fundamental)).harmonics / np.abs(fundamental)[:, None]
    )


def _times(waves: Waves, size: Array) -> Waves:
    x, v, a = waves
    return x * size[:, None], v * size[:, None], a * size[:, None]
