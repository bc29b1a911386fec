"""The table itself: its columns, their defaults, and what each row must satisfy.

Simulated and measured surfaces are indistinguishable downstream. Real tests are no grid, so the table is in
long form; force and response are complex and as measured, never the nominal level.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.arrays import Array, ComplexArray
from rsgen.errors import RsgenError
from rsgen.finding import Finding, Quantity
from rsgen.surface.data_frame import columns_of_frame, frame_of_surface
from rsgen.surface.directions import recognise_directions
from rsgen.text_table import TextTable, short

__all__ = ["COLUMN_UNITS", "OUTCOMES", "ResponseSurface"]

OUTCOMES = (
    "settled: the response repeats with the period of the force",
    "not settled: the response still changes after the longest transient allowed",
    "not settled: the response repeats after two periods of the force, not after one",
    "not settled: the response grows without bound",
    "not settled: the sweep passes faster than the response follows",
    "not measured: force or response is not a number",
)
"""What became of a test point; the table stores the index."""

SWEPT_TOO_FAST, _NOT_MEASURED = 4, 5

SWEEPS = ("rest", "up", "down")

COLUMN_UNITS = {
    "level": "N",
    "frequency": "Hz",
    "force": "N",
    "harmonics": "m",
    "peak": "m",
    "sweep": "",
    "outcome": "",
    "residual": "1",
    "error": "1",
    "stable": "",
}
"""SI unit of every column; that of the level holds where the test held the force."""

_DTYPES: dict[str, type | str] = {
    "force": np.complex128,
    "harmonics": np.complex128,
    "sweep": "U4",
    "outcome": np.int8,
    "stable": np.bool_,
}


def _column(values: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Copy a column into an array that nobody can change; a single value holds at every point."""
    try:
        array = np.array(values, dtype=_DTYPES.get(name, np.float64))
    except (TypeError, ValueError) as fault:
        raise RsgenError(f"surface.{name}: {fault}") from None
    if array.ndim == 0 and len(shape) == 1:
        array = np.full(shape, array)
    if array.ndim != len(shape) or any(
        want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    ):
        expected = ", ".join("any" if size == -1 else str(size) for size in shape)
        known = "" if name == "frequency" else ", as the frequency has them"
        raise RsgenError(
            f"surface.{name}: shape {array.shape}; must be ({expected}), one row a test point{known}"
        )
    array.flags.writeable = False
    return array


def _harmonics(response: Any, harmonics: Any, phase_known: bool) -> NDArray[Any]:
    """Give the harmonics, mean first, from whichever of the two was given."""
    if (response is None) == (harmonics is None):
        raise RsgenError("surface: give the response once, as response= or as harmonics=")
    if harmonics is not None:
        return np.asarray(harmonics)
    array = np.asarray(response)
    if array.ndim > 1:
        return array
    if phase_known and array.size and array.dtype.kind in "biuf":
        raise RsgenError(
            "surface.response: real numbers have no phase; give the complex fundamental "
            "X = amplitude * exp(-1j * lag), or phase_known=False where only amplitudes were measured"
        )
    column = np.atleast_1d(array)
    return np.stack([np.zeros_like(column), column], axis=1)


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class ResponseSurface:
    """Steady states of a structure over force level and frequency; n test points, H harmonics.

    ``ResponseSurface(level, frequency, force, response)`` is enough. A single value for level, force or any
    later column holds at every point.

    Parameters
    ----------
    level
        (n,) nominal force amplitude [N], or amplitude of the displacement [m] where that was held constant;
        names the level a point belongs to, never used as the force.
    frequency
        (n,) [Hz], positive.
    force
        (n,) complex amplitude F of the measured force [N], f(t) = Re F exp(i omega t); real where the phases
        are counted from the force.
    response
        (n,) complex fundamental X of the displacement [m], x(t) = Re X exp(i omega t), so that a displacement
        that lags a real force by phi has X = |X| exp(-i phi); or (n, H+1) harmonics.
    harmonics
        (n, H+1) complex displacement [m], x(t) = Re sum_h X_h exp(i h omega t); column 0 is the mean (real).
        Another name of ``response``, and the name of the column.
    peak
        (n, 2) largest and smallest displacement in a period [m]; NaN where only harmonics are known.
    sweep
        (n,) "rest", "up" or "down": how the point was reached. None: from the order of the frequencies within
        each level, "rest" where they are in no order.
    outcome
        (n,) index into OUTCOMES; 0 is settled. Unsettled points are never used for identification.
        None: settled, but for rows whose force or response is not finite; these count as not measured, and a
        finding says how many they are.
    residual, error
        (n,) how far the state is from repeating, relative to the amplitude, and the estimated relative error
        of the amplitude [1]; NaN where unknown.
    origin
        "simulated" or "measured".
    phase_known
        False where the test recorded amplitudes only: the phase of the response is then without meaning.
    control
        What the test held constant within a level: "force" or "response".
    stable
        (n,) False where the motion would leave this state if the force were held constant; default True.
    findings
        What a reader should know before using the numbers.

    Raises
    ------
    RsgenError
        A shape does not fit, a level or frequency is not finite, a frequency is not positive, a response
        without phases is given as if it had them, a sweep or outcome is unknown.

    Examples
    --------
    >>> surface = ResponseSurface(2.0, [9, 10, 11], 2.0, [1e-3, 2e-3 - 4e-3j, -1e-3 - 1e-4j])
    >>> surface
    ResponseSurface: 3 points, 1 level of 2 N, 9 to 11 Hz, 1 harmonic, measured
    """

    level: Array
    frequency: Array
    force: ComplexArray
    harmonics: ComplexArray
    peak: Array
    sweep: NDArray[np.str_]
    outcome: NDArray[np.int8]
    residual: Array
    error: Array
    origin: str
    phase_known: bool
    control: str
    stable: NDArray[np.bool_]
    findings: tuple[Finding, ...]

    def __init__(
        self,
        level: ArrayLike,
        frequency: ArrayLike,
        force: ArrayLike,
        response: ArrayLike | None = None,
        *,
        harmonics: ArrayLike | None = None,
        peak: ArrayLike | None = None,
        sweep: ArrayLike | None = None,
        outcome: ArrayLike | None = None,
        residual: ArrayLike | None = None,
        error: ArrayLike | None = None,
        origin: str = "measured",
        phase_known: bool = True,
        control: str = "force",
        stable: ArrayLike | None = None,
        findings: tuple[Finding, ...] = (),
    ) -> None:
        n = len(np.atleast_1d(np.asarray(frequency)))
        findings = tuple(findings)
        columns = {
            "frequency": _column(frequency, "frequency", (n,)),
            "level": _column(level, "level", (n,)),
            "force": _column(force, "force", (n,)),
            "harmonics": _column(_harmonics(response, harmonics, phase_known), "harmonics", (n, -1)),
            "peak": _column(np.full((n, 2), np.nan) if peak is None else peak, "peak", (n, 2)),
            "residual": _column(np.nan if residual is None else residual, "residual", (n,)),
            "error": _column(np.nan if error is None else error, "error", (n,)),
            "stable": _column(True if stable is None else stable, "stable", (n,)),
        }
        _check_numbers(columns)
        if sweep is None:
            sweep = recognise_directions(columns["frequency"], columns["level"])
        if outcome is None:
            measured = np.isfinite(columns["force"]) & np.isfinite(columns["harmonics"][:, 1])
            outcome = np.where(measured, 0, _NOT_MEASURED)
            lost = int(np.count_nonzero(~measured))
            if lost:
                numbers = {"points": Quantity(lost), "all": Quantity(n)}
                findings += (Finding("points-not-measured", "warning", numbers=numbers),)
        columns["sweep"] = _column(sweep, "sweep", (n,))
        columns["outcome"] = _column(outcome, "outcome", (n,))
        words = {"origin": origin, "phase_known": bool(phase_known), "control": control, "findings": findings}
        for name, value in (columns | words).items():
            object.__setattr__(self, name, value)
        self._check_words()

    def _check_words(self) -> None:
        if not np.isin(self.sweep, SWEEPS).all():
            raise RsgenError(f"surface.sweep: must be one of {', '.join(SWEEPS)}")
        if len(self) and not ((self.outcome >= 0) & (self.outcome < len(OUTCOMES))).all():
            raise RsgenError(f"surface.outcome: must be 0 to {len(OUTCOMES) - 1}")
        if self.control not in ("force", "response"):
            raise RsgenError(f"surface.control: {self.control!r}; must be 'force' or 'response'")
        if self.origin not in ("simulated", "measured"):
            raise RsgenError(f"surface.origin: {self.origin!r}; must be 'simulated' or 'measured'")

    def __len__(self) -> int:
        """Count the test points."""
        return len(self.frequency)

    @property
    def omega(self) -> Array:
        """(n,) angular frequency [rad/s]."""
        return 2 * np.pi * self.frequency

    @property
    def amplitude(self) -> Array:
        """(n,) X, amplitude of the fundamental of the displacement [m]."""
        return np.abs(self.harmonics[:, 1])

    @property
    def phase(self) -> Array:
        """(n,) lag of the displacement behind the force [rad], in [0, 2 pi)."""
        return np.angle(self.force / self.harmonics[:, 1]) % (2 * np.pi)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """(n,) True where the response repeats with the period of the force."""
        return np.equal(self.outcome, 0)

    @property
    def levels(self) -> Array:
        """The distinct nominal levels, ascending, in ``level_unit``."""
        return np.unique(self.level)

    @property
    def level_unit(self) -> str:
        """Unit of the levels: "N", or "m" where the amplitude of the response was held."""
        return "N" if self.control == "force" else "m"

    @property
    def answer(self) -> Array:
        """(n,) what the test found at its levels: X [m], or |F| [N] where the response was held."""
        return self.amplitude if self.control == "force" else np.abs(self.force)

    @property
    def answer_unit(self) -> str:
        """Unit of ``answer``."""
        return "m" if self.control == "force" else "N"

    def select(self, mask: NDArray[np.bool_] | NDArray[np.intp]) -> ResponseSurface:
        """Keep some points: a boolean mask (n,) or an index array."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return ResponseSurface(**{k: v[mask] if k in COLUMN_UNITS else v for k, v in values.items()})

    @classmethod
    def from_frame(cls, frame: Any, *, degrees: bool = False, **columns: Any) -> ResponseSurface:
        """Make a surface from a data frame (pandas, polars), a structured array or a dict of columns.

        Columns, in any order; others are passed over:

        * ``level``, ``frequency`` [Hz],
        * ``force`` [N], complex or real; or ``force_real`` and ``force_imag``,
        * ``response`` [m], complex; or ``response_real`` and ``response_imag``; or ``amplitude`` and
          ``phase``, the lag of the displacement behind the force (rad; positive: the displacement comes
          later); ``amplitude`` alone is a test without phases,
        * where there are any, ``mean``, ``harmonic_2``, ``harmonic_3``, ..., ``peak_max``, ``peak_min``,
          ``sweep``, ``outcome``, ``residual``, ``error`` and ``stable``, as ``to_frame`` gives them.

        Parameters
        ----------
        degrees
            True where ``phase`` is in degrees.
        columns
            Further arguments of ``ResponseSurface``, such as ``origin`` or ``control``.

        Raises
        ------
        RsgenError
            A column is missing; the message names those that there are.
        """
        return cls(**{**columns_of_frame(frame, degrees), **columns})

    def to_frame(self) -> Any:
        """Give a ``pandas.DataFrame`` with a row a test point; ``from_frame`` reads it back.

        Raises
        ------
        RsgenError
            pandas is not installed.
        """
        return frame_of_surface(self)

    def __repr__(self) -> str:
        """Size and range in one line."""
        if not len(self):
            return "ResponseSurface: no points"
        levels, unit = self.levels, self.level_unit
        span = f"of {short(levels[0])} {unit}"
        if len(levels) > 1:
            span = f"{short(levels[0])} to {short(levels[-1])} {unit}"
        unsettled = len(self) - int(np.count_nonzero(self.settled))
        count = self.harmonics.shape[1] - 1
        parts = [
            f"{len(self)} points",
            f"{unsettled} not settled" if unsettled else "",
            f"{len(levels)} level{'s' if len(levels) > 1 else ''} {span}",
            f"{short(self.frequency.min())} to {short(self.frequency.max())} Hz",
            f"{count} harmonic{'s' if count > 1 else ''}",
            "" if self.phase_known else "phase not measured",
            "response held" if self.control == "response" else "",
            self.origin,
        ]
        return f"ResponseSurface: {', '.join(part for part in parts if part)}"

    def _repr_html_(self) -> str:
        rows = []
        for level in self.levels:
            f, X = self.frequency[self.level == level], self.amplitude[self.level == level]
            top = np.max(X, initial=0.0, where=np.isfinite(X))
            rows.append((short(level), len(f), short(f.min()), short(f.max()), short(top)))
        heads = (f"level [{self.level_unit}]", "points", "from [Hz]", "to [Hz]", "largest amplitude [m]")
        return TextTable(heads, tuple(rows), caption=repr(self)).html()


def _check_numbers(columns: dict[str, NDArray[Any]]) -> None:
    if columns["harmonics"].shape[1] < 2:
        raise RsgenError("surface.harmonics: needs at least the mean and the fundamental")
    frequency, level = columns["frequency"], columns["level"]
    if not np.all(np.isfinite(frequency) & (frequency > 0)):
        raise RsgenError("surface.frequency: must be positive and finite everywhere")
    if not np.isfinite(level).all():
        row = int(np.argmin(np.isfinite(level)))
        raise RsgenError(f"surface.level: {level[row]} in row {row}; must be finite everywhere")
    if (level < 0).any():
        row = int(np.argmax(level < 0))
        raise RsgenError(f"surface.level: {level[row]:g} in row {row}; an amplitude must not be negative")
