"""The balance of forces at the lines of periodic records: F_h = m (i h omega0)^2 X_h + N_h(x; p) + noise.

The law is evaluated along the mean motion of each record. Three things come from the single periods: the
variance of the balance at each line, in which the noise of force and of response count as the law weighs
them; the O(noise^2) bias of the law along a noisy motion (along the mean of P periods it is a P-th of what it
is along one, so that (mean of N(x_p) - N(mean))/(P - 1) is left, the jackknife); and how the noise of the
slopes goes with that of the balance, which in plain least squares would bias the parameters (errors in
variables).

Lines in which the noise hides the response, and those above the record, are not taken from it: there the law
itself gives the motion by iteration, above with inertia, X_h = (F_h - N_h)/(m (i h omega0)^2), below with the
dynamic stiffness of its mean slopes. So noise reaches neither the velocity nor, as of accelerations divided
by omega^2, the lowest lines, and a law with corners and jumps sees a motion that has all its lines. What is
left of the balance at such lines is the inertia of how far the record is from the law's motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import ROUND_OFF, TAIL, TO_REST, TRIAL_STEPS
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.multisine.spectra import scatter, smooth
from rsgen.dynamics.periodic_response import OVERSAMPLED
from rsgen.law.motion import Motion, harmonics_of, waveform
from rsgen.law.numeric import ForceLaw
from rsgen.law.switched_sum import ForceSample

_EXTENDED, _MOST_LINES = 16, 16384
"""Times the recorded lines that a motion has along a law with switches, and most lines: the velocity at a
jump errs by the inverse of their number, which leaves a few 1e-6 of the force."""

_CLEAR = 3.0
"""Dynamic stiffness of a line, relative to the largest stiffness of the law, above which inertia rules there
and the iteration to the law's own motion shrinks its error threefold a step."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Records and the lines at which their balance is asked.

    Parameters
    ----------
    spectra
        The records that take part.
    used
        (r, H+1) lines of each record.
    samples
        A period, at which the law is evaluated.
    first, last
        (r,) lowest and highest line of each record between which the response is taken from it.
    extended
        Highest line of the motions along which the law is evaluated.
    """

    spectra: MultisineSpectra
    used: NDArray[np.bool_]
    samples: int
    first: NDArray[np.intp]
    last: NDArray[np.intp]
    extended: int

    def __len__(self) -> int:
        return len(self.spectra)

    @property
    def rate(self) -> ComplexArray:
        """(H+1,) i h omega0 [rad/s]."""
        return np.asarray(1j * self.spectra.lines * self.spectra.omega0)

    def scale(self, mass: float) -> Array:
        """(r, H+1) power of what the balance adds up at each line [N^2], over neighbouring lines."""
        force, response = self.spectra.mean_force, self.spectra.mean_response
        power = np.abs(force) ** 2 + np.abs(mass * self.rate**2 * response) ** 2
        return np.stack([np.maximum(smooth(one), ROUND_OFF * one.max()) for one in power])


def lines_of(spectra: MultisineSpectra, band: tuple[float, float] | None, *, switched: bool) -> Lines:
    """Choose the lines: those of the band, else from the first to the highest excited one; never the mean."""
    last = [np.flatnonzero(row)[-1] if row.any() else 0 for row in spectra.excited()]
    low, high = band or (0.0, np.inf)
    inside = (spectra.frequency >= low) & (spectra.frequency <= high) & (spectra.lines > 0)
    used = np.stack([inside & (spectra.lines <= (np.inf if band else end)) for end in last])
    recorded = len(spectra.lines) - 1
    extended = max(recorded, min(_EXTENDED * recorded, _MOST_LINES)) if switched else recorded
    samples = 1 << (OVERSAMPLED * (extended + 1) - 1).bit_length()
    first, seen = spectra.reach()
    return Lines(spectra, used, samples, first, seen, extended)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseOfBalance:
    """What the single periods say: variance (r, H+1) of the mean balance [N^2], and the bias of the law.

    ``bias`` (r, H+1) is that of the law's force at ``values`` (p,) [N], to be subtracted; ``by_parameter``
    (r, p, H+1) that of its slopes. ``together`` (r, p+1, H+1) is the covariance of the slopes, that by the
    mass last, with the balance, real part. A variance that one period does not show is NaN. ``shape``
    (r, H+1) is how the variance goes from line to line [N^2]: what of neighbouring lines is averaged is
    divided by it first. ``apart`` (r, P, H+1) is how far the balance of each period is from their mean [N].
    """

    values: Array
    variance: Array
    shape: Array
    bias: ComplexArray
    by_parameter: ComplexArray
    together: Array
    apart: ComplexArray

    @classmethod
    def unknown(cls, lines: Lines, parameters: int) -> NoiseOfBalance:
        """Nothing is known."""
        shape = lines.used.shape
        none = np.zeros(shape, dtype=complex)
        slopes = np.zeros((shape[0], parameters, shape[1]), dtype=complex)
        together = np.zeros((shape[0], parameters + 1, shape[1]))
        return cls(
            np.zeros(parameters),
            np.full(shape, np.nan),
            np.ones(shape),
            none,
            slopes,
            together,
            np.zeros(lines.spectra.force.shape, dtype=complex),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """The balance at values of the law and a mass.

    Parameters
    ----------
    residual
        (r, H+1) F - m (i h omega0)^2 X - N [N].
    by_parameter
        (r, p, H+1) dN/dp.
    by_mass
        (r, H+1) (i h omega0)^2 X, what the mass multiplies, and what the law's own motion adds to it.
    mean
        (r,) mean displacement, measured or found from the law [m].
    """

    residual: ComplexArray
    by_parameter: ComplexArray
    by_mass: ComplexArray
    mean: Array

    @classmethod
    def of(cls, lines: Lines, law: ForceLaw, values: Array, mass: float, noise: NoiseOfBalance) -> Balance:
        """Evaluate the law along the mean motion of every record."""
        spectra = lines.spectra
        parts = [
            _Along(lines, law, values, mass, i).mean(spectra.mean_force[i], spectra.mean_response[i])
            for i in range(len(lines))
        ]
        inertia = lines.rate**2 * spectra.mean_response
        bias = noise.bias + np.einsum("rph,p->rh", noise.by_parameter, values - noise.values)
        law_force = np.stack([part[0] for part in parts]) - bias
        slopes = np.stack([part[1] for part in parts])
        by_parameter, by_mass = slopes[:, :-1] - noise.by_parameter, slopes[:, -1] + inertia
        residual = spectra.mean_force - mass * inertia - law_force
        return cls(residual, by_parameter, by_mass, np.array([part[2] for part in parts]))

    @staticmethod
    def damping(lines: Lines, law: ForceLaw, values: Array, mass: float) -> Array:
        """(r, H+1) power of the force that goes with the velocity [N^2]; NaN of a law with memory."""
        if law.remembers:
            return np.full(lines.used.shape, np.nan)
        pairs = zip(lines.spectra.mean_force, lines.spectra.mean_response, strict=True)
        forces = [_Along(lines, law, values, mass, i).damping(*pair) for i, pair in enumerate(pairs)]
        return np.asarray(np.abs(np.stack(forces)) ** 2)

    def noise(self, lines: Lines, law: ForceLaw, values: Array, mass: float) -> NoiseOfBalance:
        """Evaluate the law along every period, for the variance of the balance and the bias of the law."""
        spectra = lines.spectra
        count = spectra.periods
        found = NoiseOfBalance.unknown(lines, len(values))
        if count < 2:
            return found
        found.values[:] = values
        for i in range(len(lines)):
            along = _Along(lines, law, values, mass, i)
            whole = along.mean(spectra.mean_force[i], spectra.mean_response[i])
            parts = [along.one(*each) for each in zip(spectra.force[i], spectra.response[i], strict=True)]
            forces = np.stack([part[0] for part in parts])
            balance = spectra.force[i] - mass * lines.rate**2 * spectra.response[i] - forces
            if not spectra.exact[i]:
                found.shape[i] = along.noise_shape(*(one[i] ** 2 for one in spectra.noise()))
            found.bias[i] = (forces.mean(axis=0) - whole[0]) / (count - 1)
            slopes = np.stack([part[1] for part in parts])
            found.by_parameter[i] = (slopes.mean(axis=0) - whole[1])[:-1] / (count - 1)
            slopes[:, -1] += lines.rate**2 * spectra.response[i]
            columns = np.conj(slopes - slopes.mean(axis=0))
            found.apart[i] = balance - balance.mean(axis=0)
            found.together[i] = np.sum((columns * found.apart[i][:, None]).real, axis=0) / (count - 1) / count
        found.variance[:] = scatter(found.apart / np.sqrt(found.shape[:, None])) * found.shape
        return found


class _Along:
    """The law along the motions of one record: the mean one, and single periods with its unseen lines."""

    def __init__(self, lines: Lines, law: ForceLaw, values: Array, mass: float, row: int) -> None:
        self.lines, self.law, self.values, self.mass = lines, law, values, mass
        orders = np.arange(lines.extended + 1)
        self.rate = 1j * orders * lines.spectra.omega0
        self.low = (orders > 0) & (orders < lines.first[row]) & (mass > 0)
        self.high = orders > lines.last[row]
        self.taken = ~(self.low | self.high)[: len(lines.spectra.lines)]
        self.unseen: ComplexArray = np.zeros(lines.extended + 1, dtype=complex)
        self.drive: ComplexArray = np.zeros(lines.extended + 1, dtype=complex)
        self._stiffness, self._damping = 0.0, 0.0

    @property
    def _dynamic(self) -> ComplexArray:
        """(extended + 1,) dynamic stiffness of the law's mean slopes [N/m]."""
        return np.asarray(self.mass * self.rate**2 + self._damping * self.rate + self._stiffness)

    def mean(self, force: ComplexArray, response: ComplexArray) -> tuple[ComplexArray, ComplexArray, float]:
        """Force of the law and its slopes by line, (H+1,) and (p+1, H+1), and the mean [m] of the motion.

        The last slope is that by the mass, which moves the lines that are not taken from the record.
        """
        count, low, high = len(response), self.low, self.high
        self.drive[:count] = force
        self.unseen[:count] = np.where(high[:count], response, 0)
        if not (low.any() or high.any()) or not self.mass > 0:
            return self.one(force, response)
        inertia = self.mass * self.rate**2
        before = float("inf")
        self.unseen[:] = 0
        for _ in range(TRIAL_STEPS):
            sample, _, spectrum = self._sample(response, slopes=False)
            stiffness = float(np.max(np.abs(sample.by_x)))
            ruled = low | (high & (np.abs(inertia) > _CLEAR * stiffness))
            left = self.drive - inertia * self.unseen - spectrum[0]
            dynamic = np.where(ruled, np.where(low, self._dynamic, inertia), 1)
            found = np.where(ruled, self.unseen + left / dynamic, 0)
            # nearer the resonance the record says more, noise and all
            found[:count] = np.where(high[:count] & ~ruled[:count], response, found[:count])
            moved = float(np.linalg.norm(found - self.unseen))
            if not moved < before:
                break
            self.unseen, before = found, moved
            if moved < TAIL * float(np.linalg.norm(response)):
                break
        return self.one(force, response)

    def noise_shape(self, force: Array, response: Array) -> Array:
        """(H+1,) variance of the balance of the linearised law, from those of force and response (H+1,)."""
        count = len(self.taken)
        low, inertia = self.low[:count], self.mass * self.lines.rate**2
        # where the law moves itself, it takes up the force
        dynamic = np.where(low, inertia, self._dynamic[:count])
        share = np.where(low, inertia / self._dynamic[:count], 1)
        power = np.abs(share) ** 2 * force + np.abs(dynamic) ** 2 * response
        return np.asarray(np.maximum(power, ROUND_OFF * float(power.max()) or 1.0))

    def one(self, force: ComplexArray, response: ComplexArray) -> tuple[ComplexArray, ComplexArray, float]:
        """The same of a single period, its unseen lines those of the mean motion, moved by its own force."""
        count = len(response)
        kept = self.unseen
        if self.low.any():
            part = self.low[:count]
            self.unseen = np.array(kept)
            self.unseen[:count][part] += ((force - self.drive[:count]) / self._dynamic[:count])[part]
        _, mean, spectrum = self._sample(response, slopes=True)
        self.unseen = kept
        return spectrum[0, :count], spectrum[1:, :count], mean

    def _sample(self, response: ComplexArray, *, slopes: bool) -> tuple[ForceSample, float, ComplexArray]:
        """Sample of the law, mean [m], spectra (2 + p, extended + 1) of its force and its slopes."""
        lines, law, values = self.lines, self.law, self.values
        whole, x, v, a, step, mean = self._waves(response)
        sample = law.sample(x, v, a, step, values)
        self._stiffness, self._damping = float(np.mean(sample.by_x)), float(np.mean(sample.by_v))
        force = np.broadcast_to(sample.force, x.shape)
        if not slopes:
            return sample, mean, self._spectrum(force)
        by_x, by_v = (np.broadcast_to(part, x.shape)[0] for part in (sample.by_x, sample.by_v))
        columns = np.zeros((len(values) + 1, lines.samples))
        for column, part in zip(columns, sample.by_parameter, strict=False):
            column[:] = np.broadcast_to(part, x.shape)[0]
        if not lines.spectra.mean_known and law.springs and (stiffness := float(by_x.mean())):
            # the mean follows the parameters
            columns -= by_x * columns.mean(axis=1, keepdims=True) / stiffness
        if self.low.any():
            self._follow(columns, by_x, by_v, whole)
        return sample, mean, self._spectrum(np.concatenate([force, columns]))

    def _waves(self, response: ComplexArray) -> tuple[ComplexArray, Array, Array, Array, Array, float]:
        """Lines (extended + 1,) of the motion, its x, v, a (1, s), their step [s], and the mean [m]."""
        lines, whole = self.lines, np.array(self.unseen)
        whole[: len(response)][self.taken] = response[self.taken]
        motion = Motion(np.array([lines.spectra.omega0]), whole[None])
        mean = float(whole[0].real)
        x, v, a = motion.waveforms(lines.samples)
        step = motion.interval(lines.samples)
        if not lines.spectra.mean_known:
            x, mean = _centred(self.law, x - mean, v, a, step, self.values)
        return whole, x, v, a, step, mean

    def damping(self, force: ComplexArray, response: ComplexArray) -> ComplexArray:
        """(H+1,) of the force that goes with the velocity, n(x, v) - n(x, 0) [N], of a law without memory."""
        self.mean(force, response)
        _, x, v, a, step, _ = self._waves(response)
        moving, still = (self.law.sample(x, rate, a, step, self.values).force for rate in (v, 0 * v))
        return self._spectrum(np.broadcast_to(moving - still, x.shape))[0, : len(response)]

    def _follow(self, columns: Array, by_x: Array, by_v: Array, whole: ComplexArray) -> None:
        """Add to slopes (p+1, s) what the law's own motion, which follows parameters and mass, adds at first.

        One step of the iteration to that motion: what more would change is less than noise does to slopes.
        """
        low, change = self.low, np.zeros((len(columns), len(self.rate)), dtype=complex)
        change[:, low] = -self._spectrum(columns)[:, low]
        change[-1, low] -= (self.rate**2 * whole)[low]
        change[:, low] /= self._dynamic[low]
        columns += by_x * self._wave(change) + by_v * self._wave(change * self.rate)

    def _spectrum(self, waves: Array) -> ComplexArray:
        """(n, extended + 1) of signals (n, s)."""
        return harmonics_of(waves, self.lines.extended + 1)

    def _wave(self, spectrum: ComplexArray) -> Array:
        """(n, s) signals of spectra (n, extended + 1)."""
        return waveform(spectrum, self.lines.samples)


def _centred(law: ForceLaw, x: Array, v: Array, a: Array, step: Array, values: Array) -> tuple[Array, float]:
    """A motion about the mean at which the mean force of the law vanishes, and that mean [m]."""
    mean = 0.0
    for _ in range(TO_REST if law.springs and not law.odd else 0):
        sample = law.sample(x + mean, v, a, step, values)
        slope = float(np.mean(sample.by_x))
        move = -float(np.mean(sample.force)) / slope if slope else 0.0
        limit = float(np.ptp(x))
        mean += min(max(move, -limit), limit)
        if abs(move) < ROUND_OFF * limit:
            break
    return x + mean, mean
