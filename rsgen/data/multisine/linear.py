"""Best linear approximation of each level, its noise and its nonlinear distortion.

At an excited line Y = G F + S + N: G the best linear approximation, smooth in frequency; S the distortion,
which looks like noise but repeats every period; N noise, which does not. G is a local polynomial over
neighbouring excited lines, times one mode fitted to all of them (Schoukens, Vandersteen, Barbe, Pintelon,
IEEE Trans. Instrum. Meas. 58 (2009) 3207); its residual is S + N, and the scatter of the periods is N.
Where only odd lines are excited, even nonlinearity answers at even lines and odd nonlinearity also at the odd
lines that are not excited.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError, require
from rsgen.common.finding import Finding
from rsgen.common.text_table import Brief
from rsgen.common.tolerances import MAX_TRIAL_STEPS, MIN_MISFIT_REDUCTION, NOISE_LIMIT_SIGMAS
from rsgen.data.free_mode import fit_mode, steady
from rsgen.data.multisine.spectra import LINES_TO_EACH_SIDE, MultisineSpectra, rms, scatter, smooth
from rsgen.data.record_set import FILE_ROUND_OFF, copied_levels
from rsgen.data.surface.mode_findings import exchanged_channels, is_beyond_any_law
from rsgen.data.surface.plausibility import Sizes, quantity_findings, size_findings
from rsgen.data.surface.response_surface import ResponseSurface

# ----------------------------------------------------------------------------
# Plausibility of the sizes of records of a multisine, and of the mode found from them.


def implausible(spectra: MultisineSpectra, *, mass: float = nan, damping: float = nan) -> Iterator[Finding]:
    """Return findings about sizes in another unit, as ``size_findings``; amplitudes are sqrt(2) rms.

    Parameters
    ----------
    spectra
        Calibrated.
    mass, damping
        Of the mode [kg] and its smallest damping ratio; NaN where they are not known.
    """
    yield from copied_levels(spectra)
    first, last = (end[:, None] for end in spectra.reach())
    taken = (spectra.lines >= first) & (spectra.lines <= last)
    motion: ComplexArray = np.where(taken, spectra.mean_response, 0)
    parts = [float(np.sqrt(2) * rms(np.asarray(motion * spectra.omega**power)).max()) for power in range(3)]
    strongest = float(spectra.omega[:, 1:].reshape(-1)[np.argmax(np.abs(motion[:, 1:]))]) / (2 * np.pi)
    force = float(np.sqrt(2) * spectra.rms_force().max())
    sizes = Sizes(strongest, parts[0], parts[1], parts[2], force, mass, damping)
    yield from size_findings(sizes)


def misread_lines(spectra: MultisineSpectra) -> list[Finding]:
    """Find that another reading of the channels leaves far less at the excited lines than this; none or one.

    Each line is taken as a point of sines: a law that distorts leaves up to a fifth of the force.
    """
    if spectra.base or spectra.per_mass or spectra.across is not None:
        return []
    parts = zip((spectra.mean_force, spectra.mean_response), spectra.noise(), strict=True)
    clear = [~(np.abs(size) <= NOISE_LIMIT_SIGMAS * noise) for size, noise in parts]
    driven = spectra.excited() & (spectra.lines > 0) & spectra.recorded & clear[0] & clear[1]
    omega, force, response = spectra.omega[driven], spectra.mean_force[driven], spectra.mean_response[driven]
    if not driven.any() or not is_beyond_any_law(force, response, omega):
        return []
    level = np.broadcast_to(spectra.level[:, None], driven.shape)[driven]
    found = list(quantity_findings(ResponseSurface(level, omega / (2 * np.pi), force, response)))
    return found or exchanged_channels(*steady(force, response, omega), omega, share=1 - MIN_MISFIT_REDUCTION)


_POLYNOMIAL_TERMS = 3
"""Of the local polynomial: value, slope and curvature within the window, relative to the mode."""
_MIN_LINES = _POLYNOMIAL_TERMS + 1
"""Excited lines of a level: one more than the polynomial has coefficients."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Distortion(Brief):
    """Response at lines that the force does not excite, without the linear response to leakage.

    Parameters
    ----------
    frequency
        (d,) [Hz].
    response
        (d,) amplitude of the displacement, with noise, root mean square over the records of the level [m].
    noise
        (d,) standard deviation of its mean over periods [m]; NaN with one period.
    records
        Number of records of the level.
    """

    frequency: Array
    response: Array
    noise: Array
    records: int

    def share(self, whole: Array) -> tuple[float, float]:
        """Return root mean square without noise over that of ``whole`` (e,) [1], and its upper bound.

        Noise adds its variance to the power of a line, which scatters as much. With one period it is unknown:
        nothing is subtracted, and the bound is NaN.
        """
        total, power = float(np.sum(whole**2)), float(np.sum(self.response**2))
        if not total > 0:
            return float("nan"), float("nan")
        variance = np.nan_to_num(self.noise**2)
        left = power - float(variance.sum())
        chance = NOISE_LIMIT_SIGMAS * float(np.sqrt(np.sum(variance**2) / self.records))
        bound = float(np.sqrt((max(left, 0.0) + chance) / total))
        share = float(np.sqrt(left / total)) if left > chance else 0.0
        return share, bound if np.isfinite(self.noise).all() else float("nan")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BestLinear(Brief):
    """Best linear approximation of one level.

    Parameters
    ----------
    level
        Nominal root mean square of the drive, in ``level_unit``.
    records
        Number of records.
    frequency
        (e,) of the excited lines [Hz].
    receptance
        (e,) complex G [m/N].
    response
        (e,) amplitude of the displacement, root mean square over the records [m].
    noise
        (e,) standard deviation of the mean response over periods [m]; NaN with one period.
    distortion
        (e,) root mean square of the residual of G, without noise [m].
    even, odd
        Distortion at even and odd lines that are not excited; None where some excited lines are even, so that
        even and odd distortions cannot be separated.
    natural_frequency, damping_ratio
        Of the one mode that fits G best [Hz], [1]; NaN where no mode does.
    stiffness, mass
        Of that mode [N/m], [kg].
    """

    level: float
    records: int
    frequency: Array
    receptance: ComplexArray
    response: Array
    noise: Array
    distortion: Array
    even: Distortion | None
    odd: Distortion | None
    natural_frequency: float
    damping_ratio: float
    stiffness: float
    mass: float
    level_unit: str = "N"

    @property
    def rms(self) -> float:
        """Root mean square of the displacement at the excited lines [m]."""
        return float(np.sqrt(0.5 * np.sum(self.response**2)))

    @property
    def distortion_share(self) -> float:
        """Distortion at the excited lines over the response there, root mean square [1]."""
        return _share(self.distortion, self.response)

    @property
    def even_share(self) -> float:
        """Response at even lines over that at the excited ones [1], 0 where it is below the noise.

        NaN where even lines are excited.
        """
        return float("nan") if self.even is None else self.even.share(self.response)[0]

    @property
    def odd_share(self) -> float:
        """Response at odd lines that are not excited over that at the excited ones [1]."""
        return float("nan") if self.odd is None else self.odd.share(self.response)[0]

    @property
    def even_bound(self) -> float:
        """Upper bound of ``even_share`` [1] by the noise; NaN with one period, and as ``even_share``."""
        return float("nan") if self.even is None else self.even.share(self.response)[1]

    @property
    def odd_bound(self) -> float:
        """Upper bound of ``odd_share`` [1]."""
        return float("nan") if self.odd is None else self.odd.share(self.response)[1]

    @property
    def noise_share(self) -> float:
        """Noise of the mean over the response at the excited lines [1]; NaN with one period."""
        return _share(self.noise, self.response)


def _share(part: Array, whole: Array) -> float:
    total = float(np.sum(whole**2))
    return float(np.sqrt(np.sum(part**2) / total)) if total > 0 else float("nan")


def best_linear(spectra: MultisineSpectra, band: tuple[float, float] | None = None) -> tuple[BestLinear, ...]:
    """Return the best linear approximation of every level.

    Parameters
    ----------
    spectra
        Records of one level and base frequency are realisations of one multisine, and have one approximation.
    band
        Lowest and highest frequency [Hz]; None: every excited line.

    Raises
    ------
    MeasurementError
        A level has fewer than four excited lines in the band.
    """
    require(spectra, MultisineSpectra, "spectra")
    excited = spectra.excited()
    low, high = band or (0.0, np.inf)
    frequency, recorded = spectra.omega / (2 * np.pi), spectra.recorded
    bases = np.full(len(spectra), spectra.omega0)
    found = []
    for level, base in np.unique([spectra.level, bases], axis=1).T:
        rows = np.flatnonzero(
            np.isclose(spectra.level, level, rtol=FILE_ROUND_OFF, atol=0.0) & (bases == base)
        )
        of_rows = frequency[rows[0]]
        inside = (of_rows >= low) & (of_rows <= high) & (spectra.lines > 0) & recorded[rows].all(axis=0)
        chosen = excited[rows].all(axis=0) & inside
        if np.count_nonzero(chosen) < _MIN_LINES:
            raise MeasurementError(
                f"multisine: level {level:g} {spectra.level_unit}: {np.count_nonzero(chosen)} excited lines "
                f"in the band; at least {_MIN_LINES} are needed: in a wider band; or force and response are "
                "swapped, for a force has about as much at all its lines"
            )
        found.append(
            _of_level(spectra, float(level), rows, chosen, np.asarray(excited[rows].any(axis=0)), inside)
        )
    return tuple(found)


def _of_level(
    spectra: MultisineSpectra,
    level: float,
    rows: NDArray[np.intp],
    chosen: NDArray[np.bool_],
    excited: NDArray[np.bool_],
    inside: NDArray[np.bool_],
) -> BestLinear:
    """Return the best linear approximation of a level: receptance, noise, distortion, and the mode that fits.

    A crude receptance and its mode come first: relative to the receptance of that mode the true one is nearly
    constant over neighbouring lines, which a local fit then averages.
    """
    force, response = spectra.mean_force[rows], spectra.mean_response[rows]
    lines = np.flatnonzero(chosen)
    frequency = spectra.omega[rows[0]] / (2 * np.pi)
    omega = 2 * np.pi * frequency[lines]
    power = np.mean(np.abs(force[:, lines]) ** 2, axis=0)
    crude = np.mean(response[:, lines] * np.conj(force[:, lines]), axis=0) / power
    shape = _receptance(omega, _mode(omega, crude, np.ones(len(lines)), power))
    receptance, left = _local(lines, force[:, lines] * shape, response[:, lines])
    receptance = receptance * shape
    everywhere = np.interp(spectra.lines, lines, receptance)
    # noise of force and response together: scatter of the periods about Y = G F
    deviation = spectra.response[rows] - everywhere * spectra.force[rows]
    variance = scatter(deviation).mean(axis=0)
    noise = np.sqrt(variance[lines])
    distortion = np.sqrt(np.maximum(left - np.nan_to_num(variance[lines]), 0.0))
    size = np.sqrt(np.mean(np.abs(response) ** 2, axis=0))
    even, odd = None, None
    if np.all(np.flatnonzero(excited) % 2 == 1):
        linear = np.sqrt(np.mean(np.abs(response - everywhere * force) ** 2, axis=0))
        span = inside & (spectra.lines <= 3 * lines[-1]) & ~excited
        # without lines noisier than every excited one, as the lowest of accelerations are
        span &= ~(variance > variance[lines].max())
        parts = [np.flatnonzero(span & (spectra.lines % 2 == rest)) for rest in (0, 1)]
        even, odd = (
            Distortion(frequency[part], linear[part], np.sqrt(variance[part]), len(rows)) for part in parts
        )
    weight = 1 / np.maximum(left, 1e-24 * size.max() ** 2)
    mode = _mode(omega, receptance, weight, power)
    return BestLinear(
        level,
        len(rows),
        frequency[lines],
        receptance,
        size[lines],
        noise,
        distortion,
        even,
        odd,
        *mode,
        spectra.level_unit,
    )


def _local(
    lines: NDArray[np.intp], force: ComplexArray, response: ComplexArray
) -> tuple[ComplexArray, Array]:
    """Return the local polynomial G (e,) at excited lines (e,) from (r, e), and its residual power (e,)."""
    count = len(lines)
    receptance, left = np.zeros(count, dtype=complex), np.zeros(count)
    width = min(2 * LINES_TO_EACH_SIDE + 1, count)
    for i, line in enumerate(lines):
        first = min(max(i - LINES_TO_EACH_SIDE, 0), count - width)
        part = slice(first, first + width)
        away = (lines[part] - line) / max(lines[part][-1] - lines[part][0], 1)
        powers = away[:, None] ** np.arange(min(_POLYNOMIAL_TERMS, width - 1))
        matrix = (force[:, part, None] * powers).reshape(-1, powers.shape[1])
        right = response[:, part].reshape(-1)
        solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
        receptance[i] = solution[0]
        freedom = max(len(right) - powers.shape[1], 1)
        left[i] = float(np.sum(np.abs(right - matrix @ solution) ** 2)) / freedom
    return receptance, smooth(np.concatenate([[0.0], left]))[1:]


def _receptance(omega: Array, mode: tuple[float, float, float, float]) -> ComplexArray:
    """Return the receptance (e,) [m/N] of one mode at ``omega`` [rad/s]; ones if the mode is NaN."""
    natural, ratio, stiffness, _ = mode
    if not np.isfinite(natural):
        return np.ones(len(omega), dtype=complex)
    share = omega / (2 * np.pi * natural)
    return np.asarray(1 / (stiffness * (1 - share**2 + 2j * ratio * share)))


def _mode(
    omega: Array, receptance: ComplexArray, weight: Array, power: Array
) -> tuple[float, float, float, float]:
    """Return natural frequency [Hz], damping ratio, stiffness and mass of a mode fitted to G; else NaN."""
    predicted, one = np.ones_like(receptance), np.ones((len(omega), 1))
    # each reweighting divides the error by ten or more
    for _ in range(MAX_TRIAL_STEPS):
        # each line divided by its last dynamic stiffness: errors then count in G
        scale = np.sqrt(weight * power) / np.abs(predicted)
        found = fit_mode(*steady(np.ones_like(receptance), receptance, omega), one, scale)
        stiffness, damping, mass = found.values
        predicted = stiffness - mass * omega**2 + 1j * omega * damping
    if not (stiffness > 0 and mass > 0):
        return (float("nan"),) * 4
    natural = float(np.sqrt(stiffness / mass))
    return natural / (2 * np.pi), float(damping / (2 * mass * natural)), float(stiffness), float(mass)
