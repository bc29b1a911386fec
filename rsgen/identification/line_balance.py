"""The balance of forces at the lines of periodic records: F_h = m (i h omega0)^2 X_h + N_h(x; p) + noise.

The law is evaluated along the mean motion of each record. Three things come from the single periods: the
variance of the balance at each line, in which the noise of force and of response count as the law weighs
them; the O(noise^2) bias of the law along a noisy motion (along the mean of P periods it is a P-th of what it
is along one, so that (mean of N(x_p) - N(mean))/(P - 1) is left, the jackknife); and how the noise of the
slopes goes with that of the balance, which in plain least squares would bias the parameters (errors in
variables).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array, ComplexArray
from rsgen.identification.tolerances import ROUND_OFF
from rsgen.law.numeric import ForceLaw
from rsgen.motion import Motion
from rsgen.multisine import MultisineSpectra
from rsgen.multisine.spectra import scatter, smooth

__all__ = ["Balance", "Lines", "NoiseOfBalance", "lines_of"]

_OVERSAMPLED = 4
"""Samples a period over the number of lines: cubes of signals reach three times their highest line, and fold
back above it only."""

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
    """

    spectra: MultisineSpectra
    used: NDArray[np.bool_]
    samples: int

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


def lines_of(spectra: MultisineSpectra, band: tuple[float, float] | None) -> Lines:
    """Choose the lines: those of the band, else from the first to the highest excited one; never the mean."""
    last = [np.flatnonzero(row)[-1] if row.any() else 0 for row in spectra.excited()]
    low, high = band or (0.0, np.inf)
    inside = (spectra.frequency >= low) & (spectra.frequency <= high) & (spectra.lines > 0)
    used = np.stack([inside & (spectra.lines <= (np.inf if band else end)) for end in last])
    samples = 1 << (_OVERSAMPLED * len(spectra.lines) - 1).bit_length()
    return Lines(spectra, used, samples)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseOfBalance:
    """What the single periods say: variance (r, H+1) of the mean balance [N^2], and the bias of the law.

    ``bias`` (r, H+1) is that of the law's force [N], to be subtracted; ``by_parameter`` (r, p, H+1) that of
    its slopes. ``together`` (r, p+1, H+1) is the covariance of the slopes, that by the mass last, with the
    balance, real part. A variance that one period does not show is NaN.
    """

    variance: Array
    bias: ComplexArray
    by_parameter: ComplexArray
    together: Array

    @classmethod
    def unknown(cls, lines: Lines, parameters: int) -> NoiseOfBalance:
        """Nothing is known."""
        shape = lines.used.shape
        none = np.zeros(shape, dtype=complex)
        slopes = np.zeros((shape[0], parameters, shape[1]), dtype=complex)
        together = np.zeros((shape[0], parameters + 1, shape[1]))
        return cls(np.full(shape, np.nan), none, slopes, together)


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
            _along(lines, law, spectra.mean_force[i], spectra.mean_response[i], values)
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
            pairs = zip(spectra.force[i], spectra.response[i], strict=True)
            parts = [_along(lines, law, force, response, values) for force, response in pairs]
            forces = np.stack([part[0] for part in parts])
            balance = spectra.force[i] - mass * lines.rate**2 * spectra.response[i] - forces
            found.variance[i] = scatter(balance)
            whole = _along(lines, law, spectra.mean_force[i], spectra.mean_response[i], values)
            found.bias[i] = (forces.mean(axis=0) - whole[0]) / (count - 1)
            slopes = np.stack([part[1] for part in parts])
            found.by_parameter[i] = (slopes.mean(axis=0) - whole[1]) / (count - 1)
            inertia = lines.rate**2 * spectra.response[i]
            columns = np.concatenate([slopes, inertia[:, None]], axis=1)
            columns = np.conj(columns - columns.mean(axis=0))
            apart = (balance - balance.mean(axis=0))[:, None]
            found.together[i] = np.sum((columns * apart).real, axis=0) / (count - 1) / count
        return found


def _along(
    lines: Lines, law: ForceLaw, force: ComplexArray, response: ComplexArray, values: Array
) -> tuple[ComplexArray, ComplexArray, float]:
    """Force of the law and its slopes by line along one motion, (H+1,) and (p, H+1), and the mean [m]."""
    count = len(response)
    omega = np.array([lines.spectra.omega0])
    motion = Motion(omega, response[None])
    mean = float(response[0].real)
    x, v, a = motion.waveforms(lines.samples)
    step = motion.interval(lines.samples)
    if not lines.spectra.mean_known:
        # a sensor without mean: where the law's mean force vanishes
        x = x - mean
        mean = 0.0
        for _ in range(_MEAN_STEPS if law.springs and not law.odd else 0):
            sample = law.sample(x + mean, v, a, step, values)
            slope = float(sample.by_x.mean())
            move = -float(sample.force.mean()) / slope if slope else 0.0
            limit = float(np.ptp(x))
            mean += min(max(move, -limit), limit)
            if abs(move) < ROUND_OFF * limit:
                break
        x = x + mean
    sample = law.sample(x, v, a, step, values)
    slopes = [np.broadcast_to(s, x.shape)[0] for s in sample.by_parameter]
    if not lines.spectra.mean_known and law.springs:
        # the mean follows the parameters
        by_x = np.broadcast_to(sample.by_x, x.shape)[0]
        stiffness = float(by_x.mean())
        slopes = [s - by_x * float(s.mean()) / stiffness for s in slopes] if stiffness else slopes
    signals = np.stack([sample.force[0], *slopes])
    spectrum = np.fft.rfft(signals, axis=1)[:, :count] * (2 / lines.samples)
    spectrum[:, 0] /= 2
    return spectrum[0], spectrum[1:], mean
