"""Identified against true, with a verdict for every parameter; and identifications side by side."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import hypot, inf, isfinite, log, nan
from typing import Any

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError, require
from rsgen.common.finding import Finding, Verdict, quantities, reach_verdict
from rsgen.common.text_table import Printed, TextTable, aligned, lookup, short, with_error
from rsgen.common.tolerances import CONFIDENCE_TEXT, MISFIT_NEGLIGIBLE, ROUND_OFF, interval_sigmas
from rsgen.data.oscillator import Oscillator
from rsgen.formula.printing import write
from rsgen.formula.reading import parse
from rsgen.identification.prediction import Prediction
from rsgen.identification.results import Estimate, Identification
from rsgen.identification.results.alternatives import Alternative
from rsgen.law.memory import force_keys
from rsgen.law.motion import sine_motion
from rsgen.law.numeric import compile_law, in_order, mirror_image

_FORCE_POINTS = 401

_LOOPS = 9
"""Amplitudes from the smallest to the largest tested one, evenly spaced by ratio."""


@dataclass(frozen=True, slots=True)
class Row:
    """One parameter, or one force over the tested range, identified against true.

    Parameters
    ----------
    name
        Parameter, "m", or a key of FORCE_KEYS.
    unit
        SI unit, "" where unknown.
    true
        The truth; NaN where none is known, and for forces the largest absolute true force [N].
    paper, first_order, refined
        The three estimates; for forces the value is the largest absolute identified force [N].
    relative_error
        |refined - true| / |true|, for forces largest deviation over largest true force; NaN without truth.
    paper_error, first_order_error
        The same for the other two estimates.
    tolerance
        From ``accept``; None where nothing is asked.
    passed
        True where the error is within tolerance, or no tolerance is given.
    """

    name: str
    unit: str
    true: float
    paper: Estimate | None
    first_order: Estimate | None
    refined: Estimate
    relative_error: float
    paper_error: float
    first_order_error: float
    tolerance: float | None
    passed: bool


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Printed):
    """One row a parameter (and a judged force); passed where every error is within its tolerance.

    ``comparison["k3"]`` is the row of a parameter, "m" that of the mass.
    """

    rows: tuple[Row, ...]
    passed: bool

    def __getitem__(self, name: str) -> Row:
        """Row of a parameter or of a force.

        Raises
        ------
        RsgenError
            There is none; it is a ``KeyError``, too.
        """
        return lookup(name, {row.name: row for row in self.rows}, "row")

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def outcome(self) -> Finding | None:
        """The judgement as a finding; None where nothing was judged."""
        judged = [row for row in self if row.tolerance is not None]
        if not judged:
            return None
        outside = ", ".join(row.name for row in judged if not row.passed)
        largest = max((row.relative_error for row in judged), default=nan)
        numbers = quantities(judged=len(judged), largest=largest)
        names = {"outside": outside} if outside else {}
        return Finding("values-judged", "info", numbers=numbers, names=names)

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        rows = tuple(
            (
                row.name,
                short(row.true),
                short(row.refined.value, with_error(row.refined.value, row.refined.standard_error)),
                row.unit,
                short(row.relative_error, 2),
                "" if row.tolerance is None else short(row.tolerance, 2),
                "" if row.tolerance is None else "within" if row.passed else "outside",
            )
            for row in self
        )
        heads = ("parameter", "true", "identified", "unit", "relative error", "tolerance", "verdict")
        return TextTable(heads, rows)


def compare(
    identification: Identification,
    truth: Mapping[str, float] | Oscillator | None = None,
    accept: Mapping[str, float] | None = None,
) -> Comparison:
    """Hold the estimates against the truth.

    Parameters
    ----------
    identification
        What was identified.
    truth
        True values by parameter name, "m" for the mass, or an oscillator; None or a part where they are not
        known. Those of equal terms, such as two sliders, are put in the order of the estimates.
    accept
        Largest relative error of the refined estimate, by parameter name or by a name of FORCE_KEYS.

    Returns
    -------
    Comparison
        One row a parameter in the order of the refined estimates, then one a judged force.

    Raises
    ------
    RsgenError
        A name in ``truth`` is no parameter; one in ``accept`` is no parameter and no force, or has no truth.
    """
    require(identification, Identification, "identification")
    known = {*identification.model.parameters, "m"}
    if isinstance(truth, Oscillator):
        # another law may have been fitted: what both have in common is compared
        truth = {name: value for name, value in {**truth.values, "m": truth.mass}.items() if name in known}
    for place, values in (("truth", truth), ("accept", accept)):
        if isinstance(values, Identification):
            raise RsgenError(f"{place}: Identification; rs.compare_fits sets identifications side by side")
        require({} if values is None else values, Mapping, place)
    truth, accept = dict(truth or {}), dict(accept or {})
    _check_names(identification, truth, accept)
    # no test says which of equal terms is which
    truth = in_order(identification.model.force, truth)
    rows = []
    kinds = identification.refined, identification.paper, identification.first_order
    for found in zip(*kinds, strict=True):
        name = found[0].name
        true = truth.get(name, nan)
        # a true zero leaves only the absolute error to judge
        errors = [abs(estimate.value - true) / (abs(true) or 1.0) for estimate in found]
        rows.append(_row(found, errors, true, accept.get(name)))
    if set(identification.model.parameters) <= set(truth):
        forces = force_keys(identification.model.force)
        judged = (_force_row(identification, truth, key, accept.get(key)) for key in forces)
        rows += [row for row in judged if row is not None]
    return Comparison(tuple(rows), all(row.passed for row in rows))


def _check_names(
    identification: Identification, truth: Mapping[str, float], accept: Mapping[str, float]
) -> None:
    """Refuse names that are no parameters or forces, and judged ones without a truth."""
    parameters, whole = identification.model.parameters, force_keys(identification.model.force)
    names = [estimate.name for estimate in identification.refined]
    foreign = sorted(map(repr, set(truth) - {*parameters, "m"}))
    if foreign:
        allowed = ", ".join(sorted({*parameters, "m"}))
        raise RsgenError(f"truth: {', '.join(foreign):.200}: no parameter of the law; allowed are {allowed}")
    unknown = sorted(set(accept) - set(names) - set(whole))
    if unknown:
        allowed = ", ".join([*names, *whole])
        raise RsgenError(f"accept: {', '.join(unknown)}: not identified; allowed are {allowed}")
    blind = sorted(name for name in accept if name in names and name not in truth)
    if set(accept) & set(whole):
        blind += [name for name in parameters if name not in truth]
    if blind:
        raise RsgenError(f"accept: no truth for {', '.join(blind)}; every judged value needs one")


def verdict_of(
    identification: Identification, comparison: Comparison | None = None, prediction: Prediction | None = None
) -> Verdict:
    """Reach the verdict on a whole result: what report, notebook, terminal and ``result.json`` say of it.

    Parameters
    ----------
    identification
        Its findings are about test, fit and parameters.
    comparison
        With the truth; None: nothing is judged against tolerances.
    prediction
        Of levels beyond those that the identification held out, whose findings it has; None: of no others.
    """
    require(identification, Identification, "identification")
    if comparison is not None:
        require(comparison, Comparison, "comparison")
    if prediction is not None:
        require(prediction, Prediction, "prediction")
    findings = all_findings(identification, prediction)
    judged = None if comparison is None else comparison.outcome
    if comparison is None or judged is None:
        return reach_verdict(findings, summary=identification.outcome)
    return reach_verdict(findings, comparison.passed, judged)


def all_findings(identification: Identification, prediction: Prediction | None) -> list[Finding]:
    """Return the one list of findings of a result: those of the identification, and then of a prediction."""
    further = () if prediction is None else prediction.findings
    return [*identification.findings, *(f for f in further if f not in identification.findings)]


def _row(found: Sequence[Estimate], errors: list[float], true: float, tolerance: float | None) -> Row:
    """Make a row of the refined, the paper's and the first-order estimate with their errors."""
    refined, paper, first = found
    return Row(
        name=refined.name,
        unit=refined.unit,
        true=true,
        paper=paper,
        first_order=first,
        refined=refined,
        relative_error=errors[0],
        paper_error=errors[1],
        first_order_error=errors[2],
        tolerance=tolerance,
        passed=tolerance is None or (isfinite(errors[0]) and errors[0] <= tolerance),
    )


def _force_row(
    identification: Identification, truth: Mapping[str, float], key: str, tolerance: float | None
) -> Row | None:
    """Hold a whole force against the true one over the tested range; None where it is zero."""
    true = _force(identification, key, truth)
    largest = float(np.max(np.abs(true)))
    if largest == 0 and tolerance is None:
        return None
    found, errors = [], []
    for estimates in (identification.refined, identification.paper, identification.first_order):
        force = _force(identification, key, {e.name: e.value for e in (*estimates, *identification.fixed)})
        found.append(Estimate(key, float(np.max(np.abs(force))), nan, (nan, nan), "N"))
        errors.append(float(np.max(np.abs(force - true))) / (largest or 1.0))
    return _row(found, errors, largest, tolerance)


def _force(identification: Identification, key: str, values: Mapping[str, float]) -> Array:
    """Stiffness force n(x, 0), damping force n(0, v), both without n(0, 0), or loops, over the tests."""
    law = compile_law(identification.model.force)
    point = law.ordered(values)
    curve = identification.curve
    chosen = curve.used if curve.used.any() else np.ones(len(curve.used), dtype=bool)
    size = curve.amplitude[chosen]
    if key == "loop_force":
        amplitude = np.geomspace(float(size.min()), float(size.max()), _LOOPS)
        omega = np.full(_LOOPS, 2 * np.pi * float(np.median(curve.frequency[chosen])))
        return law.along(sine_motion(omega, amplitude), point, _FORCE_POINTS - 1).force
    rest = np.zeros(_FORCE_POINTS)
    if key == "stiffness_force":
        reach = np.linspace(-1, 1, _FORCE_POINTS) * float(size.max())
        x, v = reach, rest
    else:
        reach = np.linspace(-1, 1, _FORCE_POINTS) * float((2 * np.pi * curve.frequency[chosen] * size).max())
        x, v = rest, reach
    # half a step at zero would leave a jump's mean value there, for both forces alike
    return law.force(x, v, point) - law.force(rest, rest, point)


# ----------------------------------------------------------------------------
# Identifications of one structure side by side: by laws, backgrounds, fixed values, or tests.


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

    def bic(self, numbers: int) -> float:
        """Return the BIC of n numbers, n ln(s^2 (1 - q/n)) + q ln n with q free values and the misfit s."""
        free = sum(one.standard_error != 0 for one in (*self.estimates, *self.background))
        # of exact data, truncated waveforms leave the rest
        square = max(self.misfit, MISFIT_NEGLIGIBLE) ** 2 * (1 - min(free / numbers, 0.5))
        return numbers * log(square) + free * log(numbers)

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
    fits = _with_alternatives(found) if isinstance(found, Identification) else _one_by_one(found)
    heads = [fit.name for fit in fits] if names is None else [*map(str, names)]
    if not fits or len(heads) != len(fits):
        raise RsgenError(f"names: {len(heads)} of {len(fits)} fits; give one or more fits, and each a name")
    return FitComparison(tuple(replace(fit, name=head) for fit, head in zip(fits, heads, strict=True)))


def _one_by_one(found: Sequence[Identification]) -> list[ComparedFit]:
    require(found, Sequence, "found")
    for one in found:
        require(one, Identification, "found")
    return [ComparedFit.of(one, str(number)) for number, one in enumerate(found, 1)]


def _with_alternatives(found: Identification) -> list[ComparedFit]:
    others, fit = found.alternatives, replace(ComparedFit.of(found, "identified"), background=())
    errors = dict(zip(others.names, others.error.tolist(), strict=True))
    stated = any(isfinite(one.standard_error) for one in found.refined)
    largest = others.largest(np.append(found.solution, found.mass)) if stated else {}
    return [fit, *(fit.shifted(name, one, errors) for name, one in largest.items() if one.gain > 0)]
