"""Identifications of one structure side by side: by laws, backgrounds, fixed values, or tests."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import hypot, inf, isfinite, nan
from typing import Any

import numpy as np

from rsgen.common.errors import RsgenError, require
from rsgen.common.finding import Finding, Verdict, quantities
from rsgen.common.text_table import Printed, TextTable, aligned, lookup, short
from rsgen.common.tolerances import CONFIDENCE_TEXT, ROUND_OFF, interval_sigmas
from rsgen.formula.printing import write
from rsgen.formula.reading import parse
from rsgen.identification.results import Estimate, Identification
from rsgen.identification.results.alternatives import Alternative
from rsgen.law.numeric import mirror_image


@dataclass(frozen=True, slots=True, eq=False)
class ComparedFit:
    """One result as a comparison takes it.

    Parameters
    ----------
    name
        The head of its column.
    estimates, background
        Of the law with the mass, fixed values among them, and of the background.
    verdict
        What the result is worth.
    misfit
        Relative to force and response [1].
    held_out
        Relative error of the predicted response [1] by level and sweep, the largest of several records.
    significance
        Root of the gain of an alternative, in standard errors of the noise; NaN of an identification.
    law
        The force whose mirror image fits as well, "" where the test shows the direction.
    """

    name: str
    estimates: tuple[Estimate, ...]
    background: tuple[Estimate, ...]
    verdict: Verdict
    misfit: float
    held_out: Mapping[str, float]
    significance: float = nan
    law: str = ""

    @classmethod
    def of(cls, found: Identification, name: str) -> ComparedFit:
        """Take these from an identification."""
        background = () if found.background is None else found.background.estimates
        scores = [(one.level, one.level_unit, getattr(one, "sweep", ""), one.error) for one in found.held_out]
        estimates = (*found.refined, *found.fixed)
        errors, law = errors_by_level(scores), mirrored_law(write(found.model.force), found.findings)
        return cls(name, estimates, background, found.verdict, found.residual, errors, law=law)

    def mirrored(self, names: Collection[str]) -> ComparedFit:
        """Return this fit with the values of the mirror image of its law; ``names`` are what differs."""
        images = mirror_image(parse(self.law), names) if self.law else {}
        known, mirrored = {one.name: one for one in self.estimates}, list[Estimate]()
        for own in self.estimates:
            source, sign = images.get(own.name, (own.name, 1.0))
            one = known.get(source, own)
            low, high = sorted(sign * end for end in one.interval)
            mirrored.append(replace(one, name=own.name, value=sign * one.value, interval=(low, high)))
        return replace(self, estimates=tuple(mirrored))

    def shifted(self, name: str, other: Alternative, errors: Mapping[str, float]) -> ComparedFit:
        """Return an alternative to this fit, to first order, with 95 % intervals by noise alone.

        The variance of an additional parameter, along its shift, is added to that of the fit.
        """
        shifts, significance = dict(zip(errors, other.shift.tolist(), strict=False)), other.gain**0.5

        def shift(one: Estimate) -> Estimate:
            if not one.standard_error:
                return one
            value = one.value + shifts[one.name]
            error = hypot(errors[one.name], shifts[one.name] / significance)
            half = float(interval_sigmas()) * error
            return Estimate(one.name, value, error, (value - half, value + half), one.unit, one.finding)

        estimates = tuple(map(shift, self.estimates))
        return ComparedFit(name, estimates, (), Verdict("not judged"), nan, {}, significance)


def mirrored_law(law: str, findings: Iterable[Finding]) -> str:
    """Return the law where findings say that its mirror image fits as well, else ""."""
    return law if any(f.code == "mirror-image-fits" and "side" not in f.names for f in findings) else ""


def errors_by_level(scores: Iterable[tuple[float, str, str, float]]) -> dict[str, float]:
    """Name errors by level, its unit, and sweep; of several records of a level the largest counts."""
    return {
        " ".join(f"{level:.4g} {unit} {sweep}".split()): error for level, unit, sweep, error in sorted(scores)
    }


@dataclass(frozen=True, slots=True)
class FitRow:
    """One parameter in every fit.

    Parameters
    ----------
    name, unit
        Of the parameter. One that has another unit elsewhere is another parameter, in a row of its own.
    estimates
        One a fit; None where its law, or background, has no such parameter.
    """

    name: str
    unit: str
    estimates: tuple[Estimate | None, ...]

    @property
    def shifts(self) -> tuple[float, ...]:
        """Change from the first fit in standard errors of a difference of independent tests, NaN where not
        known. Of one test the errors are correlated, and the difference is the more certain.
        """
        return tuple(_shift(self.estimates[0], other) for other in self.estimates)

    @property
    def disjoint(self) -> tuple[bool, ...]:
        """True where the 95 % interval has nothing in common with that of the first fit."""
        return tuple(_disjoint(self.estimates[0], other) for other in self.estimates)

    def _cells(self) -> list[str]:
        shown = [""] * len(self.estimates)
        for i, one in enumerate(self.estimates):
            if one is not None:
                _, value, interval, _, finding = one.cells
                shown[i] = f"{value} ({interval})" if value else finding
        cells = shown[:1]
        for text, shift, disjoint in zip(shown[1:], self.shifts[1:], self.disjoint[1:], strict=True):
            cells += [text, f"{short(shift, 2)}{' disjoint' if disjoint else ''}"]
        return cells


def _shift(first: Estimate | None, other: Estimate | None) -> float:
    if first is None or other is None:
        return nan
    spread = hypot(first.standard_error, other.standard_error)
    return (other.value - first.value) / spread if 0 < spread < inf else nan


def _disjoint(first: Estimate | None, other: Estimate | None) -> bool:
    # what is fixed has no interval
    if first is None or other is None or not first.standard_error or not other.standard_error:
        return False
    (low, high), (lower, upper) = first.interval, other.interval
    return max(low, lower) - min(high, upper) > ROUND_OFF * abs(first.value)


def _differences(first: ComparedFit, second: ComparedFit) -> dict[str, float]:
    """Return the size of the shift of each value of which the intervals are disjoint."""
    rows = _rows([first.estimates, second.estimates])
    return {row.name: abs(_shift(*row.estimates)) for row in rows if _disjoint(*row.estimates)}


_COLUMNS = 80
"""Of a terminal."""

_ABOUT_ROWS = (
    f"parameters: value ({CONFIDENCE_TEXT} interval); shift: from the first fit, in standard errors of a "
    "difference; misfit: of force and response, held-out error: of the response, both relative; "
    "significance: how many standard errors of the noise an alternative stands out"
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FitComparison(Printed):
    """Fits side by side: ``comparison["k3"]`` is the row of a parameter, iterating gives all rows.

    Parameters
    ----------
    fits
        In the order of the columns.
    """

    fits: tuple[ComparedFit, ...]

    @property
    def rows(self) -> tuple[FitRow, ...]:
        """Parameters of the laws and the mass."""
        return _rows([fit.estimates for fit in self.fits])

    @property
    def background(self) -> tuple[FitRow, ...]:
        """Parameters of the backgrounds."""
        return _rows([fit.background for fit in self.fits])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The finding "results-disagree" where two results are usable, and intervals of theirs disjoint.

        Of mirror images of one law, where no test shows the direction, it is the remark "mirror-image-fits".
        """
        differing, images = list[tuple[float, str, str, str]](), list[Finding]()
        for first, second in combinations((fit for fit in self.fits if fit.verdict.usable), 2):
            found, names = _differences(first, second), {"first": first.name, "second": second.name}
            if found and first.law == second.law and not _differences(first.mirrored(found), second):
                images.append(Finding("mirror-image-fits", "info", names=names))
            else:
                differing += [(shift, name, first.name, second.name) for name, shift in found.items()]
        if not differing:
            return tuple(images)
        shift, _, one, other = max(differing)
        names = {"values": ", ".join(dict.fromkeys(name for _, name, _, _ in differing))}
        names |= {"first": one, "second": other}
        return (Finding("results-disagree", "doubt", numbers=quantities(shift=shift), names=names), *images)

    def __getitem__(self, name: str) -> FitRow:
        """First row of a parameter, of the mass ("m") or of the background.

        Raises
        ------
        RsgenError
            There is none; it is a ``KeyError``, too.
        """
        return lookup(name, {row.name: row for row in reversed((*self.rows, *self.background))}, "parameter")

    def __iter__(self) -> Iterator[FitRow]:
        return iter((*self.rows, *self.background))

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the numbers of every parameter and fit by name; parameters that a law lacks are left out."""
        return [
            {
                "name": row.name,
                "fit": fit.name,
                "value": one.value,
                "standard_error": one.standard_error,
                "lower": one.interval[0],
                "upper": one.interval[1],
                "unit": row.unit,
                "shift": shift,
                "disjoint": disjoint,
            }
            for row in self
            for fit, one, shift, disjoint in zip(
                self.fits, row.estimates, row.shifts, row.disjoint, strict=True
            )
            if one is not None
        ]

    def __repr__(self) -> str:
        """Return the table as text: where it is wider than a terminal each parameter with a line a fit."""
        table = self.table
        if max(map(len, aligned([table.heads, *table.rows]))) <= _COLUMNS:
            return str(table)
        lines = [("", "unit", "fit", "value", "shift")]
        for name, unit, first, *others in table.rows:
            cells = zip(self.fits, (first, *others[::2]), ("", *others[1::2]), strict=True)
            told = [(fit.name, text, shift) for fit, text, shift in cells if text or shift]
            lines += [((name, unit) if one is told[0] else ("", "")) + one for one in told]
        return "\n".join([*aligned(lines), *table.notes])

    @property
    def table(self) -> TextTable:
        """Return a row for each parameter, misfit, held-out error and verdict; a column for each fit."""
        levels = dict.fromkeys(level for fit in self.fits for level in fit.held_out)
        about = {"misfit": [short(fit.misfit, 2) for fit in self.fits]}
        about |= {
            f"held-out error, {level}": [short(fit.held_out.get(level, nan), 2) for fit in self.fits]
            for level in levels
        }
        about["significance"] = [short(fit.significance, 2) for fit in self.fits]
        about["verdict"] = [str(fit.verdict) for fit in self.fits]
        rows = [(row.name, row.unit, *row._cells()) for row in self]
        for head, (first, *others) in about.items():
            if first or any(others):
                rows.append((head, "", first, *(cell for text in others for cell in (text, ""))))
        first, *others = [fit.name for fit in self.fits]
        heads = ("", "unit", first, *(head for name in others for head in (name, "shift")))
        return TextTable(heads, tuple(rows), notes=(_ABOUT_ROWS, *map(str, self.findings)))


def _rows(fits: Sequence[tuple[Estimate, ...]]) -> tuple[FitRow, ...]:
    known = [{(one.name, one.unit): one for one in fit} for fit in fits]
    keys = dict.fromkeys(key for fit in known for key in fit)
    return tuple(FitRow(*key, tuple(fit.get(key) for fit in known)) for key in keys)


def compare_fits(
    found: Identification | Sequence[Identification], names: Sequence[str] | None = None
) -> FitComparison:
    """Set identifications of one test, or of one structure, side by side.

    Parameters
    ----------
    found
        With different laws, backgrounds, fixed values, or of different tests; the first is the reference.
        Those of multisines may be among them. One without a list is compared with its ``alternatives``: of
        each kind the one that widens the intervals most, to first order, with errors by noise alone.
    names
        One a fit, for the heads of the columns; None: 1, 2, ...

    Raises
    ------
    RsgenError
        There is no identification, or not as many names as fits.
    """
    if isinstance(names, Identification):
        raise RsgenError("names: Identification; give a list of fits: compare_fits([one, other])")
    if isinstance(found, Identification):
        fits = _with_alternatives(found)
    else:
        require(found, Sequence, "found")
        for one in found:
            require(one, Identification, "found")
        fits = [ComparedFit.of(one, str(number)) for number, one in enumerate(found, 1)]
    heads = [fit.name for fit in fits] if names is None else [*map(str, names)]
    if not fits or len(heads) != len(fits):
        raise RsgenError(f"names: {len(heads)} of {len(fits)} fits; give one or more fits, and each a name")
    return FitComparison(tuple(replace(fit, name=head) for fit, head in zip(fits, heads, strict=True)))


def _with_alternatives(found: Identification) -> list[ComparedFit]:
    others, fit = found.alternatives, replace(ComparedFit.of(found, "identified"), background=())
    errors = dict(zip(others.names, others.error.tolist(), strict=True))
    stated = any(isfinite(one.standard_error) for one in found.refined)
    largest = others.largest(np.append(found.solution, found.mass)) if stated else {}
    return [fit, *(fit.shifted(name, one, errors) for name, one in largest.items() if one.gain > 0)]
