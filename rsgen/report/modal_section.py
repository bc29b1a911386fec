"""The modal table of a report: rows for the page, an entry of result.json, or why there is none."""

from __future__ import annotations

import math
from typing import Any

from rsgen.errors import RsgenError
from rsgen.identification import Identification, ModalTable, modal_table
from rsgen.identification.modal_result import MODAL_COLUMNS
from rsgen.report.page_tables import Cell, Table, TableRow
from rsgen.surface import ResponseSurface
from rsgen.units.scale import choose_scale, number_text

__all__ = ["Modal", "modal_entry", "modal_page_table", "tabulate_mode"]

Modal = ModalTable | str
"""The modal table, or why there is none; "" where nobody asked."""

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
        return modal_table(surface, identification.model)
    except RsgenError as fault:
        return str(fault)


def modal_entry(modal: Modal) -> dict[str, Any] | None:
    """Give the table for result.json: columns in SI, null where they are not known; or the reason."""
    if isinstance(modal, str):
        return {"reason": modal} if modal else None

    def numbers(values: Any) -> list[float | None]:
        return [float(f"{v:.8e}") if math.isfinite(v) else None for v in values]

    entry: dict[str, Any] = {
        "points": modal.points,
        "misfit": modal.misfit,
        "mass": modal.mass if math.isfinite(modal.mass) else None,
        "mass_error": modal.mass_error if math.isfinite(modal.mass_error) else None,
        "known": list(modal.known),
        "amplitude": numbers(modal.amplitude),
    }
    for name in modal.known:
        for column in (name, f"{name}_lower", f"{name}_upper"):
            entry[column] = numbers(getattr(modal, column))
    return entry


def modal_page_table(modal: Modal) -> Table | None:
    """Give the rows for the page; None where there is no table."""
    if isinstance(modal, str):
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
