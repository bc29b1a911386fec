"""Spectra of a test with a periodic multisine, by record, period and line, and the file that holds them."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray, frozen_array
from rsgen.common.errors import MeasurementError, RsgenError, one_line, printable, require
from rsgen.common.finding import Finding
from rsgen.common.output import write_atomic
from rsgen.common.text_table import Printed, TextTable, short
from rsgen.common.tolerances import ROUND_OFF, STANDARD_ERRORS_OF_DIFFERENCE
from rsgen.data.record_set import BASE_UNITS, Records

if TYPE_CHECKING:
    from rsgen.data.oscillator import Observation

_MIN_EXCITED_RATIO = 3.0
"""Of the weakest excited line to the strongest other one: leakage of a generator is 10 dB lower at least."""
LINES_TO_EACH_SIDE = 5
"""Lines to each side whose scatter is averaged: scatter of a few periods alone is off by tens of per cent."""
_NOISE_POWERS = (0, 2, 4)
"""Powers of the frequency by which noise falls: white in displacement, velocity or acceleration."""
_MIN_RATIO_LOWEST_LINES = 10.0
"""Of the response at the lowest lines to noise, which few of them dominate: at 10 it is 1 % of the power."""
_BAD_LEVEL = "a positive root mean square of the force is needed"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MultisineSpectra(Records, Printed):
    """Spectra of a test with a periodic multisine, transient periods left out.

    x(t) = Re sum_h X_h exp(i h omega0 t), and the force alike; line h is at h omega0 / (2 pi). Lines are peak
    values: multiply rms ones, of force and response, by sqrt(2); where both are rms, nothing shows it.

    Parameters
    ----------
    level
        (r,) nominal root mean square of the drive of each record, without its mean, in ``level_unit``.
    omega0
        2 pi over the period [rad/s]: a number, or (r,) where the records have other periods or rates.
    force
        (r, p, H+1) complex: record, period, line; the mean first [N]. (r, H+1) is one period a record. With
        (r,) ``omega0`` a record may have fewer lines: zeros follow its highest one.
    response
        Displacement, as the force [m].
    mean_known
        False where the sensor has no mean: accelerometers, and sensors with an unknown offset.
    origin
        "measured" or "simulated".
    left_out
        (r,) periods of transient, left out at the beginning of each record.
    findings
        Findings of the reader of the records.
    label
        (r,) number that names the level of a record in the test, where it is no amount of its force; None:
        the levels are their own names. ``hold_out`` takes it.
    per_mass
        True where the force is one per mass [N/kg = m/s^2], as a driven base gives it.
    base
        "" where a force drives; else the quantity of the motion of a driven base, as of a response surface:
        the response is relative to the base, the force per mass minus the acceleration of the base.
    across
        Displacement across the springs and dampers that act between two sensors, as the response; None where
        all act on the response.

    Raises
    ------
    MeasurementError
        Shapes differ, something is not finite, a level or omega0 is not positive.
    """

    phase_known: ClassVar = True  # type: ignore[misc]  # a field of surfaces
    columns: ClassVar = ("level", "omega0", "force", "response", "left_out", "label", "across")

    level: Array
    omega0: float | Array
    force: ComplexArray
    response: ComplexArray
    mean_known: bool = True
    origin: str = "measured"
    left_out: NDArray[np.int64] | None = None
    findings: tuple[Finding, ...] = ()
    label: Array | None = None
    per_mass: bool = False
    base: str = ""
    across: ComplexArray | None = None

    def __post_init__(self) -> None:
        level = _array(self.level, "level", np.float64, (1,))
        force, response = _periods(self.force, "force"), _periods(self.response, "response")
        across = response if self.across is None else _periods(self.across, "across")
        if not force.shape == response.shape == across.shape or len(force) != len(level) or not force.size:
            raise MeasurementError(
                f"MultisineSpectra: force {force.shape}, response {response.shape}, level {level.shape}; "
                "(records, periods, lines) of both and a level a record are needed"
            )
        omega0 = _array(self.omega0, "omega0", np.float64, (0, 1))
        if not (omega0 > 0).all() or omega0.shape not in ((), level.shape):
            raise MeasurementError(
                f"MultisineSpectra: omega0: {self.omega0!r:.80}; must be positive, in rad/s, one or one a "
                "record"
            )
        if not (level > 0).all():
            raise MeasurementError(f"MultisineSpectra: level: {level.tolist()!r:.80}; {_BAD_LEVEL}")
        if self.base not in BASE_UNITS:
            known = ", ".join(map(repr, BASE_UNITS))
            raise MeasurementError(f"MultisineSpectra: base: {self.base!r:.60}; one of {known} is needed")
        left = np.zeros(len(level), dtype=np.int64) if self.left_out is None else np.asarray(self.left_out)
        if np.shape(left) != level.shape:
            raise MeasurementError(f"MultisineSpectra: left_out: {np.shape(left)}; one a record is needed")
        arrays = {"level": level, "force": force, "response": response, "left_out": left}
        arrays |= {"omega0": omega0} if omega0.ndim else {}
        arrays |= {} if self.across is None else {"across": across}
        arrays |= {} if self.label is None else {"label": _array(self.label, "label", np.float64, (1,))}
        for name, value in arrays.items():
            object.__setattr__(self, name, frozen_array(value, value.dtype.type))

    @property
    def periods(self) -> int:
        """Periods of each record."""
        return int(self.force.shape[1])

    @property
    def signals(self) -> Mapping[str, ComplexArray]:
        """Lines of force [N], response and, where there is one, motion across [m], each (r, p, H+1)."""
        across = {} if self.across is None else {"across": self.across}
        return {"force": self.force, "response": self.response, **across}

    @property
    def lines(self) -> NDArray[np.intp]:
        """(H+1,) 0, 1, ..., H."""
        return np.arange(self.force.shape[2])

    @property
    def frequency(self) -> Array:
        """(H+1,) of each line [Hz]; (r, H+1) where ``omega0`` is one a record."""
        return np.asarray(np.multiply.outer(self.omega0, self.lines) / (2 * np.pi))

    @property
    def omega(self) -> Array:
        """(r, H+1) angular frequency of each line of each record [rad/s]."""
        return np.asarray(np.multiply.outer(np.full(len(self), self.omega0), self.lines))

    @property
    def spacing(self) -> tuple[float, float]:
        """Smallest and largest spacing of the lines of a record [Hz]."""
        return float(np.min(self.omega0)) / (2 * np.pi), float(np.max(self.omega0)) / (2 * np.pi)

    @property
    def recorded(self) -> NDArray[np.bool_]:
        """(r, H+1) True at the lines of a record: all, or those up to its highest one that is not zero."""
        if np.ndim(self.omega0) == 0:
            return np.ones((len(self), len(self.lines)), dtype=np.bool_)
        moved = np.any((self.force != 0) | (self.response != 0), axis=1)
        return np.asarray(np.logical_or.accumulate(moved[:, ::-1], axis=1)[:, ::-1])

    @property
    def mean_force(self) -> ComplexArray:
        """(r, H+1) mean over the periods [N]."""
        return np.asarray(self.force.mean(axis=1))

    @property
    def mean_response(self) -> ComplexArray:
        """(r, H+1) mean over the periods [m]."""
        return np.asarray(self.response.mean(axis=1))

    @property
    def exact(self) -> NDArray[np.bool_]:
        """(r,) True where the periods of a record are equal except for round-off: their noise is unknown."""
        pairs = zip(self.noise(), (self.mean_force, self.mean_response), strict=True)
        small = [rms(own) < ROUND_OFF * rms(whole) for own, whole in pairs]
        return np.asarray(np.logical_and(*small))

    @property
    def extent(self) -> dict[str, Any]:
        """Number and range of points, each an excited line of a record."""
        frequency = self.omega[self.excited()] / (2 * np.pi)
        return {
            "levels": len(self.levels),
            "points": len(frequency),
            "sweeps": [],
            "lowest_frequency": float(frequency.min()),
            "highest_frequency": float(frequency.max()),
            "records": len(self),
            "periods": self.periods,
        }

    @property
    def provenance(self) -> dict[str, str]:
        """Name and size, for the provenance of a result."""
        size = f"{len(self)} records of {self.periods} periods, {self.lines[-1]} lines"
        return {"Spectra": f"{self.origin}, {size}"}

    def rms_force(self) -> Array:
        """Return the root mean square (r,) of the force, without its mean [N]."""
        return rms(self.mean_force)

    def rms_response(self) -> Array:
        """Return the root mean square (r,) of the displacement [m] without mean and lines below noise."""
        return rms(np.where(self.lines < self.reach()[0][:, None], 0, self.mean_response))

    def reach(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return lowest and highest line (r,) of each record between which noise does not hide the response.

        Accelerations divided by omega^2 have noise at the lowest lines that may exceed everything else. Of
        two motions the lowest line is one at which noise hides neither: no law gives the lines below, and
        zero is nearer than a measured line only where noise is more than the motion.
        Without noise, or with one period, all lines are taken.
        """
        motions = [self.response] if self.across is None else [self.response, self.across]
        # a line has the power of motion and noise
        least = _MIN_RATIO_LOWEST_LINES**2 if self.across is None else 2.0
        ends = []
        for motion in motions:
            size = np.abs(motion.mean(axis=1))
            noise = np.where(self.exact[:, None], np.nan, np.sqrt(scatter(motion)))
            ends.append([_reach(*one, least) for one in zip(size, noise, self.excited(), strict=True)])
        highest = [high for _, high in ends[0]]
        last = np.count_nonzero(self.recorded, axis=1) - 1
        return np.max([[low for low, _ in of] for of in ends], axis=0), np.minimum(highest, last)

    @property
    def means(self) -> tuple[bool, ...]:
        """True if the mean was recorded, of the response and of the motion across two sensors if any."""
        return (self.mean_known,) * (1 if self.across is None else 2)

    def far(self, share: float) -> ComplexArray | None:
        """Return the motion across less a share of the response (r, p, H+1) [m]; None where there is none.

        It is zero at the lowest lines if noise hides them: no law gives the motion of a second sensor. Of the
        highest ones, together, the motion is more than their noise, which the scatter of the periods shows.
        """
        if self.across is None:
            return None
        seen = (self.lines == 0) | (self.lines >= self.reach()[0][:, None, None])
        return np.asarray(np.where(seen, self.across - share * self.response, 0))

    def excited(self) -> NDArray[np.bool_]:
        """Return (r, H+1) True at excited lines: those of the force above the widest gap between sizes."""
        pairs = zip(self.mean_force, scatter(self.force), strict=True)
        return np.stack([_excited(force, variance) for force, variance in pairs])

    def noise(self) -> tuple[Array, Array]:
        """Return standard deviations (r, H+1) of mean force [N] and response [m]; NaN with one period."""
        return np.sqrt(scatter(self.force)), np.sqrt(scatter(self.response))

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        lines = self.excited().sum(axis=1)
        noise = [rms(one) for one in self.noise()]
        rows = tuple(
            (short(level), str(count), short(force, 3), short(own, 2), short(moved, 3), short(other, 2))
            for level, count, force, own, moved, other in zip(
                self.level, lines, self.rms_force(), noise[0], self.rms_response(), noise[1], strict=True
            )
        )
        heads = ("level", "excited lines", "force rms", "noise", "response rms", "noise")
        step = " to ".join(dict.fromkeys(f"{spacing:.6g}" for spacing in self.spacing))
        high = float((self.omega * self.recorded).max()) / (2 * np.pi)
        caption = (
            f"MultisineSpectra: {len(self)} records of {self.periods} periods, a line every {step} Hz to "
            f"{high:.5g} Hz, {self.origin}"
        )
        return TextTable(heads, rows, caption=caption, notes=tuple(map(str, self.findings)))


def _array(values: ArrayLike, name: str, kind: type, dimensions: tuple[int, ...]) -> NDArray[Any]:
    """Return numbers as an array of one of these dimensions; a MeasurementError names it otherwise."""
    try:
        array: NDArray[Any] = np.asarray(values, dtype=kind)
    except (TypeError, ValueError):
        raise MeasurementError(f"MultisineSpectra: {name}: {values!r:.60}; numbers are needed") from None
    if array.ndim not in dimensions:
        raise MeasurementError(
            f"MultisineSpectra: {name}: shape {array.shape}; {' or '.join(map(str, dimensions))} dimensions"
        )
    if not np.isfinite(array).all():
        raise MeasurementError(f"MultisineSpectra: {name}: not finite; finite numbers are needed")
    return array


def _periods(spectra: ArrayLike, name: str) -> ComplexArray:
    """Return spectra (r, p, H+1), from such or from one period a record (r, H+1)."""
    array = _array(spectra, name, np.complex128, (2, 3))
    return array if array.ndim == 3 else array[:, None]


def rms(spectrum: ComplexArray | Array) -> Array:
    """Return the root mean square (...,) of signals without their mean, from spectra (..., H+1)."""
    return np.asarray(np.sqrt(0.5 * np.sum(np.abs(spectrum[..., 1:]) ** 2, axis=-1)))


def smooth(power: Array, side: int = LINES_TO_EACH_SIDE) -> Array:
    """Return the average (H+1,) of a power over neighbouring lines; the line of the mean stays as it is."""
    if len(power) < 3:
        return power
    window = np.ones(2 * side + 1)
    lines = power[1:]
    total = np.convolve(lines, window, mode="full")[side : side + len(lines)]
    count = np.convolve(np.ones(len(lines)), window, mode="full")[side : side + len(lines)]
    return np.concatenate([power[:1], total / count])


def scatter(periods: ComplexArray) -> Array:
    """Return the variance (r, H+1) of the mean of p periods (r, p, H+1), averaged over lines; NaN if p = 1.

    Noise falls with one power of the frequency in all records; each possible power is weighted by its
    likelihood.
    """
    count = periods.shape[1]
    if count < 2:
        return np.full((len(periods), periods.shape[2]), np.nan)
    deviation = periods - periods.mean(axis=1, keepdims=True)
    power = np.sum(np.abs(deviation) ** 2, axis=1) / (count - 1) / count
    lines = np.maximum(np.arange(power.shape[1], dtype=np.float64), 1)
    found = [np.stack([smooth(one) for one in power * lines**fall]) * lines**-fall for fall in _NOISE_POWERS]
    surprise = (count - 1) * np.array([_surprise(power[:, 1:], one[:, 1:]) for one in found])
    likelihood = np.exp(surprise.min() - surprise)
    log = np.log(np.maximum(found, np.finfo(float).tiny))
    return np.asarray(np.exp(np.tensordot(likelihood / likelihood.sum(), log, 1)) * (found[0] > 0))


def _surprise(power: Array, expected: Array) -> float:
    """Return minus the logarithm of the likelihood of powers of noise, up to a factor and a constant."""
    known = expected > 0
    return float(np.sum(np.log(expected[known]) + power[known] / expected[known]))


def _reach(size: Array, noise: Array, excited: NDArray[np.bool_], least: float) -> tuple[int, int]:
    """Return lowest and highest line of a response (H+1,) between which it is larger than its noise.

    ``least`` is the power over that of the noise that the lowest lines have.
    """
    last = len(size) - 1
    if not np.isfinite(noise).all():
        return 1, last
    high = np.flatnonzero(np.sqrt(smooth(size**2)) > STANDARD_ERRORS_OF_DIFFERENCE * noise)
    variance = np.maximum(noise[1:] ** 2, 1e-300)
    # summed from below, so that a strong line does not hide the noise of those before it
    hidden = np.cumsum(size[1:] ** 2 / variance) <= least * np.arange(1, last + 1)
    # lines below the excited ones are hidden if their noise together exceeds that of the excited ones
    driven = np.flatnonzero(excited[1:])
    if len(driven):
        below = np.cumsum(variance[: driven[0]][::-1])[::-1]
        hidden[: driven[0]] |= below > variance[driven].sum()
    low = np.flatnonzero(~hidden)
    return (int(low[0]) + 1 if len(low) else 1), (int(high[-1]) if len(high) else 0)


def _excited(force: ComplexArray, variance: Array) -> NDArray[np.bool_]:
    """Return (H+1,) True at the lines of one record that the force excites."""
    size = np.abs(force)
    size[0] = 0.0
    largest = float(size.max(initial=0.0))
    noise = np.nan_to_num(np.sqrt(variance)) * STANDARD_ERRORS_OF_DIFFERENCE
    floor = np.maximum(noise, ROUND_OFF * largest)
    floored = np.maximum(size, floor)
    # a line below the noise or round-off is not excited
    seen = size > floor
    ordered = np.sort(floored[1:])[::-1][: np.count_nonzero(seen) + 1]
    ratio = ordered[:-1] / ordered[1:]
    if float(ratio.max(initial=0.0)) < _MIN_EXCITED_RATIO:
        return np.asarray(seen)
    return np.asarray(size >= ordered[int(np.argmax(ratio))])


# ----------------------------------------------------------------------------
# Records that an identification uses.


def check_records(spectra: MultisineSpectra, observation: Observation) -> NDArray[np.bool_]:
    """Return (r,) True for the records that are held out.

    Raises
    ------
    RsgenError
        A held-out level was not tested, none remains, or nothing moved.
    """
    silent = np.flatnonzero(spectra.rms_response() == 0)
    if len(silent):
        raise RsgenError(
            f"record {silent[0] + 1} of {len(spectra)}: the response is zero; a motion is needed"
        )
    spectra.require_levels(observation.hold_out)
    return spectra.held_out(observation.hold_out)


# ----------------------------------------------------------------------------
# Their file of numpy, ``spectra.npz``, which holds no Python objects.

_NEEDED = ("omega0", "level", "force", "response")
_ORIGINS = ("measured", "simulated")
_OPTIONAL = ("mean_known", "left_out", "per_mass", "base", "across", "origin", "label")
_MAX_UNPACKED_BYTES = 2**31
"""Of all arrays together: twice the largest virtual test."""


def save_spectra(path: str | os.PathLike[str], spectra: MultisineSpectra) -> None:
    """Write the spectra of all records, atomically; ``numpy.load`` and ``load_spectra`` read them.

    Raises
    ------
    RsgenError
        The file cannot be written; an earlier one is unchanged.
    """
    require(spectra, MultisineSpectra, "spectra")
    buffer = io.BytesIO()
    values = {name: getattr(spectra, name) for name in (*_NEEDED, "frequency", *_OPTIONAL)}
    arrays: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    np.savez_compressed(buffer, **arrays)
    write_atomic(Path(path), buffer.getvalue())


def load_spectra(path: str | os.PathLike[str]) -> MultisineSpectra:
    """Read spectra that ``save_spectra`` or a run wrote; findings of the records are not in the file.

    Raises
    ------
    MeasurementError
        There is no such file, an array is missing, damaged, too large or holds no plain numbers, or the
        arrays do not fit together.
    """
    if not Path(path).is_file():
        raise MeasurementError(f"{path}: there is no such file")
    try:
        # of a damaged archive NumPy leaves a file open that it opened itself
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
            size = sum(info.file_size for info in archive.zip.infolist())
            if size > _MAX_UNPACKED_BYTES:
                raise MeasurementError(f"declares {size} bytes; at most {_MAX_UNPACKED_BYTES} are read")
            values = {name: archive[name] for name in (*_NEEDED, *_OPTIONAL) if name in archive}
        values = {name: value if value.shape else value.item() for name, value in values.items()}
        for name in _NEEDED:
            if name not in values:
                raise MeasurementError(f"{name}: missing; spectra have {', '.join(_NEEDED)}")
        if values.get("origin", "measured") not in _ORIGINS:
            raise MeasurementError(f"origin: one of {', '.join(_ORIGINS)} is needed")
        for name in ("mean_known", "per_mass"):
            if not isinstance(values.get(name, True), bool):
                raise MeasurementError(f"{name}: true or false is needed")
        return MultisineSpectra(**values)
    except MeasurementError as fault:
        raise MeasurementError(f"{path}: {fault}") from None
    except Exception as fault:  # an archive, and a header that is Python text: any fault of a parser may come
        reason = printable(one_line(fault))[:160]
        raise MeasurementError(f"{path}: cannot be read as spectra of a multisine: {reason}") from None
