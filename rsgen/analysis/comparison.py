"""Identified against true, with a verdict for every parameter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError, require
from rsgen.common.finding import Finding, Verdict, quantities, reach_verdict
from rsgen.common.text_table import Printed, TextTable, lookup, short, with_error
from rsgen.data.oscillator import Oscillator
from rsgen.identification.prediction import Prediction
from rsgen.identification.results import Estimate, Identification
from rsgen.law.memory import force_keys
from rsgen.law.motion import sine_motion
from rsgen.law.numeric import compile_law, in_order

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
    rest, shares = np.zeros(_FORCE_POINTS), np.linspace(-1, 1, _FORCE_POINTS)
    x, v = shares * float(size.max()), rest
    if key == "damping_force":
        x, v = rest, shares * float((2 * np.pi * curve.frequency[chosen] * size).max())
    # half a step at zero would leave a jump's mean value there, for both forces alike
    return law.force(x, v, point) - law.force(rest, rest, point)
