"""Figures: data in, matplotlib figures out, nothing written.

Every function gives a `Drawing`: the figure, its caption, and what it shows in words and numbers. With
``ax=`` it draws on axes of the caller, in the caller's style.
"""

from __future__ import annotations

from rsgen.formula.units import choose_scale, count_text, number_text, quantity_text, unit_text
from rsgen.identification.prediction.resonance_curves import shown_levels
from rsgen.report.figures.curves import draw_collapse, draw_modal
from rsgen.report.figures.drawing import STYLE, Drawing, draw_surface
from rsgen.report.figures.equivalent import draw_derivation
from rsgen.report.figures.loop_figures import draw_energy, draw_forces, draw_loops
from rsgen.report.figures.responses import (
    draw_best_linear,
    draw_held_out,
    draw_line_misfit,
    draw_predicted_record,
    draw_responses,
)

__all__ = [
    "STYLE",
    "Drawing",
    "choose_scale",
    "count_text",
    "draw_best_linear",
    "draw_collapse",
    "draw_derivation",
    "draw_energy",
    "draw_forces",
    "draw_held_out",
    "draw_line_misfit",
    "draw_loops",
    "draw_modal",
    "draw_predicted_record",
    "draw_responses",
    "draw_surface",
    "number_text",
    "quantity_text",
    "shown_levels",
    "unit_text",
]


def __dir__() -> list[str]:
    return __all__
