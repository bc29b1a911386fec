"""Laws between two sensors, and their forward model along the measured motions.

With x the response, y the motion of a second sensor and z = x - y the motion across an element, the balance
at the sensor of the response is

    F = -m omega^2 x_1 + N(x)_1 + N_a(z)_1.

Other modes contribute to x and y, so that no law predicts y from x: y was measured, with noise like x and F,
and is an unknown of every point as these are (errors in variables: Fuller, Measurement Error Models, Wiley
1987). If z has a sensor of its own, z has that noise instead; the name of the elements' sensors says which
(``law.element.response_share``). The misfit of a wrong law is no noise of one sensor: it changes the force
and both motions, and the ratio of the motions stays as measured. A background is seen by the response
alone: x is the motion without it, and so is z where it is the difference of x and y.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import MISFIT_NEGLIGIBLE, NOISE_RATIO_BY_CHANCE, samples_for
from rsgen.data.oscillator import total_force
from rsgen.dynamics.harmonic_balance import Response
from rsgen.identification.fitting.forward import Forward
from rsgen.identification.fitting.points import Points
from rsgen.law.element import Element, forces_by_motion, response_share
from rsgen.law.motion import Motion, fourier_series, project
from rsgen.law.numeric import ForceLaw, Part, compile_law

_MOTIONS = ("response", "motion across {!r}")
"""Motions of the parts of a law in messages."""

_UNMATCHED = (
    "across: the test has a motion across two sensors, but no element follows it; say which ones do "
    '(across = "..." of the element)',
    "across: an element acts across {}; the test has no motion across",
    "across: {}; one pair of sensors is allowed in a law",
)
"""Messages for elements between no, one or several pairs of sensors, if the motions of the test differ."""

_CUBIC_HALF_WIDTH = 2
"""Neighbours on each side through which a cubic is laid."""


def sensor_noise(points: Points, sensors: str) -> float:
    """Estimate the relative noise of response and second sensor from the roughness of a run; NaN if unknown.

    The ratio z/x of the motion across to the response is smooth for any law: its difference from a cubic
    through its neighbours is noise. If z was measured, that noise is proportional to z/x; if y was measured,
    to y/x = 1 - z/x.
    """
    order = np.lexsort((points.omega, points.sweep, points.level))
    width = 2 * _CUBIC_HALF_WIDTH + 1
    if len(order) < width:
        return float("nan")
    rows = np.lib.stride_tricks.sliding_window_view(order, width)
    rows = rows[(points.level[rows] == points.level[rows[:, :1]]).all(axis=1)]
    rows = rows[(points.sweep[rows] == points.sweep[rows[:, :1]]).all(axis=1)]
    rows = rows[(np.diff(points.omega[rows], axis=1) > 0).all(axis=1)]
    if len(rows) < width:
        return float("nan")
    weights = _cubic(points.omega[rows])
    ratio = points.across[:, 1] / points.harmonics[:, 1]
    missed = np.abs(np.sum(weights * ratio[rows], axis=1)) ** 2
    size = np.sum(weights**2 * 2 * np.abs(response_share(sensors) - ratio[rows]) ** 2, axis=1)
    moves = size > 0
    if not moves.any():
        return float("nan")
    # the square of a complex normal number of unit variance has the median ln 2
    return float(np.sqrt(np.median(missed[moves] / size[moves]) / np.log(2)))


def misfit_of_joint(points: Points, sensors: str) -> float:
    """Return the systematic misfit from which on a law across two sensors is doubtful: beyond their noise.

    A misfit relative to the response is larger relative to the motion across, and moves the joint by more.
    """
    smaller = float(np.median(np.abs(points.far[:, 0] / points.harmonics[:, 1])))
    beyond = NOISE_RATIO_BY_CHANCE * np.nan_to_num(sensor_noise(points, sensors))
    return float(max(beyond, MISFIT_NEGLIGIBLE * min(smaller, 1.0)))


def _cubic(omega: Array) -> Array:
    """Return weights (n, 2 b + 1): one for the middle point, minus the cubic through the others."""
    weights = np.ones_like(omega)
    others = [i for i in range(omega.shape[1]) if i != _CUBIC_HALF_WIDTH]
    for i in others:
        for j in others:
            if i != j:
                weights[:, i] *= (omega[:, _CUBIC_HALF_WIDTH] - omega[:, j]) / (omega[:, i] - omega[:, j])
        weights[:, i] *= -1
    return weights


def law_of(
    elements: Sequence[Element],
    means: Sequence[bool] | None = None,
    asymmetric: tuple[bool, bool] = (False, False),
) -> ForceLaw:
    """Compile the law of some elements, in parts by motion.

    Parameters
    ----------
    elements
        All elements of the model.
    means
        Whether the mean was recorded, of the response and of the motion across two sensors if the test has
        one; None: nothing is to be fitted.
    asymmetric
        ``Points.asymmetric``: by the mean or the second harmonic, and by the second harmonic alone.

    Raises
    ------
    RsgenError
        Elements act across two sensors and the motion across is not in the test, or the other way round; they
        act across several; or a law is not odd and the mean across was not recorded.
    """
    total = compile_law(total_force(elements))
    forces = forces_by_motion(elements)
    if means is not None:
        sensors_of(elements, len(means) - 1)
    if len(forces) == 1:
        # an odd law has asymmetric motions, too: in one well of two, or after symmetry breaking;
        # the mean of a slider that sticks is where it came to rest
        return replace(total, odd=False) if total.odd and asymmetric[total.remembers] else total
    parts = []
    for motion, (sensors, force) in enumerate(forces.items()):
        law = compile_law(force)
        if means is not None and not (law.odd or means[motion]):
            followed = _MOTIONS[motion].format(sensors)
            raise RsgenError(
                f"across: the elements that follow the {followed} are not odd, and the mean of that motion "
                "was not recorded; displacements with their mean, or an odd law, are needed"
            )
        lost = ", ".join(name for name in law.parameters if name not in total.parameters)
        if lost:
            raise RsgenError(
                f"across: {lost}: cancels in the sum of the elements; give it another name in the elements "
                "that act across"
            )
        places = np.array([total.parameters.index(name) for name in law.parameters], dtype=np.intp)
        parts.append(Part(law, places, sensors, response_share(sensors)))
    # the means of both motions were measured: there is no even part to compute
    return replace(total, odd=True, even=(), _parts=tuple(parts))


def sensors_of(elements: Iterable[Element], pairs: int) -> str:
    """Return the pair of sensors between which elements act, "" without one.

    Raises
    ------
    RsgenError
        It is not the number of ``pairs`` between which the test has a motion.
    """
    sensors = sorted({element.across for element in elements} - {""})
    if len(sensors) != pairs:
        raise RsgenError(_UNMATCHED[min(len(sensors), 2)].format(", ".join(map(repr, sensors))))
    return sensors[0] if sensors else ""


def motions_of(law: ForceLaw, followed: Motion, points: Points) -> tuple[Motion, ...]:
    """Return the motions of the parts of a law: measured ones for two parts, ``followed`` for one."""
    return (points.motion, Motion(points.omega, points.across)) if law.acts_across else (followed,)


def across_of_mode(
    seen: ComplexArray, across: ComplexArray, mode: ComplexArray, sensors: str
) -> ComplexArray:
    """Return the motion across sensors (n, H+1) [m] without what a background adds to the response.

    Parameters
    ----------
    seen, across
        Measured harmonics (n, H+1) of the response and across the sensors [m].
    mode
        Those of the response without its background [m].
    sensors
        Name of the pair of sensors.
    """
    moved = np.array(across)
    moved[:, 1] -= response_share(sensors) * (seen - mode)[:, 1]
    return moved


class MeasuredAcross(Forward):
    """Force at the response from a law across two sensors.

    The fundamentals of response and second sensor are arguments, all other harmonics as measured.

    Parameters
    ----------
    law
        The force law, of two parts.
    response, across
        Measured motions of the mode and across the elements, at the same points.
    """

    correlation = 0.0
    """Correlation of the relative deviations of the two sensors: 0 for noise, nearly 1 for misfit of the law.
    """

    def __init__(self, law: ForceLaw, response: Motion, across: Motion) -> None:
        self._law, self._response, self._across = law, response, across
        self._response_share = law.parts[1].share
        self._columns = max(response.harmonics.shape[1], across.harmonics.shape[1])
        least = 1 << (8 * (self._columns - 1) - 1).bit_length()
        self.samples = max(samples_for(law.switched), least)
        self._series = fourier_series((1,), self.samples, half=False)

    def of_sensors(self, influence: Array) -> Array:
        """Return the influence of the deviations of each sensor; those of the second sensor are the last."""
        moved, half = np.array(influence), (influence.shape[1] + 1) // 2
        moved[:, [half - 1, -1]] /= self.far_noise
        moved[:, [1, half + 1]] -= self.correlation * moved[:, [half - 1, -1]]
        return moved

    @property
    def far_noise(self) -> float:
        """Independent share of the deviation of the second sensor."""
        return float(np.sqrt(1 - self.correlation**2))

    def _second_sensor(
        self, size: Array, others: Array | None
    ) -> tuple[Array, Array, ComplexArray, ComplexArray]:
        """Return the phase of the response, the scale of its harmonics, and the motion of the second sensor
        without and with a deviation of its own; arguments as of a call.
        """
        measured = self._response.harmonics[:, 1]
        other = self._across.harmonics[:, 1] - self._response_share * measured
        share, phase = size / np.abs(measured), np.angle(measured)
        if others is None:
            return phase, share[:, None], other, other * share
        moved = np.log(share) + 1j * (others[:, 0] - phase)
        other = other * np.exp(self.correlation * moved)
        there = other * (1 + self.far_noise * (others[:, 1] + 1j * others[:, 2]))
        return others[:, 0], np.ones((1, 1)), other, there

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Evaluate the balance.

        Parameters
        ----------
        values, mass
            (p,) of the law, m [kg].
        size
            (n,) amplitudes of the response [m].
        others
            (n, 3) phase of the response [rad], and real and imaginary part of the relative deviation of the
            second sensor in units of ``far_noise``. None: the second sensor, and all harmonics, keep their
            measured ratio to the response.
        """
        omega = self._response.omega
        phase, own, other, there = self._second_sensor(size, others)
        here, back = size * np.exp(1j * phase), np.exp(-1j * phase)
        followed = (
            _with_fundamental(self._response, own, here),
            _with_fundamental(self._across, own, self._response_share * here + there),
        )
        waves = [motion.waveforms(self.samples) for motion in followed]
        samples = self._law.sample_parts(waves, self._response.interval(self.samples), values)
        near, joint = (sample.tangent(self._series, omega) for sample in samples)

        def by_response(turn: complex) -> ComplexArray:
            """Return the derivative of the force by the logarithm of the response, with the second sensor."""
            change, far = turn * here, self.correlation * turn * there
            across = _times(joint, self._response_share * change + far)
            return np.asarray(back * (_times(near, change) + across - mass * omega**2 * change))

        force = back * sum(project(sample.force, 1) for sample in samples) - mass * omega**2 * size
        columns = [
            back * sum(project(part, 1) for part in parts)
            for parts in zip(*(sample.by_parameter for sample in samples), strict=True)
        ]
        far = [back * _times(joint, part * self.far_noise * other) for part in (1, 1j)]
        return Response.at_amplitude(
            size,
            force,
            by_response(1),
            np.stack([*columns, -(omega**2) * size + 0j], axis=1),
            self._columns - 1,
            force_phase=by_response(1j) - 1j * force,
            force_far=np.stack(far, axis=1),
            across=followed[1].turned(np.angle(back)).harmonics,
        )


def _with_fundamental(motion: Motion, share: Array, fundamental: ComplexArray) -> Motion:
    """Scale all harmonics by a factor (n, 1), and set the fundamental (n,) [m]."""
    harmonics = motion.harmonics * share
    harmonics[:, 1] = fundamental
    return Motion(motion.omega, harmonics)


def _times(tangent: Array, change: ComplexArray) -> ComplexArray:
    """Return the change (n,) of a force by that of a fundamental, from its real tangent (n, 2, 2)."""
    real, imaginary = (tangent[:, i, 0] * change.real + tangent[:, i, 1] * change.imag for i in range(2))
    return np.asarray(real + 1j * imaginary)
