"""The balance of forces at the lines of periodic records: F_h = m (i h omega0)^2 X_h + N_h(x; p) + noise.

The law is evaluated along the mean motion of each record. Three things come from the single periods: the
variance of the balance at each line, in which the noise of force and of response count as the law weighs
them; the O(noise^2) bias of the law along a noisy motion (along the mean of P periods it is a P-th of what it
is along one, so that (mean of N(x_p) - N(mean))/(P - 1) is left, the jackknife); and how the noise of the
slopes goes with that of the balance, which in plain least squares would bias the parameters (errors in
variables).

Lines in which the noise hides the response, and those above the record, are not taken from it: there the law
itself gives the motion, X_h = (F_h - N_h)/(m (i h omega0)^2), by iteration. So noise does not reach the
velocity, and a law with corners and jumps sees a motion that has all its lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array, ComplexArray
from rsgen.identification.tolerances import ROUND_OFF
from rsgen.law.force_sample import ForceSample
from rsgen.law.numeric import ForceLaw
from rsgen.motion import Motion
from rsgen.multisine import MultisineSpectra
from rsgen.multisine.spectra import scatter, smooth

__all__ = ["Balance", "Lines", "NoiseOfBalance", "lines_of"]

_OVERSAMPLED = 4
"""Samples a period over the number of lines: cubes of signals reach three times their highest line, and fold
back above it only."""

_EXTENDED, _MOST_LINES = 16, 16384
"""Times the recorded lines that a motion has along a law with switches, and most lines: the velocity at a
jump errs by the inverse of their number, which leaves a few 1e-6 of the force."""

_HIDDEN = 3.0
"""A response below this many times the noise of its mean says less than the law does."""

_CLEAR = 3.0
"""Dynamic stiffness of a line, relative to the largest stiffness of the law, above which inertia rules there
and the iteration to the law's own motion shrinks its error threefold a step."""

_TAIL_STEPS = 12
"""Of that iteration."""

_TAIL_ENOUGH = 1e-9
"""Change of the unseen lines, relative to the seen ones, at which they move no force any more."""

_MEAN_STEPS = 30
"""Newton steps to the mean of a motion whose mean the sensor does not see."""


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
    last
        (r,) highest line of each record up to which the response is taken from it.
    extended
        Highest line of the motions along which the law is evaluated.
    """

    spectra: MultisineSpectra
    used: NDArray[np.bool_]
    samples: int
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
    samples = 1 << (_OVERSAMPLED * (extended + 1) - 1).bit_length()
    noise = spectra.noise()[1]
    # of one period no noise is known: then every line counts
    seen = np.stack([np.sqrt(smooth(one**2)) for one in np.abs(spectra.mean_response)]) > _HIDDEN * noise
    seen |= ~np.isfinite(noise)
    seen[:, 0] = True
    hidden = np.array([np.flatnonzero(row)[-1] for row in seen], dtype=np.intp)
    return Lines(spectra, used, samples, hidden, extended)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseOfBalance:
    """What the single periods say: variance (r, H+1) of the mean balance [N^2], and the bias of the law.

    ``bias`` (r, H+1) is that of the law's force [N], to be subtracted; ``by_parameter`` (r, p, H+1) that of
    its slopes. ``together`` (r, p+1, H+1) is the covariance of the slopes, that by the mass last, with the
    balance, real part. A variance that one period does not show is NaN. ``shape`` (r, H+1) is how the
    variance goes from line to line [N^2]: what of neighbouring lines is averaged is divided by it first.
    ``apart`` (r, P, H+1) is how far the balance of each period is from their mean [N].
    """

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
    inertia
        (r, H+1) (i h omega0)^2 X, what the mass multiplies.
    mean
        (r,) mean displacement, measured or found from the law [m].
    """

    residual: ComplexArray
    by_parameter: ComplexArray
    inertia: ComplexArray
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
        law_force = np.stack([part[0] for part in parts]) - noise.bias
        by_parameter = np.stack([part[1] for part in parts]) - noise.by_parameter
        residual = spectra.mean_force - mass * inertia - law_force
        return cls(residual, by_parameter, inertia, np.array([part[2] for part in parts]))

    def noise(self, lines: Lines, law: ForceLaw, values: Array, mass: float) -> NoiseOfBalance:
        """Evaluate the law along every period, for the variance of the balance and the bias of the law."""
        spectra = lines.spectra
        count = spectra.periods
        found = NoiseOfBalance.unknown(lines, len(values))
        if count < 2:
            return found
        for i in range(len(lines)):
            along = _Along(lines, law, values, mass, i)
            whole = along.mean(spectra.mean_force[i], spectra.mean_response[i])
            parts = [along.one(response) for response in spectra.response[i]]
            forces = np.stack([part[0] for part in parts])
            balance = spectra.force[i] - mass * lines.rate**2 * spectra.response[i] - forces
            if not spectra.exact[i]:
                found.shape[i] = along.noise_shape(spectra.force[i], spectra.response[i])
            found.variance[i] = scatter(balance / np.sqrt(found.shape[i])) * found.shape[i]
            found.bias[i] = (forces.mean(axis=0) - whole[0]) / (count - 1)
            slopes = np.stack([part[1] for part in parts])
            found.by_parameter[i] = (slopes.mean(axis=0) - whole[1]) / (count - 1)
            inertia = lines.rate**2 * spectra.response[i]
            columns = np.concatenate([slopes, inertia[:, None]], axis=1)
            columns = np.conj(columns - columns.mean(axis=0))
            found.apart[i] = balance - balance.mean(axis=0)
            found.together[i] = np.sum((columns * found.apart[i][:, None]).real, axis=0) / (count - 1) / count
        return found


class _Along:
    """The law along the motions of one record: the mean one, and single periods with its unseen lines."""

    def __init__(self, lines: Lines, law: ForceLaw, values: Array, mass: float, row: int) -> None:
        self.lines, self.law, self.values, self.mass = lines, law, values, mass
        self.last = int(lines.last[row])
        self.unseen: ComplexArray = np.zeros(lines.extended + 1, dtype=complex)
        self._stiffness, self._damping = 0.0, 0.0

    def mean(self, force: ComplexArray, response: ComplexArray) -> tuple[ComplexArray, ComplexArray, float]:
        """Force of the law and its slopes by line, (H+1,) and (p, H+1), and the mean [m] of the motion."""
        lines, count = self.lines, len(response)
        high = np.arange(lines.extended + 1) > self.last
        self.unseen[:count] = np.where(high[:count], response, 0)
        if not high.any() or not self.mass > 0:
            return self.one(response)
        rate = 1j * np.arange(lines.extended + 1) * lines.spectra.omega0
        drive = np.zeros(lines.extended + 1, dtype=complex)
        drive[:count] = force
        before = float("inf")
        self.unseen[:] = 0
        for _ in range(_TAIL_STEPS):
            sample, _, spectrum = self._sample(response, slopes=False)
            stiffness = float(np.max(np.abs(sample.by_x)))
            ruled = high & (np.abs(self.mass * rate**2) > _CLEAR * stiffness)
            found = np.where(ruled, (drive - spectrum[0]) / np.where(ruled, self.mass * rate**2, 1), 0)
            # nearer the resonance the record says more, noise and all
            found[:count] = np.where(high[:count] & ~ruled[:count], response, found[:count])
            moved = float(np.linalg.norm(found - self.unseen))
            if not moved < before:
                break
            self.unseen, before = found, moved
            if moved < _TAIL_ENOUGH * float(np.linalg.norm(response)):
                break
        return self.one(response)

    def noise_shape(self, force: ComplexArray, response: ComplexArray) -> Array:
        """(H+1,) variance of the balance that the noise of force and response makes in the linearised law."""
        rate = self.lines.rate
        dynamic = self.mass * rate**2 + self._damping * rate + self._stiffness
        power = scatter(force) + np.abs(dynamic) ** 2 * scatter(response)
        return np.asarray(np.maximum(power, ROUND_OFF * float(power.max()) or 1.0))

    def one(self, response: ComplexArray) -> tuple[ComplexArray, ComplexArray, float]:
        """The same of a single period, its unseen lines those of the mean motion."""
        _, mean, spectrum = self._sample(response, slopes=True)
        count = len(response)
        return spectrum[0, :count], spectrum[1:, :count], mean

    def _sample(self, response: ComplexArray, *, slopes: bool) -> tuple[ForceSample, float, ComplexArray]:
        """Sample of the law, mean [m], spectra (1 + p, extended + 1) of its force and its slopes."""
        lines, law, values = self.lines, self.law, self.values
        whole = np.array(self.unseen)
        whole[: self.last + 1] = response[: self.last + 1]
        motion = Motion(np.array([lines.spectra.omega0]), whole[None])
        mean = float(whole[0].real)
        x, v, a = motion.waveforms(lines.samples)
        step = motion.interval(lines.samples)
        if not lines.spectra.mean_known:
            x, mean = _centred(law, x - mean, v, a, step, values)
        sample = law.sample(x, v, a, step, values)
        self._stiffness, self._damping = float(np.mean(sample.by_x)), float(np.mean(sample.by_v))
        parts = [np.broadcast_to(sample.force, x.shape)[0]]
        if slopes:
            columns = [np.broadcast_to(s, x.shape)[0] for s in sample.by_parameter]
            if not lines.spectra.mean_known and law.springs:
                # the mean follows the parameters
                by_x = np.broadcast_to(sample.by_x, x.shape)[0]
                stiffness = float(by_x.mean())
                columns = [s - by_x * float(s.mean()) / stiffness for s in columns] if stiffness else columns
            parts += columns
        spectrum = np.fft.rfft(np.stack(parts), axis=1)[:, : lines.extended + 1] * (2 / lines.samples)
        spectrum[:, 0] /= 2
        return sample, mean, spectrum


def _centred(law: ForceLaw, x: Array, v: Array, a: Array, step: Array, values: Array) -> tuple[Array, float]:
    """A motion about the mean at which the mean force of the law vanishes, and that mean [m]."""
    mean = 0.0
    for _ in range(_MEAN_STEPS if law.springs and not law.odd else 0):
        sample = law.sample(x + mean, v, a, step, values)
        slope = float(np.mean(sample.by_x))
        move = -float(np.mean(sample.force)) / slope if slope else 0.0
        limit = float(np.ptp(x))
        mean += min(max(move, -limit), limit)
        if abs(move) < ROUND_OFF * limit:
            break
    return x + mean, mean
