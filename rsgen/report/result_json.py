"""result.json: what a run found, for other programs; the page is made from the same numbers."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import sympy

from rsgen.analysis.comparison import Comparison, Row, all_findings, verdict_of
from rsgen.analysis.fit_comparison import (
    ComparedFit,
    FitComparison,
    compare_fits,
    errors_by_level,
    mirrored_law,
)
from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, StatedVerdict, Verdict
from rsgen.common.output import read_small
from rsgen.common.tolerances import interval_sigmas
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.describing.derivation import derive
from rsgen.describing.function import PrintedComparison
from rsgen.formula.printing import write
from rsgen.formula.units import quantity_text
from rsgen.identification.prediction import HeldOutLevel, Prediction, ResonanceCurve
from rsgen.identification.results import Estimate, Identification, MultisineIdentification, Resonance
from rsgen.identification.results.result import held_out_lines, mass_lines
from rsgen.law.memory import FORCE_KEYS
from rsgen.report.figures import equivalent
from rsgen.report.page_tables import NO_MODAL, Modal
from rsgen.report.provenance import Subject
from rsgen.report.sentences import read_verdict, sentence, state_verdict

if TYPE_CHECKING:
    from rsgen.data.multisine.linear import BestLinear
    from rsgen.identification.ranking import Ranking

SCHEMA = 2

_READ = (1, SCHEMA)
"""Schemas that are read: the first had other codes of findings, ``earlier_codes``."""

_ARRAY_DIGITS = 9
"""Significant digits of the long arrays: more than any test has, less than round-off between machines."""


def finite_or_none(value: float | None) -> float | None:
    """JSON has no NaN and no infinity: what is not known is null."""
    return float(value) if value is not None and math.isfinite(value) else None


def _finite_ones(record: object, names: Iterable[str]) -> dict[str, float | None]:
    """Return the attributes of a record by name, null where they are not known."""
    return {name: finite_or_none(getattr(record, name)) for name in names}


def numbers_or_none(values: Array) -> list[float | None]:
    """Return an array with nine digits, null where it is not known."""
    return [None if not math.isfinite(v) else float(f"{v:.{_ARRAY_DIGITS - 1}e}") for v in values.tolist()]


def _estimate(estimate: Estimate) -> dict[str, Any]:
    entry: dict[str, Any] = {
        **_finite_ones(estimate, ("value", "standard_error")),
        "interval": [finite_or_none(bound) for bound in estimate.interval],
        "interval_by": "profile" if estimate.by_profile else "standard error",
    }
    if estimate.finding is not None:
        entry["remark"] = sentence(estimate.finding)
        entry["finding"] = estimate.finding.to_dict()
    return entry


def _estimates(estimates: Iterable[Estimate]) -> list[dict[str, Any]]:
    return [{"name": one.name, "unit": one.unit, **_estimate(one)} for one in estimates]


def _row(row: Row) -> dict[str, Any]:
    found = {"paper": row.paper, "first_order": row.first_order, "refined": row.refined}
    estimates = {name: None if one is None else _estimate(one) for name, one in found.items()}
    errors = ("paper_error", "first_order_error", "relative_error", "tolerance")
    true = {"name": row.name, "unit": row.unit, "true": finite_or_none(row.true)}
    return {**true, **estimates, **_finite_ones(row, errors), "passed": row.passed}


def rows_entry(comparison: Comparison, *, forces: bool) -> list[dict[str, Any]]:
    """Return the rows of the parameters, or of the judged forces."""
    return [_row(row) for row in comparison.rows if (row.name in FORCE_KEYS) is forces]


def _written(formula: sympy.Expr) -> str | None:
    """Write a formula in rsgen's language; None where an integral remains, which the language has not."""
    return None if formula.has(sympy.Integral) else write(formula)


def elements_entry(subject: Subject) -> list[dict[str, Any]]:
    """Return force, memory, k(X) and c(X) of every element."""
    entries = []
    for element in subject.elements:
        function = derive(element)
        entries.append(
            {
                "name": element.name,
                "force": write(element.force),
                "memory": element.memory,
                "stiffness": _written(function.stiffness),
                "damping": _written(function.damping),
                "closed_form": function.closed_form,
                "checked_to": finite_or_none(function.checked_to),
            }
        )
    return entries


def ranking_entry(ranking: Ranking) -> dict[str, Any]:
    """Return verdict, noise and candidates of a ranking."""
    return {
        "fits": ranking.fits,
        "verdict": [sentence(finding) for finding in ranking.findings],
        "findings": [finding.to_dict() for finding in ranking.findings],
        **_finite_ones(ranking, ("noise", "unexplained")),
        "candidates": [
            {
                "name": candidate.name,
                "force": candidate.force,
                "parameters": candidate.parameters,
                **_finite_ones(candidate, ("held_out_error", "bic")),
                "tied": candidate.tied,
                "converged": candidate.converged,
                **({"fault": candidate.fault} if candidate.fault else {}),
            }
            for candidate in ranking.candidates
        ],
    }


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """Parts of a report, from which page, result.json and notebook are made.

    Parameters
    ----------
    printed
        Printed formulas held against the derivation.
    modal
        The modal table, or why there is none.
    """

    subject: Subject
    table: ResponseSurface | MultisineSpectra
    identification: Identification
    comparison: Comparison
    prediction: Prediction
    printed: Sequence[PrintedComparison] = ()
    modal: Modal = NO_MODAL


def fixed_entry(identification: Identification) -> dict[str, dict[str, Any]]:
    """Return values and units of what was known beforehand, by name."""
    return {one.name: {"value": one.value, "unit": one.unit} for one in identification.fixed}


def build_result(parts: Parts, durations: Mapping[str, float]) -> dict[str, Any]:
    """Return the content of result.json (schema 2); units are SI, what is not known is null.

    "verdict" is a ``StatedVerdict``: what the result is worth, the findings that decided, and what to do
    about each; "passed" says of the tolerances alone whether every judged value is within, true without any.
    "noise" is that of repeats or periods, else the misfit "relative", which is a bound of the noise where it
    has a pattern, as that of a wrong law or mass has.

    Parameters
    ----------
    durations
        Seconds of each stage; "surface" is how long it took to simulate or to read.
    """
    subject, identification, comparison = parts.subject, parts.identification, parts.comparison
    verdict = verdict_of(identification, comparison, parts.prediction)
    findings = all_findings(identification, parts.prediction)
    points, settled, entries = _entries_of(parts, verdict.usable)
    weighed = identification.model_given.weighed
    return {
        "schema": SCHEMA,
        "case": subject.name,
        "title": subject.title,
        "source": subject.source,
        "passed": comparison.passed,
        "verdict": state_verdict(verdict),
        "outcome": sentence(identification.outcome),
        "mass_notes": mass_lines(identification, rms=subject.scale_is_sure),
        "warnings": list(map(sentence, findings)),
        "findings": [finding.to_dict() for finding in findings],
        "mass": finite_or_none(identification.mass),
        "fixed": fixed_entry(identification),
        **({"mass_given": {"value": weighed[0], "standard_error": weighed[1]}} if weighed else {}),
        "parameters": rows_entry(comparison, forces=False),
        "small_motion": _estimates(identification.small_motion),
        "covariance": [list(map(finite_or_none, row)) for row in identification.covariance.tolist()],
        "forces": rows_entry(comparison, forces=True),
        "alternatives": comparison_entry(compare_fits(identification)),
        "elements": elements_entry(subject),
        "residual": {
            "relative": finite_or_none(identification.residual),
            "noise": finite_or_none(identification.noise),
        },
        "printed": list(map(_printed, parts.printed)),
        "surface": {
            "points": points,
            "settled": settled,
            "origin": parts.table.origin,
            "seconds": finite_or_none(durations.get("surface")),
        },
        "resonances": [_resonance(point) for point in identification.resonances],
        "background": _background(identification),
        "predicted": [_predicted(curve) for curve in parts.prediction],
        **entries,
        "ranking": None if identification.ranking is None else ranking_entry(identification.ranking),
    }


def comparison_entry(fits: FitComparison) -> dict[str, Any]:
    """Return verdict and misfit of each fit, and each value with its shift from the first."""
    numbers = ("value", "standard_error", "lower", "upper", "shift")
    return {
        "fits": [
            {
                "name": fit.name,
                "verdict": fit.verdict.state,
                "decided_by": [finding.code for finding in fit.verdict.decided_by],
                **_finite_ones(fit, ("misfit", "significance")),
                "held_out": {level: finite_or_none(error) for level, error in fit.held_out.items()},
            }
            for fit in fits.fits
        ],
        "values": [line | {name: finite_or_none(line[name]) for name in numbers} for line in fits.to_dicts()],
    }


def _printed(formula: PrintedComparison) -> dict[str, Any]:
    return {
        "what": formula.what,
        "formula": write(formula.formula),
        "agrees": formula.agrees,
        "largest_deviation": finite_or_none(formula.largest_deviation),
        "where": "" if formula.agrees else f"X = {quantity_text(formula.amplitude, 'm', 3)}",
    }


def dissipation_entry(surface: ResponseSurface, identification: Identification) -> dict[str, Any]:
    """Return the entry "dissipation" of result.json, SI units; what is not known is null."""
    measured = equivalent.measured_energy(equivalent.mode_surface(surface, identification))
    refined = equivalent.dissipated_energy(identification)
    ends = [0, -1] if math.isfinite(refined.exponent) else []
    return {
        "measured": {
            "exponent": finite_or_none(measured.exponent),
            "standard_error": finite_or_none(measured.error),
            "points": len(measured.amplitude),
        },
        "identified": {
            "amplitude": [float(refined.amplitude[end]) for end in ends],
            "energy": [float(refined.energy[end]) for end in ends],
            "exponent": [float(refined.course[end]) for end in ends],
        },
    }


def _entries_of(parts: Parts, usable: bool) -> tuple[int, int, dict[str, Any]]:
    """Count all and settled points, and return the entries that only a surface has, or only spectra have."""
    table, curve = parts.table, parts.identification.curve
    if isinstance(table, MultisineSpectra):
        return _line_entries(parts, table)
    entries = {
        "equivalent": {
            name: numbers_or_none(getattr(curve, name))
            for name in ("amplitude", "frequency", "stiffness", "damping")
        },
        "dissipation": dissipation_entry(table, parts.identification),
        "modal": modal_entry(parts.modal),
        "held_out": [_held_out(item, usable) for item in parts.prediction.held_out],
    }
    return len(table), int(np.count_nonzero(table.settled)), entries


def _line_entries(parts: Parts, table: MultisineSpectra) -> tuple[int, int, dict[str, Any]]:
    identification = cast("MultisineIdentification", parts.identification)
    # a point is an excited line of a record
    points = int(table.excited().sum())
    entries = {
        "multisine": {
            "records": len(table),
            "periods": table.periods,
            "left_out": np.asarray(table.left_out).tolist(),
            "line_spacing": finite_or_none(table.spacing[0]),
            "levels": numbers_or_none(table.level),
            "rms_force": numbers_or_none(table.rms_force()),
            "rms_response": numbers_or_none(table.rms_response()),
        },
        "best_linear": [_best_linear(one) for one in identification.approximations],
        "modal": modal_entry(parts.modal),
        "held_out": [
            {
                **_finite_ones(one, ("level", "error", "noise")),
                "level_unit": one.level_unit,
                "lines": int(np.count_nonzero(one.judged)),
                "said": held_out_lines([one])[0],
            }
            for one in parts.prediction.records
        ],
    }
    return points, points, entries


def _best_linear(one: BestLinear) -> dict[str, Any]:
    return {
        "records": one.records,
        **_finite_ones(one, ("level", "natural_frequency", "damping_ratio", "stiffness", "mass")),
        "distortion": finite_or_none(one.distortion_share),
        "noise": finite_or_none(one.noise_share),
        "even_lines": finite_or_none(one.even_share),
        "even_lines_bound": finite_or_none(one.even_bound),
        "odd_lines": finite_or_none(one.odd_share),
        "odd_lines_bound": finite_or_none(one.odd_bound),
        "frequency": numbers_or_none(one.frequency),
        "receptance_real": numbers_or_none(one.receptance.real),
        "receptance_imaginary": numbers_or_none(one.receptance.imag),
        "response_noise": numbers_or_none(one.noise),
        "response_distortion": numbers_or_none(one.distortion),
    }


def _resonance(point: Resonance) -> dict[str, Any]:
    """Return the resonance of a level."""
    numbers = _finite_ones(point, ("frequency", "damping_ratio", "amplitude", "stiffness", "damping"))
    return {"level": finite_or_none(point.level), "sweep": point.sweep, **numbers, "jump": point.jump}


def _predicted(curve: ResonanceCurve) -> dict[str, Any]:
    """Return the largest fundamental [m] of a curve, its 95 % band, where it is [Hz], and jumps [Hz, m]."""
    largest = curve.largest if len(curve.frequency) else (math.nan,) * 4
    names = ("frequency", "amplitude", "lower", "upper")
    return {
        "level": finite_or_none(curve.level),
        "level_unit": curve.level_unit,
        **{name: finite_or_none(value) for name, value in zip(names, largest, strict=True)},
        "frequency_interval": list(map(finite_or_none, curve.peak_interval)),
        "travel": list(map(finite_or_none, curve.travel)),
        "travel_interval": list(map(finite_or_none, curve.travel_interval)),
        "acceleration": finite_or_none(curve.acceleration),
        "acceleration_interval": list(map(finite_or_none, curve.acceleration_interval)),
        "still_rising": len(curve.frequency) > 0 and curve.rises_at_end,
        "jumps": [
            jump._asdict()
            | {"interval": list(map(finite_or_none, jump.interval)), "landing": finite_or_none(jump.landing)}
            for jump in curve.jumps
        ],
    }


def _held_out(item: HeldOutLevel, usable: bool = False) -> dict[str, Any]:
    return {
        "level": finite_or_none(item.level),
        "level_unit": item.level_unit,
        "sweep": item.sweep,
        "points": len(item.frequency),
        "missing": item.missing,
        **_finite_ones(item, ("error", "largest_error", "largest_at")),
        "said": held_out_lines([item], usable)[0],
    }


def modal_entry(modal: Modal) -> dict[str, Any] | None:
    """Return the modal table: columns in SI, null where they are not known; or why there is none."""
    table = modal.table
    if table is None:
        return {"reason": modal.reason} if modal.reason else None
    columns = [name + end for name in table.known for end in ("", "_lower", "_upper")]
    return {
        "points": table.points,
        **_finite_ones(table, ("misfit", "mass", "mass_error")),
        "known": list(table.known),
        **{name: numbers_or_none(getattr(table, name)) for name in ("amplitude", *columns)},
        "held_out": [_held_out(item) for item in modal.held_out],
    }


def _background(identification: Identification) -> dict[str, Any] | None:
    """The fitted background; null where none was asked for."""
    background = identification.background
    if background is None:
        return None
    return {
        "kind": background.kind,
        "band": list(background.band),
        "share": finite_or_none(background.share),
        "estimates": _estimates(background.estimates),
    }


_ARRAY = re.compile(r"\[\n\s+((?:[-+.0-9a-z]+,?\s+)+)\]")
"""An array of numbers and nulls as ``json`` indents it; a text has no line end in JSON."""


def result_text(result: Mapping[str, Any]) -> str:
    """Write a result as strict JSON, arrays of numbers on one line each."""
    text = json.dumps(result, indent=1, ensure_ascii=True, allow_nan=False)
    return _ARRAY.sub(lambda array: f"[{' '.join(array[1].split())}]", text) + "\n"


# ----------------------------------------------------------------------------
# A result.json as it is read: small enough, and with all that index, difference and pages take from it.

_MAX_CHARACTERS = 100_000
"""Characters of a name, a unit, a title, which may be a law of thousands; a longer one is none of ours."""
_ERRORS = ("paper_error", "first_order_error", "relative_error")


@dataclass(frozen=True, slots=True)
class Entry:
    """A finished case: its folder and its result.json; forces count where the case judges them."""

    folder: Path
    result: dict[str, Any]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of all parameters, and of forces with a tolerance."""
        judged = [row for row in self.result.get("forces", []) if row.get("tolerance") is not None]
        return [*self.result["parameters"], *judged]

    @property
    def verdict(self) -> StatedVerdict:
        """The verdict on the result; of an older result, as its findings and rows say."""
        return read_verdict(self.result)

    @property
    def law(self) -> str:
        """The force of all elements."""
        return " + ".join(str(element["force"]) for element in self.result.get("elements", []))

    def fit(self, name: str = "") -> ComparedFit:
        """Return the result as ``compare_fits`` takes an identification."""
        fixed, background = self.result.get("fixed", {}), self.result.get("background") or {}
        scores = [
            (
                _number(one["level"]),
                str(one.get("level_unit", "")),
                str(one.get("sweep", "")),
                _number(one["error"]),
            )
            for one in self.result.get("held_out", [])
        ]
        decided = tuple(map(Finding.from_dict, self.verdict["decided_by"]))
        return ComparedFit(
            name,
            (
                *(read_estimate(row, row["refined"] or {}) for row in self.result["parameters"]),
                *(
                    read_estimate({"name": key, **one}, {**one, "standard_error": 0.0})
                    for key, one in fixed.items()
                ),
            ),
            tuple(read_estimate(one, one) for one in background.get("estimates", [])),
            Verdict(self.verdict["state"], decided),
            _number(self.result["residual"]["relative"]),
            errors_by_level(scores),
            law=mirrored_law(self.law, map(Finding.from_dict, self.result.get("findings", []))),
        )


def _number(value: float | None, unknown: float = math.nan) -> float:
    return unknown if value is None else float(value)


def read_estimate(row: Mapping[str, Any], numbers: Mapping[str, Any]) -> Estimate:
    """Read what ``_estimate`` wrote; what is fixed has no error, and an older background no interval."""
    value = _number(numbers.get("value"))
    error = _number(numbers.get("standard_error"), math.inf)
    half = float(interval_sigmas()) * error
    low, high = numbers.get("interval", (value - half, value + half))
    interval = (_number(low, -math.inf), _number(high, math.inf))
    by_profile = numbers.get("interval_by") == "profile"
    finding = Finding.from_dict(numbers["finding"]) if "finding" in numbers else None
    return Estimate(str(row["name"]), value, error, interval, str(row["unit"]), finding, by_profile)


def read_result(path: Path) -> Entry | None:
    """Read one result.json of this schema; None where there is none, or none as a run writes it."""
    try:
        result = json.loads(read_small(path))
        entry = Entry(path.parent, result)
        if result["schema"] in _READ and _is_whole(result) and entry.fit() and entry.rows:
            return entry
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        pass
    return None


def read_results(folder: Path) -> list[Entry]:
    """Read every ``<folder>/<case>/result.json`` of this schema, sorted by case; others are left out."""
    paths = [path for path in sorted(folder.glob("*/result.json")) if not path.parent.name.startswith(".")]
    return [entry for path in paths if (entry := read_result(path)) is not None]


def _is_whole(result: Mapping[str, Any]) -> bool:
    """Return True if every entry that a reader uses is there, and of its type."""
    surface = result["surface"]
    rows = [*result["parameters"], *result.get("forces", [])]
    printed = result.get("printed", [])
    return (
        _are_texts([result["title"], result["case"], surface["origin"]])
        and isinstance(result["passed"], bool)
        and isinstance(surface["points"], int)
        and isinstance(result.get("warnings", []), list)
        and all(map(_is_row, rows))
        and _are_texts(formula["what"] for formula in printed)
        and all(isinstance(formula["agrees"], bool) for formula in printed)
    )


def _is_row(row: Mapping[str, Any]) -> bool:
    refined = row["refined"]
    estimated = (refined["value"], refined.get("standard_error")) if refined is not None else ()
    numbers = (row["true"], row["relative_error"], row["tolerance"], *map(row.get, _ERRORS), *estimated)
    return (
        _are_texts([row["name"], row["unit"]])
        and isinstance(row["passed"], bool | None)
        and all(map(_is_number_or_none, numbers))
    )


def _are_texts(values: Iterable[Any]) -> bool:
    return all(isinstance(value, str) and len(value) <= _MAX_CHARACTERS for value in values)


def _is_number_or_none(value: Any) -> bool:
    # JSON has whole numbers without end, and Python's has NaN
    return value is None or (isinstance(value, int | float) and math.isfinite(float(value)))
