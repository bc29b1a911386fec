"""Records of a test, points of sines and periods of a multisine, and what a test says of itself before them.

A record is one periodic state of the structure. Force and motions are series of lines over its base
frequency, s(t) = Re sum_h S_h exp(i h omega0 t), the mean first: a point of sines has one driven line and its
harmonics, a record of a multisine many. Every record belongs to a level, by which levels are held out.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from hashlib import sha256
from math import nan
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.formula.units import PER_UNIT_MASS, WHOLE, ForceUnits, quantity_text

QUANTITIES = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
"""Quantities of a motion, each the derivative of the one before, and their units."""

DERIVATIVE = {quantity: order for order, quantity in enumerate(QUANTITIES)}
"""Order of the derivative of the displacement that each quantity is."""

BASE_UNITS = {"": "N"} | QUANTITIES
"""Unit of levels: of the force, or of the motion of a driven base."""

CHANNEL_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,39}")
"""Name that a channel or sensor may have: it stands in sums, and in names of columns."""

FILE_ROUND_OFF = 1e-6
"""Relative difference of frequencies, or of an amount from its nominal level, that is round-off of files."""
MIN_POINTS_OF_RUN = 8
"""Points of a run or level from which it is compared with others and its quantiles are used."""
LEVEL_TOLERANCE = 1.5
"""Largest factor between a force and its nominal level: shakers drop at a resonance, but by less."""
LEVEL_DIGITS = 3
"""Digits of a level in pages and messages, at least; more where two would have one name."""


def below_acceleration(quantity: str | None) -> int:
    """Return the number of derivatives from a quantity to the acceleration; None is a displacement."""
    return DERIVATIVE["acceleration"] - DERIVATIVE[quantity or "displacement"]


def levels_off(levels: Array, amounts: Array, known: Iterable[Finding] = ()) -> list[int]:
    """Return the places of the levels, fewer than half, that are another multiple of their measured amounts
    than the rest by more than the tolerance; none where a known finding says that levels disagree.

    Examples
    --------
    >>> levels_off(np.array([1.0, 3.0, 6.0, 10.0]), np.array([1.0, 3.0, 3.0, 9.0]))
    [2]
    """
    ratio = np.log(amounts / levels)
    off = np.flatnonzero(np.abs(ratio - np.median(ratio)) > np.log(LEVEL_TOLERANCE)) if len(ratio) else ratio
    said = any(finding.code == "levels-disagree" for finding in known)
    return [] if said or 2 * len(off) >= len(ratio) else [*map(int, off)]


def misnamed_levels(levels: Array, amounts: Array, known: Sequence[Finding]) -> list[Finding]:
    """Return findings about levels that are another multiple of their forces [N] than most, or forces of one
    another: numbers of runs are neither. What is known is not said again.
    """
    if off := levels_off(levels, amounts, known):
        numbers = quantities("N", level=levels[off[0]], force=amounts[off[0]])
        others = (f"{quantity_text(amounts[at], 'N')} at {quantity_text(levels[at], 'N')}" for at in off[1:])
        return [Finding("levels-disagree", "doubt", "", numbers, {"others": ", ".join(others)})]
    near = np.abs(np.log(np.sort(amounts) / levels)) < np.log(LEVEL_TOLERANCE)
    if not near.all() or any(finding.code == "levels-swapped" for finding in known):
        return []
    return swapped_levels(levels, amounts, LEVEL_TOLERANCE, "N")


def swapped_levels(
    levels: Array, amounts: Array, factor: float, unit: str, *, labels: bool = False
) -> list[Finding]:
    """Return a finding about the first two levels of which the lower one was driven harder by more than a
    factor: their labels or files are swapped. Levels (k,) are in the unit of the amounts, or are labels.
    """
    turned = np.flatnonzero(amounts[:-1] > factor * amounts[1:])
    if not len(turned):
        return []
    low, high = turned[0], turned[0] + 1
    numbers = quantities("" if labels else unit, low=levels[low], high=levels[high])
    numbers |= quantities(unit, low_measured=amounts[low], high_measured=amounts[high])
    return [Finding("levels-swapped", "doubt", numbers=numbers)]


def level_name(level: float, unit: str, label: str = "") -> str:
    """Return the name of a level in pages, figures and messages: its amount, after its label if it has one.

    Examples
    --------
    >>> level_name(6.96, "N"), level_name(0.217, "N", "2")
    ('6.96 N', '2 (217 mN)')
    """
    return f"{label} ({quantity_text(level, unit)})" if label else quantity_text(level, unit)


def with_label(test: Records, finding: Finding) -> Finding:
    """Return a finding about a level of a test with the label of that, which is named first; others as is."""
    level = finding.numbers.get("level", Quantity(nan))
    known = level.unit == test.level_unit and "label" not in finding.numbers
    label = test.label_of(level.value) if known else ""
    return replace(finding, names={"label": label, **finding.names}) if label else finding


def match_level(levels: Array, asked: float) -> float | None:
    """Return the level that equals a number within its digits, or else is the only one near; None without.

    Parameters
    ----------
    levels
        (k,) levels there are, different from each other.
    asked
        As typed or copied from a page; its digits count, but three at least.

    Examples
    --------
    >>> match_level(np.array([2.386357e-09, 5.1e-09]), 2.38636e-09)
    2.386357e-09
    >>> match_level(np.array([0.2994, 0.8008]), 0.8)
    0.8008
    >>> match_level(np.array([1.962, 3.921]), 3.92266), match_level(np.array([2.6, 5.0]), 3.0)
    (3.921, None)
    """
    exact = [float(level) for level in levels if abs(level - asked) <= FILE_ROUND_OFF * abs(asked)]
    if exact:
        return min(exact, key=lambda level: abs(level - asked))
    mantissa = f"{asked:.15e}".partition("e")[0].replace(".", "").lstrip("-").rstrip("0")
    digits = max(LEVEL_DIGITS, len(mantissa))
    alike = [float(level) for level in levels if float(f"{level:.{digits}g}") == float(f"{asked:.{digits}g}")]
    if not alike:
        # names of levels are rounder than the forces that were measured, and 0.4 g is 3.92266 m/s^2
        near = 5 * 10.0**-LEVEL_DIGITS * abs(asked)
        alike = [float(level) for level in levels if abs(level - asked) <= near]
    return alike[0] if len(alike) == 1 else None


class Records(ABC):
    """Records of one test; its kinds are ``ResponseSurface`` and ``MultisineSpectra``, both dataclasses."""

    __slots__ = ()
    columns: ClassVar[tuple[str, ...]]
    """Attributes with a row a record: arrays, dicts of arrays; or a number for all records, or None."""

    level: Array
    label: Array | None
    per_mass: bool
    phase_known: bool
    base: str
    origin: str
    findings: tuple[Finding, ...]

    def __len__(self) -> int:
        """Count the records."""
        return len(self.level)

    @property
    @abstractmethod
    def signals(self) -> Mapping[str, ComplexArray]:
        """Lines of force and motions by name, a row a record, the last axis the lines."""

    @property
    def levels(self) -> Array:
        """The distinct nominal levels, ascending, in ``level_unit``."""
        return np.unique(self.level)

    @property
    def units(self) -> ForceUnits:
        """Units of force and parameters, per mass or not."""
        return PER_UNIT_MASS if self.per_mass else WHOLE

    @property
    def force_unit(self) -> str:
        """Unit of the force: "N", or "m/s^2" (N/kg) where it is one per mass."""
        return self.units.force

    @property
    def level_unit(self) -> str:
        """Unit of the levels: of the force, "m" where the response was held, or of the motion of a base."""
        if self.response_held:
            return "m"
        return BASE_UNITS[self.base] if self.base else self.force_unit

    @property
    def response_held(self) -> bool:
        """Return whether levels are amplitudes of the response, and the force is the measured result."""
        return False

    @property
    def limits(self) -> tuple[Finding, ...]:
        """Return findings about what the records of this test cannot determine: phase, absolute mass."""
        limits = (
            (Finding("not-recorded", "info", names={"signal": "phase"}), not self.phase_known),
            (Finding("per-unit-mass", "info"), self.per_mass),
        )
        return tuple(finding for finding, holds in limits if holds)

    @property
    def level_names(self) -> str:
        """All levels as ``hold_out`` takes them, by their labels where they have any, with their unit."""
        if self.label is None:
            return f"{', '.join(f'{one:g}' for one in self.levels)} {self.level_unit}"
        pairs = np.unique([self.label, self.level], axis=1).T
        return ", ".join(level_name(level, self.level_unit, f"{label:g}") for label, level in pairs)

    def label_of(self, level: float) -> str:
        """Return the labels of a level as text; "" where it has none."""
        if self.label is None:
            return ""
        return ", ".join(f"{name:g}" for name in np.unique(self.label[self.level == level]))

    def _named(self, asked: float) -> float | None:
        return None if self.label is None else match_level(np.unique(self.label), asked)

    def find_level(self, asked: float) -> float | None:
        """Return the level with this label, or else with this amount; None without one."""
        named = self._named(asked)
        return match_level(self.levels, asked) if named is None else float(self.level[self.label == named][0])

    def require_levels(self, asked: Sequence[float]) -> None:
        """Raise an RsgenError for levels held out of which one was not tested, or none remains."""
        for level in asked:
            if self.find_level(level) is None:
                unit = self.level_unit
                has = f"it has {self.level_names}"
                if "sweep" in self.columns and MIN_POINTS_OF_RUN < len(self) == len(self.levels):
                    has = "each point has its own; give all of a sweep its nominal one, as by numpy.repeat"
                raise RsgenError(f"hold_out: no level {level:g} {unit} in the test; {has}")
        if asked and self.held_out(asked).all():
            raise RsgenError("hold_out: holds every level back; at least one must remain")

    def held_out(self, asked: Iterable[float]) -> NDArray[np.bool_]:
        """Return (r,) True for records of the levels asked for, by their labels, else by their amounts."""
        held = np.zeros(len(self), dtype=np.bool_)
        for level in asked:
            named, amount = self._named(level), self.find_level(level)
            if named is not None:
                held |= self.label == named
            elif amount is not None:
                held |= np.isclose(self.level, amount, rtol=FILE_ROUND_OFF, atol=0.0)
        return held

    def select(self, chosen: Sequence[int] | NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        """Return some of the records, by a boolean mask (r,) or an index array."""
        rows = np.asarray(chosen)
        # both kinds of records are dataclasses, which this class does not say
        values: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}  # type: ignore[arg-type]
        for name in self.columns:
            if np.ndim(values[name]):
                values[name] = values[name][rows]
        return type(self)(**values)

    def on_mass(self, mass: float) -> Self:
        """Return the test with forces [N] on a mass m [kg], if they are per mass; unchanged if m is NaN."""
        if not (self.per_mass and np.isfinite(mass)):
            return self
        # a dataclass, as in ``select``
        return replace(self, force=mass * self.signals["force"], per_mass=False)  # type: ignore[type-var]


def repeated_run(runs: Iterable[tuple[str, NDArray[Any]]]) -> list[Finding]:
    """Return a finding about the first two runs, by name, with equal readings (n,): no noise repeats."""
    seen: dict[bytes, tuple[int, str]] = {}
    for run, (name, readings) in enumerate(runs):
        number, first = seen.setdefault(sha256(readings.tobytes()).digest(), (run, name))
        if number < run:
            return [Finding("run-repeated", "doubt", names={"first": first, "second": name})]
    return []


def copied_levels(records: Records) -> list[Finding]:
    """Return a finding about two levels with one response; none where reading made one, which names files."""
    if any(finding.code == "run-repeated" for finding in records.findings):
        return []
    response = {level: records.signals["response"][records.level == level] for level in records.levels}
    return repeated_run(
        (f"the level of {level:g} {records.level_unit}", readings)
        for level, readings in response.items()
        if len(np.unique(readings)) >= MIN_POINTS_OF_RUN
    )


# ----------------------------------------------------------------------------
# A test before it is run or read: what it says of itself.


class PlannedTest(ABC):
    """A test, simulated or measured; the defaults are those of a test without prior knowledge."""

    __slots__ = ()

    @property
    def all_files(self) -> tuple[Path, ...]:
        """The measured files, each once."""
        return ()

    @property
    def many_lines(self) -> bool:
        """Return whether a record's force has many lines, so that the test gives spectra and no surface."""
        return False

    @property
    def in_time(self) -> bool:
        """Return whether the law is integrated in time."""
        return False

    @property
    def planned_levels(self) -> Array:
        """(l,) levels that are known beforehand."""
        return np.zeros(0)

    @property
    def noise_seed(self) -> int | None:
        """Seed of simulated noise; None without it."""
        return None

    def known_mass(self, mass: float | None) -> float | None:
        """Return the mass [kg] given to identification, from that of the case; None: it is identified."""
        return mass

    def planned(self) -> Any:
        """Return the planned surface or spectra, each record with the same response; None for files."""
        return None

    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Return kind and settings of the test, without the extent of its records."""

    @abstractmethod
    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
