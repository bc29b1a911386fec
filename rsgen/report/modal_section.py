"""The modal table of a report: rows for the page, an entry of result.json, or why there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rsgen.common.errors import RsgenError
from rsgen.data.surface import ResponseSurface
from rsgen.formula.units.scale import choose_scale, number_text
from rsgen.identification.modal import ModalTable, modal_table
from rsgen.identification.modal.modal_result import MODAL_COLUMNS
from rsgen.identification.prediction import HeldOutLevel, predict
from rsgen.identification.results import Identification
from rsgen.report.page_tables import Cell, Table, TableRow

__all__ = ["NO_MODAL", "Modal", "modal_entry", "modal_page_table", "score_held_out", "tabulate_mode"]


@dataclass(frozen=True, slots=True, eq=False)
class Modal:
    """The modal table of a report.

    Parameters
    ----------
    table
        None where there is none.
    reason
        Why there is none; "" where nobody asked.
    held_out
        Levels that the table has not seen, predicted from it without a law.
    """

    table: ModalTable | None = None
    reason: str = ""
    held_out: tuple[HeldOutLevel, ...] = ()


NO_MODAL = Modal()
"""Where nobody asked for a table."""

_ROWS = 2
"""Every second row is on the page; the file has all."""

_TITLES = {
    "frequency": "Frequency",
    "damping_ratio": "Damping ratio",
    "stiffness": "k(X)",
    "damping": "c(X)",
    "stiffness_per_mass": "k(X)/m",
    "damping_per_mass": "c(X)/m",
}
"""Heads of the columns."""


def tabulate_mode(surface: ResponseSurface, identification: Identification) -> Modal:
    """Make the modal table of a test, as the model was observed and with its mass where that was given."""
    try:
        table = modal_table(surface, identification.model)
    except RsgenError as fault:
        return Modal(reason=str(fault))
    return Modal(table, held_out=score_held_out(table, surface))


def score_held_out(table: ModalTable, surface: ResponseSurface) -> tuple[HeldOutLevel, ...]:
    """Predict the levels held out from a table, where its mass is known; none where none was held out."""
    if not (table.test.observation.hold_out and "damping_ratio" in table.known):
        return ()
    return predict(table, None, surface).held_out


def _finite(value: float) -> float | None:
    """A number with as many digits as any test has; JSON has none that is not finite."""
    return float(f"{value:.8e}") if math.isfinite(value) else None


def modal_entry(modal: Modal) -> dict[str, Any] | None:
    """Give the table for result.json: columns in SI, null where they are not known; or the reason."""
    table = modal.table
    if table is None:
        return {"reason": modal.reason} if modal.reason else None

    entry: dict[str, Any] = {
        "points": table.points,
        "misfit": _finite(table.misfit),
        "mass": _finite(table.mass),
        "mass_error": _finite(table.mass_error),
        "known": list(table.known),
        "amplitude": list(map(_finite, table.amplitude)),
    }
    for name in table.known:
        for column in (name, f"{name}_lower", f"{name}_upper"):
            entry[column] = list(map(_finite, getattr(table, column)))
    entry["held_out"] = [
        {
            "level": item.level,
            "sweep": item.sweep,
            "points": len(item.frequency),
            "missing": item.missing,
            "error": _finite(item.error),
            "largest_error": _finite(item.largest_error),
        }
        for item in modal.held_out
    ]
    return entry


def modal_page_table(section: Modal) -> Table | None:
    """Give the rows for the page; None where there is no table."""
    modal = section.table
    if modal is None:
        return None
    amplitude = choose_scale(modal.amplitude, "m")
    scales = {name: choose_scale(getattr(modal, name), MODAL_COLUMNS[name]) for name in modal.shown}
    heads = [
        "Damping ratio [%]" if name == "damping_ratio" else scale.label(_TITLES[name])
        for name, scale in scales.items()
    ]
    rows = []
    for row in list(modal)[::_ROWS]:
        cells: list[str | Cell] = [number_text(row["amplitude"] / amplitude.factor)]
        for name, scale in scales.items():
            factor = 0.01 if name == "damping_ratio" else scale.factor
            half = (row[f"{name}_upper"] - row[f"{name}_lower"]) / 2
            note = f"± {number_text(half / factor, 2)}" if math.isfinite(half) else ""
            cells.append(Cell(number_text(row[name] / factor, 5), note))
        rows.append(TableRow(tuple(cells)))
    caption = f"Modal table without a law, 95 % intervals; {modal.points} points, misfit {modal.misfit:.2g}"
    return Table(caption, (amplitude.label("X"), *heads), tuple(rows))
