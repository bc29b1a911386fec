"""The tables of a page: cells of text with a unit, made for people."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rsgen.analysis.comparison import Comparison, Row
from rsgen.analysis.fit_comparison import compare_fits
from rsgen.common.errors import RsgenError
from rsgen.common.text_table import interval_text
from rsgen.common.tolerances import CONFIDENCE_TEXT
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.formula.units import ForceUnits, Scale, choose_scale, number_text, quantity_text, unit_text
from rsgen.identification.modal_result import MODAL_COLUMNS, ModalTable, other_mass
from rsgen.identification.modal_table import modal_table
from rsgen.identification.prediction import HeldOutLevel, predict
from rsgen.identification.prediction.prediction_result import PredictedRecord, score_points
from rsgen.identification.results import Estimate, Identification
from rsgen.identification.results.result import size_of_error
from rsgen.law.memory import FORCE_KEYS
from rsgen.report.sentences import error_text, sentence, share_text

if TYPE_CHECKING:
    from rsgen.data.multisine.linear import BestLinear

_BACKGROUND_NAMES = {
    "psi": "lead of the force in the phase of the response",
    "b0_re": "response per force in the middle of the band, real",
    "b0_im": "the same, imaginary",
    "b1_re": "its change over the band, real",
    "b1_im": "the same, imaginary",
    "o_re": "response that does not depend on the force, real",
    "o_im": "the same, imaginary",
    "r_re": "residue of the neighbour, real",
    "r_im": "the same, imaginary",
    "f_n": "natural frequency of the neighbour",
    "zeta": "damping ratio of the neighbour",
}
_KINDS_OF_INTERVAL = (
    f"± is half of the {CONFIDENCE_TEXT} interval, by standard error unless profile likelihood is stated"
)
_PER_LEVEL = "“per level” rests on the resonance of each level alone, “–” where that does not show a value"
_SWEEPS = {"rest": "from rest", "up": "up", "down": "down"}


@dataclass(frozen=True, slots=True)
class Cell:
    """A text and, below it in small print, a note; ``verdict`` is "yes", "no" or "open" where it is one."""

    text: str
    note: str = ""
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """Caption, column headings, rows; the first cell of a row is its heading.

    ``optional`` names the columns that a narrow screen leaves out.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | Cell, ...], ...]
    optional: tuple[str, ...] = ()


_Says = Callable[[Any], str | Cell]
"""Text of a column for the item of a row."""


def _digits(estimate: Estimate) -> int:
    """As many digits as the interval leaves meaning to, between 4 and 8."""
    low, high = estimate.interval
    half = (high - low) / 2
    if not (math.isfinite(half) and half > 0 and math.isfinite(estimate.value) and estimate.value):
        return 6
    return min(max(math.ceil(math.log10(abs(estimate.value) / half)) + 2, 4), 8)


def _remark(estimate: Estimate) -> str:
    return "" if estimate.finding is None else sentence(estimate.finding)


def _estimate_cell(estimate: Estimate | None, unit: str, interval: bool = False) -> Cell:
    if estimate is None or not math.isfinite(estimate.value):
        # the refined estimate says why, for all
        return Cell("–", _remark(estimate) if estimate is not None and interval else "")
    text = quantity_text(estimate.value, unit, _digits(estimate) if interval else 4)
    half = (estimate.interval[1] - estimate.interval[0]) / 2
    if not interval:
        return Cell(text)
    scale = choose_scale([estimate.value], unit)
    note = f"± {number_text(half / scale.factor, 2)} {scale.unit}".rstrip()
    if estimate.by_profile or not math.isfinite(half):
        by_profile = estimate.by_profile and any(map(math.isfinite, estimate.interval))

        def ends(value: float) -> str:
            return number_text(value / scale.factor, _digits(estimate))

        note = interval_text(estimate.interval, ends, scale.unit)
        note += ", by profile likelihood" if by_profile else ""
    return Cell(text, "; ".join(filter(None, [note, _remark(estimate)])))


def _tabulated(caption: str, items: Iterable[Any], columns: Mapping[str, _Says]) -> Table:
    """Make a table with a row for each item; a column is a heading and what stands below it for an item."""
    rows = tuple(tuple(says(item) for says in columns.values()) for item in items)
    return Table(caption, tuple(columns), rows)


def verdict_table(
    comparison: Comparison, remarks: Iterable[str] = (), small_motion: Iterable[Estimate] = ()
) -> Table:
    """Hold every estimate against the truth; without truth, show the estimates with their intervals.

    ``remarks`` are said of the whole table.
    """
    known = any(math.isfinite(row.true) for row in comparison.rows)
    judged = any(row.tolerance is not None for row in comparison.rows)
    columns: dict[str, _Says] = {"Parameter": lambda row: FORCE_KEYS.get(row.name, row.name)}
    if known:
        columns["True"] = _true_cell
    columns |= {
        "Per level": lambda row: _estimate_cell(row.paper, row.unit),
        "First order": lambda row: _estimate_cell(row.first_order, row.unit),
        f"Refined, {CONFIDENCE_TEXT} interval": lambda row: _estimate_cell(row.refined, row.unit, True),
    }
    if known:
        columns["Error, refined"] = _error_cell
        columns["Error, first order"] = lambda row: error_text(row.first_order_error)
    else:
        columns["Standard error"] = _relative_standard_error
    if judged:
        columns["Verdict"] = _verdict_cell
    shown = [row for row in comparison.rows if row.name not in FORCE_KEYS or row.tolerance is not None]
    for one in small_motion:
        name, nan = f"{one.name.replace('-', ' ')}, small motion", math.nan
        shown.append(Row(name, one.unit, nan, None, None, one, nan, nan, nan, None, passed=True))
    shown.sort(key=lambda row: row.tolerance is None)  # what is judged comes first
    caption = "True against identified values" if known else "Identified values; no truth is known"
    table = _tabulated("; ".join([f"{caption}. {_KINDS_OF_INTERVAL}", _PER_LEVEL, *remarks]), shown, columns)
    return replace(table, optional=("Per level", "First order", "Error, first order"))


def _true_cell(row: Row) -> Cell:
    note = "largest over the tested range" if row.name in FORCE_KEYS else ""
    return Cell(quantity_text(row.true, row.unit, 6) if math.isfinite(row.true) else "–", note)


def _error_cell(row: Row) -> Cell:
    note = "" if row.tolerance is None else f"tolerance {error_text(row.tolerance, 1)}"
    return Cell(error_text(row.relative_error), note)


def _relative_standard_error(row: Row) -> str:
    refined = row.refined
    return error_text(refined.standard_error / abs(refined.value) if refined.value else math.nan)


def _verdict_cell(row: Row) -> Cell:
    if row.tolerance is None:
        return Cell("–", verdict="open")
    return Cell("within", verdict="yes") if row.passed else Cell("outside", verdict="no")


def estimate_table(identification: Identification) -> Table:
    """Return every estimate with unit, standard error and the predicted first-order bias."""
    paper, first = (
        {estimate.name: estimate for estimate in estimates}
        for estimates in (identification.paper, identification.first_order)
    )
    biases = _biases(identification)
    columns: dict[str, _Says] = {
        "Parameter": lambda one: one.name,
        "Unit": lambda one: unit_text(one.unit) or "–",
        "Per level": lambda one: _estimate_cell(paper.get(one.name), ""),
        "First order": lambda one: _estimate_cell(first.get(one.name), "", interval=True),
        "Its predicted bias": lambda one: _number_or_dash(biases.get(one.name, math.nan), 2),
        "Refined": lambda one: _estimate_cell(one, "", interval=True),
        "Standard error": lambda one: number_text(one.standard_error, 2),
    }
    given: dict[str, _Says] = {
        "Parameter": columns["Parameter"],
        "Unit": columns["Unit"],
        "Refined": lambda one: Cell(quantity_text(one.value, "", 6), "fixed"),
    }
    of_fixed = {head: given.get(head, lambda one: "–") for head in columns}
    caption = f"All estimates in SI units. {_KINDS_OF_INTERVAL}"
    table = _tabulated(caption, identification.refined, columns)
    fixed = _tabulated(caption, identification.fixed, of_fixed)
    return replace(table, rows=(*table.rows, *fixed.rows))


def _biases(identification: Identification) -> dict[str, float]:
    """Return the predicted bias of each first-order estimate; none of what the test does not determine."""
    pairs = zip(identification.first_order, identification.first_order_bias, strict=False)
    return {one.name: bias for one, bias in pairs if one.identifiable}


def harmonics_matter(identification: Identification) -> bool:
    """Return True if one harmonic alone changes an estimate by more than half of its interval."""
    biases = _biases(identification)
    return any(
        abs(biases.get(one.name, math.nan)) > (one.interval[1] - one.interval[0]) / 2
        for one in identification.refined
    )


def _number_or_dash(value: float, digits: int = 4) -> str:
    return number_text(value, digits) if math.isfinite(value) else "–"


def resonance_table(identification: Identification) -> Table:
    """Return the resonance of every level and sweep that reaches it."""
    points, curve = [one for one in identification.resonances if one.reached], identification.curve
    amplitude = choose_scale([point.amplitude for point in points], "m")
    stiffness = choose_scale([point.stiffness for point in points], curve.units.of("N/m"))
    damping = choose_scale([point.damping for point in points], curve.units.of("N*s/m"))
    return _tabulated(
        "Resonance of each level",
        points,
        {
            "Level": lambda point: quantity_text(point.level, curve.level_unit),
            "Sweep": lambda point: Cell(_SWEEPS.get(point.sweep, point.sweep), "jump" if point.jump else ""),
            "Frequency [Hz]": lambda point: number_text(point.frequency, 6),
            "Damping ratio [%]": lambda point: number_text(100 * point.damping_ratio),
            amplitude.label("X"): lambda point: number_text(point.amplitude / amplitude.factor),
            stiffness.label("k(X)"): lambda point: number_text(point.stiffness / stiffness.factor, 5),
            damping.label("c(X)"): lambda point: number_text(point.damping / damping.factor),
        },
    )


_NOT_SEEN = "Levels that identification has not seen"


def held_out_table(
    held_out: Sequence[HeldOutLevel],
    caption: str = _NOT_SEEN,
    law: Sequence[HeldOutLevel] = (),
    usable: bool = False,
) -> Table | None:
    """Score held-out levels, with the error of a ``law`` at the same points; None where there are none.

    What is as good as the fit is called so only of a ``usable`` result.
    """
    columns: dict[str, _Says] = {
        "Level": lambda item: item.name,
        "Sweep": lambda item: _SWEEPS.get(item.sweep, item.sweep),
        "Points": lambda item: str(len(item.frequency)),
        "Error, root mean square": lambda item: Cell(error_text(item.error), size_of_error(item, usable)),
        "Largest error": lambda item: Cell(
            error_text(item.largest_error), f"at {quantity_text(item.largest_at, 'Hz', 5)}"
        ),
        "Points not nearly predicted": lambda item: str(item.missing),
    }
    if law:
        columns["Error of the law at the points predicted"] = lambda item: error_text(_error_at(law, item))
    if not held_out:
        return None
    caption += "; errors relative to the root mean square of the measured response"
    caption += f"; the misfit is {error_text(held_out[0].misfit)}"
    return _tabulated(caption, held_out, columns)


def _error_at(law: Sequence[HeldOutLevel], item: HeldOutLevel) -> float:
    """Return the error of a law at the points of a level that a modal table predicts."""
    known = np.isfinite(item.predicted)
    (one,) = (one for one in law if (one.level, one.sweep) == (item.level, item.sweep))
    return score_points(one.measured[known], one.predicted[known])[0] if known.any() else math.nan


def record_table(records: Sequence[PredictedRecord]) -> Table | None:
    """Score the records of held-out levels; None where there are none."""
    columns: dict[str, _Says] = {
        "Level, rms": lambda one: one.name,
        "Lines": lambda one: str(int(np.count_nonzero(one.judged))),
        "Error, root mean square": lambda one: error_text(one.error, 3),
        "Noise of the measured mean": lambda one: error_text(one.noise),
    }
    return _tabulated(_NOT_SEEN, records, columns) if records else None


def linear_table(approximations: Sequence[BestLinear], units: ForceUnits) -> Table:
    """List the best linear approximations of a multisine, a row a level."""
    stiffness = choose_scale([one.stiffness for one in approximations], units.of("N/m"))
    size = choose_scale([one.rms for one in approximations], "m")
    return _tabulated(
        "Best linear approximation of each level",
        approximations,
        {
            "Level, rms": lambda one: quantity_text(one.level, one.level_unit, 3),
            "Records": lambda one: str(one.records),
            size.label("Response, rms"): lambda one: _number_or_dash(one.rms / size.factor),
            "Natural frequency [Hz]": lambda one: _number_or_dash(one.natural_frequency, 5),
            "Damping ratio [%]": lambda one: _number_or_dash(100 * one.damping_ratio),
            stiffness.label("k"): lambda one: _number_or_dash(one.stiffness / stiffness.factor, 5),
            "Distortion at excited lines": lambda one: error_text(one.distortion_share),
            "at even lines": lambda one: share_text(one.even_share, one.even_bound),
            "at other odd lines": lambda one: share_text(one.odd_share, one.odd_bound),
            "Noise": lambda one: error_text(one.noise_share),
        },
    )


def background_table(identification: Identification) -> Table | None:
    """List the fitted background; None where none was asked for."""
    background = identification.background
    if background is None:
        return None
    low, high = background.band
    share = f", {error_text(background.share)} of the response" if background.share else ""
    return _tabulated(
        f"Background, {low:.4g} to {high:.4g} Hz: subtracted before k(X) and c(X) are drawn{share}",
        background.estimates,
        {
            "Background": lambda one: Cell(one.name, _BACKGROUND_NAMES[one.name]),
            "Unit": lambda one: unit_text(one.unit),
            "Value": lambda one: (
                _estimate_cell(one, "", interval=True)
                if math.isfinite(one.standard_error)
                else Cell("–", "not identifiable")
            ),
            "Standard error": lambda one: _number_or_dash(one.standard_error, 2),
        },
    )


def alternative_table(identification: Identification) -> Table | None:
    """Compare the fit with alternatives to it; None if none widens an interval by much."""
    compared = compare_fits(identification)
    rows = tuple(map(tuple, compared.table.rows))
    caption = (
        "Of each kind of alternative the one that widens the intervals most: to first order, with "
        f"{CONFIDENCE_TEXT} intervals by noise alone; the identified intervals include these shifts"
    )
    # a head without words has no name for a screen reader
    heads = ("parameter", *compared.table.heads[1:])
    return Table(caption, heads, rows) if len(compared.fits) > 1 else None


def ranking_table(identification: Identification) -> Table | None:
    """List the laws compared; None where none were."""
    if identification.ranking is None:
        return None
    table = identification.ranking.table
    caption = "; ".join(("Candidate laws, best first", *table.notes))
    return Table(caption, table.heads, tuple(tuple(map(str, row)) for row in table.rows))


# ----------------------------------------------------------------------------
# The modal table of a report: rows for the page, or why there is none.


@dataclass(frozen=True, slots=True, eq=False)
class Modal:
    """The modal table of a report.

    Parameters
    ----------
    table
        None where there is none.
    reason
        Why there is none; "" where none was asked for.
    held_out
        Levels that the table has not seen, predicted from it without a law.
    """

    table: ModalTable | None = None
    reason: str = ""
    held_out: tuple[HeldOutLevel, ...] = ()


NO_MODAL = Modal()
"""No table was asked for."""

_TITLES = {
    "frequency": "Frequency", "damping_ratio": "Damping ratio", "stiffness": "k(X)", "damping": "c(X)",
    "stiffness_per_mass": "k(X)/m", "damping_per_mass": "c(X)/m",
}  # fmt: skip
"""Heads of the columns."""


def tabulate_mode(surface: ResponseSurface | MultisineSpectra, identification: Identification) -> Modal:
    """Make the modal table of a test, as the model was observed and with its mass where that was given."""
    try:
        table = modal_table(surface, identification.model_given)
    except RsgenError as fault:
        return Modal(reason=str(fault))
    if identification.verdict.usable:
        table = replace(table, findings=(*table.findings, *other_mass(table, identification)))
    return Modal(table, held_out=score_held_out(table, surface))


def score_held_out(
    table: ModalTable, surface: ResponseSurface | MultisineSpectra
) -> tuple[HeldOutLevel, ...]:
    """Predict the levels held out from a table, where its mass is known; none where none was held out."""
    if not (table.test.observation.hold_out and "damping_ratio" in table.known):
        return ()
    return predict(table, None, surface).held_out


def modal_page_table(section: Modal) -> Table | None:
    """Return the rows for the page; None where there is no table."""
    modal = section.table
    if modal is None:
        return None
    amplitude = choose_scale(modal.amplitude, "m")
    columns: dict[str, _Says] = {
        amplitude.label("X"): lambda row: number_text(row["amplitude"] / amplitude.factor)
    }
    for name in modal.shown:
        ratio = name == "damping_ratio"
        scale = Scale(0.01, "%") if ratio else choose_scale(getattr(modal, name), MODAL_COLUMNS[name])
        columns[scale.label(_TITLES[name])] = partial(_modal_cell, name, scale.factor)
    caption = (
        f"Modal table without a law, {CONFIDENCE_TEXT} intervals; {modal.points} points, misfit "
        f"{modal.misfit:.2g}"
    )
    # every second row: the file has all
    return _tabulated(caption, list(modal)[::2], columns)


def _modal_cell(name: str, factor: float, row: Mapping[str, float]) -> Cell:
    half = (row[f"{name}_upper"] - row[f"{name}_lower"]) / 2
    note = f"± {number_text(half / factor, 2)}" if math.isfinite(half) else ""
    return Cell(number_text(row[name] / factor, 5), note)
