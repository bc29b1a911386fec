"""Balance of forces at the lines of periodic records, and the noise of that balance.

With F_h and X_h the force and the displacement at line h, omega0 the base frequency of the record, m the
mass and N_h(p) the spectrum of the law n(x, v; p) along the measured mean motion, the balance of line h is

    e_h = F_h - m (i h omega0)^2 X_h - N_h(p).

With a background the sensor sees Y = X + B F, and X is what is left of it. The balance
is linear in m and in most p, and no equation of motion has to be solved for it. Noise of the measured
motion enters N nonlinearly, so three quantities are estimated from the P single periods of a record:

* the variance of e_h, from its scatter between periods: noise of force and of response with the weight that
  the law gives them;
* the bias of N along a noisy motion, O(noise^2): along the mean of P periods it is a P-th of the bias along
  one period, so that (mean of N(x_p) - N(mean x))/(P - 1) is subtracted (the jackknife estimate of bias,
  Quenouille, Biometrika 43, 1956);
* the covariance of the slopes de_h/dp with e_h, which biases plain least squares (errors in variables:
  Fuller, Measurement Error Models, Wiley 1987).

Lines that the record does not give are computed from the law by fixed-point iteration (``_solve_lines``):

    X_h  ->  X_h + (F_h - m s^2 X_h - N_h)/(m s^2 + c s + k),    s = i h omega0,    k, c the mean slopes.

Computed are lines below the lowest and above the highest one at which noise does not hide the response,
those above the record included. Of the high ones only those whose inertia m |s|^2 is more than three times
the largest stiffness of the law: nearer to the resonance the iteration diverges, and they keep the record,
or are zero above it. With a motion across two sensors no low line is computed (``select_lines``).

* It stops where all lines change by less than ``HARMONIC_TRUNCATION`` of the record, at a change that is not
  smaller than the last one (and is not made), or after ``MAX_TRIAL_STEPS``.
* Noise reaches neither the velocity nor, where displacements are accelerations over omega^2, the lowest
  lines, and a law with corners and jumps gets a motion with all its lines.
* The balance that remains at a computed line is the inertia of the difference between the record and the
  motion of the law.
* The mean of a motion whose sensor has none is computed from the law by Newton's method (``_balance_mean``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import HARMONIC_TRUNCATION, MAX_NEWTON_STEPS, MAX_TRIAL_STEPS, ROUND_OFF
from rsgen.data.multisine.spectra import MultisineSpectra, scatter, smooth
from rsgen.data.oscillator import Model
from rsgen.dynamics.linear_part import BackgroundTerms, background_of_lines
from rsgen.dynamics.periodic_response import OVERSAMPLED
from rsgen.law.motion import Motion, harmonics_of, waveform
from rsgen.law.normal_form import ForceSample, Perturbation
from rsgen.law.numeric import ForceLaw, Waves

_EXTENSION_BY_SWITCHES, _MAX_LINES = 16, 16384
"""Lines of the motion along a law with switches, relative to those recorded, and their maximum. The error of
the velocity at a jump falls with their number."""

_MIN_INERTIA_TO_STIFFNESS = 3.0
"""The fixed-point iteration of a line above the highest clear one converges by this ratio a step."""


@dataclass(frozen=True, slots=True, eq=False)
class SpectralLines:
    """Records, and the lines at which their balance is fitted.

    Parameters
    ----------
    spectra
        The records that take part.
    used
        (r, H+1) lines of each record at which the balance is fitted.
    samples
        Samples a period along which the law is evaluated.
    lowest, highest
        (r,) lowest and highest line of each record whose response is taken from the record.
    extended
        Highest line of the motions along which the law is evaluated.
    background
        Terms of the background at all lines.
    subtracted
        (b,) values of the background that ``spectra`` are without; see ``mode``.
    far
        (r, p, H+1) the motion across two sensors less the share of the response in it [m]; None where all
        elements follow the response.
    weighed
        Mass and its standard error [kg], where it was weighed; None where it was not.
    """

    spectra: MultisineSpectra
    used: NDArray[np.bool_]
    samples: int
    lowest: NDArray[np.intp]
    highest: NDArray[np.intp]
    extended: int
    background: BackgroundTerms
    subtracted: Array
    far: ComplexArray | None = None
    weighed: tuple[float, float] | None = None

    def __len__(self) -> int:
        return len(self.spectra)

    @property
    def rate(self) -> ComplexArray:
        """Angular frequency i h omega0 (r, H+1) of each line [rad/s]."""
        return np.asarray(1j * self.spectra.omega)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency of the used lines [Hz]."""
        used = self.spectra.omega[self.used] / (2 * np.pi)
        return float(used.min()), float(used.max())

    def mode(self, values: Array) -> SpectralLines:
        """Return measured lines without a background of values (b,)."""
        if not len(values):
            return self
        return replace(self, spectra=self.background.mode_of(self.spectra, values), subtracted=values)

    def scaled(self, force: float, response: float) -> SpectralLines:
        """Return the lines with factors of their force and response."""
        own = self.spectra
        return replace(self, spectra=replace(own, force=force * own.force, response=response * own.response))

    def up_to(self, extended: int) -> SpectralLines:
        """Return the same lines along motions of another highest line, sampled as finely as that needs."""
        return replace(self, extended=extended, samples=_samples_of(extended))

    def change_of_mode(self, record: int, force: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return the change (b, H+1) of force and motion of the mode under a force by the background."""
        driven = np.where(self.spectra.lines > 0, force, 0)
        place = np.arange(record * len(driven), (record + 1) * len(driven))
        motion = -self.background.select(place).slopes_by_force(self.subtracted).T * driven
        force_change = np.zeros_like(motion)
        force_change[:1] = 1j * driven
        return force_change, motion

    def law_of(self, law: ForceLaw, record: int, period: int | None = None) -> ForceLaw:
        """Return a law along the response with the far motion of a period; None: of their mean."""
        return law if self.far is None else law.with_far(self.far_waves(record, period))

    def far_waves(self, record: int, period: int | None = None) -> Waves:
        """Return the waveforms (1, s) of the far motion of a record; see ``law_of``."""
        far = cast(ComplexArray, self.far)[record]
        lines = far.mean(axis=0) if period is None else far[period]
        return Motion(self.spectra.omega[record, 1:2], lines[None]).waveforms(self.samples)

    def power(self, mass: float) -> Array:
        """Return the power |F|^2 + |m omega^2 X|^2 (r, H+1) [N^2], smoothed over neighbouring lines."""
        force, response = self.spectra.mean_force, self.spectra.mean_response
        power = np.abs(force) ** 2 + np.abs(mass * self.rate**2 * response) ** 2
        return np.stack([np.maximum(smooth(row), ROUND_OFF * row.max()) for row in power])


def select_lines(
    spectra: MultisineSpectra, model: Model, *, switched: bool, share: float = 1.0
) -> SpectralLines:
    """Select the lines of the band, or those up to the highest excited one; never line zero, the mean.

    ``share`` is how much of the response is in the motion across. No law gives the motion of a second sensor:
    the lowest lines that noise hides are no part of it.
    """
    band = model.observation.band
    low, high = band or (0.0, np.inf)
    frequency = spectra.omega / (2 * np.pi)
    used = (frequency >= low) & (frequency <= high) & (spectra.lines > 0) & spectra.recorded
    if band is None:
        last_excited = [np.flatnonzero(row)[-1] if row.any() else 0 for row in spectra.excited()]
        used &= spectra.lines <= np.array(last_excited)[:, None]
    recorded = len(spectra.lines) - 1
    extended = max(recorded, min(_EXTENSION_BY_SWITCHES * recorded, _MAX_LINES)) if switched else recorded
    samples = _samples_of(extended)
    (lowest, highest), far = spectra.reach(), spectra.far(share)
    if far is not None:
        hidden = spectra.lines < lowest[:, None]
        used &= ~hidden
        unseen = (hidden & (spectra.lines > 0))[:, None]
        spectra = replace(spectra, response=np.where(unseen, 0, spectra.response))
        lowest = np.ones_like(lowest)
    driven = used & spectra.excited()
    # no line at all is refused where parameters are counted
    fitted = frequency[driven] if driven.any() else frequency[:, 1:]
    ends = float(fitted.min()), float(fitted.max())
    background = background_of_lines(model.observation.background, spectra, ends)
    reach = samples, lowest, highest, extended
    none = np.zeros(len(background.names))
    return SpectralLines(spectra, used, *reach, background, none, far, model.weighed)


def _samples_of(extended: int) -> int:
    """Return the samples a period along which a law is evaluated, of motions up to a line."""
    return 1 << (OVERSAMPLED * (extended + 1) - 1).bit_length()


@dataclass(frozen=True, slots=True, eq=False)
class BalanceNoise:
    """Noise of the balance, estimated from the scatter of the single periods.

    Parameters
    ----------
    values
        (p,) values of the law at which it was estimated.
    variance
        (r, H+1) variance of the balance of the mean period [N^2]; NaN where there is one period.
    weight_shape
        (r, H+1) variance [N^2] that the linearised law expects, up to a factor: powers of neighbouring lines
        are divided by it before they are averaged.
    bias
        (r, H+1) bias of the force of the law at ``values`` [N].
    bias_by_parameter
        (r, p, H+1) derivative of the bias by the values.
    cross_covariance
        (r, q, H+1) real part of the covariance of the slopes, those of ``Balance``, with the balance of the
        mean period.
    deviation
        (r, P, H+1) balance of each period minus the mean of the periods [N].
    """

    values: Array
    variance: Array
    weight_shape: Array
    bias: ComplexArray
    bias_by_parameter: ComplexArray
    cross_covariance: Array
    deviation: ComplexArray

    @classmethod
    def unknown(cls, lines: SpectralLines, parameters: int) -> BalanceNoise:
        """Return no bias, no covariance and variances of NaN for a law with so many parameters."""
        shape = lines.used.shape
        return cls(
            np.zeros(parameters),
            np.full(shape, np.nan),
            np.ones(shape),
            np.zeros(shape, dtype=complex),
            np.zeros((shape[0], parameters, shape[1]), dtype=complex),
            np.zeros((shape[0], parameters + 1 + len(lines.subtracted), shape[1])),
            np.zeros(lines.spectra.force.shape, dtype=complex),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """The balance of all records at values of the law and a mass.

    Parameters
    ----------
    residual
        (r, H+1) F - m (i h omega0)^2 X - (N - bias) [N], the bias of ``BalanceNoise``.
    slopes
        (r, q, H+1) minus its derivatives by the values of the law, the mass, and the background.
    """

    residual: ComplexArray
    slopes: ComplexArray

    @classmethod
    def of(
        cls, lines: SpectralLines, law: ForceLaw, values: Array, mass: float, noise: BalanceNoise
    ) -> Balance:
        """Evaluate the law along the mean motion of every record."""
        parts = [record.mean for record in along_records(lines, law, values.tobytes(), mass)]
        bias = noise.bias + np.einsum("rph,p->rh", noise.bias_by_parameter, values - noise.values)
        slopes = np.stack([part.slopes for part in parts])
        slopes[:, : len(values)] -= noise.bias_by_parameter
        return cls(np.stack([part.balance for part in parts]) + bias, slopes)

    @staticmethod
    def damping(lines: SpectralLines, law: ForceLaw, values: Array, mass: float) -> Array:
        """Return the power of n(x, v) - n(x, 0) (r, H+1) [N^2]; NaN for a law with memory."""
        if law.remembers:
            return np.full(lines.used.shape, np.nan)
        forces = [record.damping_force() for record in along_records(lines, law, values.tobytes(), mass)]
        return np.asarray(np.abs(np.stack(forces)) ** 2)

    @staticmethod
    def zeros(lines: SpectralLines, law: ForceLaw, values: Array, mass: float) -> Array:
        """Return the recorded means (r,) [m] less those of the motions along which the law is."""
        records = along_records(lines, law, values.tobytes(), mass)
        means = np.array([record.mean.trajectory[0].mean() for record in records])
        return np.asarray(lines.spectra.mean_response[:, 0].real - means)

    @staticmethod
    def noise(lines: SpectralLines, law: ForceLaw, values: Array, mass: float) -> BalanceNoise:
        """Evaluate the law along every period: variance of the balance, bias of the law, covariance."""
        spectra = lines.spectra
        count = spectra.periods
        found = BalanceNoise.unknown(lines, len(values))
        if count < 2:
            return found
        found.values[:] = values
        for i, record in enumerate(along_records(lines, law, values.tobytes(), mass)):
            pairs = enumerate(zip(spectra.force[i], spectra.response[i], strict=True))
            periods = [record.period(*pair, lines.law_of(law, i, period)) for period, pair in pairs]
            balance = np.stack([period.balance for period in periods])
            slopes = np.stack([period.slopes for period in periods])
            if not spectra.exact[i]:
                found.weight_shape[i] = record.expected_variance(*(part[i] ** 2 for part in spectra.noise()))
            # force and inertia are linear: what differs from the balance of the mean is the law's
            found.bias[i] = (record.mean.balance - balance.mean(axis=0)) / (count - 1)
            by_law = (slopes.mean(axis=0) - record.mean.slopes)[: len(values)]
            found.bias_by_parameter[i] = by_law / (count - 1)
            columns = np.conj(slopes - slopes.mean(axis=0))
            found.deviation[i] = balance - balance.mean(axis=0)
            products = (columns * found.deviation[i][:, None]).real
            found.cross_covariance[i] = np.sum(products, axis=0) / (count - 1) / count
        shape = found.weight_shape
        found.variance[:] = scatter(found.deviation / np.sqrt(shape[:, None])) * shape
        return found


@dataclass(frozen=True, slots=True, eq=False)
class LawSpectra:
    """A law along one motion.

    Parameters
    ----------
    balance, slopes
        (H+1,) [N] and (q, H+1), as of ``Balance``.
    trajectory
        x, v, a (1, s), and their sampling interval [s].
    by_x, by_v
        (s,) slopes of the law.
    dynamic
        (extended + 1,) dynamic stiffness m s^2 + c s + k [N/m] with the mean slopes k and c.
    """

    balance: ComplexArray
    slopes: ComplexArray
    trajectory: tuple[Array, Array, Array, Array]
    by_x: Array
    by_v: Array
    dynamic: ComplexArray


class LawAlongRecord:
    """The law along the motions of one record: its mean motion, and the motion of each period.

    With s = i h omega0 the lines X_h that the record does not give are those of

        (m s^2 + c s + k) dX_h = F_h - m s^2 X_h - N_h(X),    k, c the mean slopes of the law,

    below the lowest clear line and above the highest one, those above the record included: the balance is
    repeated with X + dX until X no longer changes (``_solve_lines``, on construction). ``mean`` is the law
    along this motion. Computed lines of a period are those of the mean motion, the low ones plus the response
    of the linearised law to the difference of the two forces. The slopes of the balance contain what a
    parameter moves of the low computed lines and of the mean (``_motion_slopes``, ``_with_mean``).
    """

    def __init__(self, lines: SpectralLines, law: ForceLaw, values: Array, mass: float, record: int) -> None:
        self._lines, self._law, self._values = lines, lines.law_of(law, record), values
        self._mass, self._record = mass, record
        self._force = lines.spectra.mean_force[record]
        self._response = lines.spectra.mean_response[record]
        orders = np.arange(lines.extended + 1)
        self._base = lines.spectra.omega[record, 1:2]
        self._rate = 1j * orders * self._base
        self._low = (orders > 0) & (orders < lines.lowest[record]) & (mass > 0)
        self._high = orders > lines.highest[record]
        self._measured = ~(self._low | self._high)[: len(self._response)]
        self._computed = self._solve_lines()
        self.mean = self._evaluate(self._force, self._response, self._computed, self._law)

    def _dynamic_stiffness(self, sample: ForceSample) -> ComplexArray:
        """Return m s^2 + c s + k (extended + 1,) [N/m] with the mean slopes k and c of the law."""
        stiffness, damping = float(np.mean(sample.by_x)), float(np.mean(sample.by_v))
        return np.asarray(self._mass * self._rate**2 + damping * self._rate + stiffness)

    def _solve_lines(self) -> ComplexArray:
        """Iterate to the lines (extended + 1,) [m] of the mean motion that the record does not give."""
        count, low, high = len(self._response), self._low, self._high
        drive, found = np.zeros((2, len(low)), dtype=complex)
        drive[:count] = self._force
        if not (low.any() or high.any()) or not self._mass > 0:
            found[:count] = np.where(high[:count], self._response, 0)
            return found
        inertia = self._mass * self._rate**2
        before = float("inf")
        for _ in range(MAX_TRIAL_STEPS):
            x, v, a, step = self._waves(self._motion(self._response, found))
            sample = self._law.sample(x, v, a, step, self._values)
            stiffness = float(np.max(np.abs(sample.by_x)))
            solved = low | (high & (np.abs(inertia) > _MIN_INERTIA_TO_STIFFNESS * stiffness))
            balance = drive - inertia * found - self._spectrum(np.broadcast_to(sample.force, x.shape))[0]
            dynamic = np.where(solved, self._dynamic_stiffness(sample), 1)
            moved = np.where(solved, found + balance / dynamic, 0)
            # near the resonance the iteration diverges: the noisy record is the better estimate there
            moved[:count] = np.where(high[:count] & ~solved[:count], self._response, moved[:count])
            change = float(np.linalg.norm(moved - found))
            if not change < before:
                break
            found, before = moved, change
            if change < HARMONIC_TRUNCATION * float(np.linalg.norm(self._response)):
                break
        return found

    def expected_variance(self, force: Array, response: Array) -> Array:
        """Return the variance (H+1,) of the balance of the linearised law.

        ``force`` [N^2] and ``response`` [m^2] are the variances (H+1,) of the two channels.
        """
        count = len(self._response)
        low, inertia = self._low[:count], self._mass * self._rate[:count] ** 2
        # at a computed line the motion follows the force: m s^2 / (m s^2 + c s + k) of it stays in the
        # balance
        dynamic = np.where(low, inertia, self.mean.dynamic[:count])
        share = np.where(low, inertia / self.mean.dynamic[:count], 1)
        power = np.abs(share) ** 2 * force + np.abs(dynamic) ** 2 * response
        return np.asarray(np.maximum(power, ROUND_OFF * float(power.max()) or 1.0))

    def period(self, force: ComplexArray, response: ComplexArray, law: ForceLaw) -> LawSpectra:
        """Evaluate the law of a period along its motion, of lines (H+1,) [N] and [m]."""
        count, computed = len(response), np.array(self._computed)
        low = self._low[:count]
        computed[:count][low] += ((force - self._force) / self.mean.dynamic[:count])[low]
        return self._evaluate(force, response, computed, law)

    def lines_of(self, forces: Array) -> ComplexArray:
        """Return the lines (n, H+1) [N] that forces (n, s) along the mean motion add to the balance.

        They move the lines of the motion that follow from the law, which the linearised law answers.
        """
        by_x, by_v = self.mean.by_x, self.mean.by_v
        forces = self._with_mean(forces, by_x)
        if self._low.any():
            change = self._motion_slopes(self._spectrum(forces), by_x, by_v, self.mean.dynamic)
            forces = forces + change
        return self._spectrum(forces)[:, : len(self._response)]

    def damping_force(self) -> ComplexArray:
        """Return n(x, v) - n(x, 0) (H+1,) [N] along the mean motion, for a law without memory."""
        x, v, a, step = self.mean.trajectory
        moving, still = (self._law.sample(x, rate, a, step, self._values).force for rate in (v, 0 * v))
        return self._spectrum(np.broadcast_to(moving - still, x.shape))[0, : len(self._response)]

    def _evaluate(
        self, force: ComplexArray, response: ComplexArray, computed: ComplexArray, law: ForceLaw
    ) -> LawSpectra:
        """Evaluate a law along a motion."""
        lines, values, count = self._lines, self._values, len(response)
        motion = self._motion(response, computed)
        x, v, a, step = self._waves(motion)
        sample = law.sample(x, v, a, step, values)
        by_x, by_v = (np.broadcast_to(part, x.shape)[0] for part in (sample.by_x, sample.by_v))
        force_change, motion_change = lines.change_of_mode(self._record, force)
        # rows: values of the law, mass, background. ``columns`` (samples) is what each does through the law,
        # ``direct`` (lines) what it does to the balance without it: slopes = spectrum(columns) - direct
        direct = np.zeros((len(values) + 1 + len(motion_change), count), dtype=complex)
        direct[len(values)] = -(self._rate[:count] ** 2) * response
        direct[len(values) + 1 :] = force_change - self._mass * self._rate[:count] ** 2 * motion_change
        columns = np.zeros((len(direct), lines.samples))
        for column, part in zip(columns, sample.by_parameter, strict=False):
            column[:] = np.broadcast_to(part, x.shape)[0]
        if len(motion_change):
            measured = np.zeros((len(motion_change), len(motion)), dtype=complex)
            measured[:, :count][:, self._measured] = motion_change[:, self._measured]
            columns[len(values) + 1 :] = self._by_motion(measured, by_x, by_v, sample.by_memory)
        columns = self._with_mean(columns, by_x)
        dynamic = self._dynamic_stiffness(sample)
        if self._low.any():
            change = self._spectrum(columns)
            change[len(values)] += self._rate**2 * motion
            change[len(values) + 1 :, :count] -= force_change
            columns = columns + self._motion_slopes(change, by_x, by_v, dynamic)
        spectra = self._spectrum(np.concatenate([np.broadcast_to(sample.force, x.shape), columns]))
        balance = force - self._mass * self._rate[:count] ** 2 * response - spectra[0, :count]
        slopes = spectra[1:, :count] - direct
        return LawSpectra(balance, slopes, (x, v, a, step), by_x, by_v, dynamic)

    def _with_mean(self, columns: Array, by_x: Array) -> Array:
        """Add what the mean displacement, where the law gives it, answers to forces (n, s)."""
        if self._lines.spectra.mean_known or not self._law.springs or not (stiffness := float(by_x.mean())):
            return columns
        return np.asarray(columns - by_x * columns.mean(axis=1, keepdims=True) / stiffness)

    def _motion(self, response: ComplexArray, computed: ComplexArray) -> ComplexArray:
        """Return the lines (extended + 1,) [m] of a motion: measured ones, and computed ones."""
        motion = np.array(computed)
        motion[: len(response)][self._measured] = response[self._measured]
        return motion

    def _waves(self, motion: ComplexArray) -> tuple[Array, Array, Array, Array]:
        """Return x, v, a (1, s) of a motion, and their sampling interval [s]."""
        lines, waves = self._lines, Motion(self._base, motion[None])
        x, v, a = waves.waveforms(lines.samples)
        step = waves.interval(lines.samples)
        if not lines.spectra.mean_known:
            x = _balance_mean(self._law, x - float(motion[0].real), v, a, step, self._values)
        return x, v, a, step

    def _motion_slopes(self, balance: ComplexArray, by_x: Array, by_v: Array, dynamic: ComplexArray) -> Array:
        """Return the forces (n, s) by the motion at low lines, which changes of the balance there move.

        ``balance`` holds (n, extended + 1) lines. One step of the fixed-point iteration: further steps, and
        the memory that ``dynamic`` is without, change less than noise does.
        """
        return self._by_motion(np.where(self._low, -balance / dynamic, 0), by_x, by_v)

    def _by_motion(
        self,
        change: ComplexArray,
        by_x: Array,
        by_v: Array,
        by_memory: Sequence[tuple[Array, Perturbation]] = (),
    ) -> Array:
        """Return the forces (n, s) by a change (n, extended + 1) of the motion."""
        x, v = (waveform(part, self._lines.samples) for part in (change, change * self._rate))
        found = by_x * x + by_v * v
        for slope, perturbation in by_memory:
            found += np.sum(slope[:, 0, None] * perturbation(x, v[None])[:, 0], axis=0)
        return np.asarray(found)

    def _spectrum(self, waves: Array) -> ComplexArray:
        """Return the lines (n, extended + 1) of signals (n, s)."""
        return harmonics_of(waves, self._lines.extended + 1)


def _balance_mean(law: ForceLaw, x: Array, v: Array, a: Array, step: Array, values: Array) -> Array:
    """Shift a motion (1, s) by Newton's method until the mean force of the law vanishes."""
    mean = 0.0
    for _ in range(MAX_NEWTON_STEPS if law.springs and not law.odd else 0):
        sample = law.sample(x + mean, v, a, step, values)
        slope = float(np.mean(sample.by_x))
        move = -float(np.mean(sample.force)) / slope if slope else 0.0
        limit = float(np.ptp(x))
        mean += min(max(move, -limit), limit)
        if abs(move) < ROUND_OFF * limit:
            break
    return x + mean


@lru_cache(maxsize=2)
def along_records(
    lines: SpectralLines, law: ForceLaw, values: bytes, mass: float
) -> tuple[LawAlongRecord, ...]:
    """Return the law along every record; balance, noise and the next step ask for it at the same values."""
    numbers = np.frombuffer(values)
    return tuple(LawAlongRecord(lines, law, numbers, mass, record) for record in range(len(lines)))
