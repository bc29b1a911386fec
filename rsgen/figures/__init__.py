"""Figures: data in, matplotlib figures out, nothing written.

Every function gives a `Drawing`: the figure, its caption, and what it shows in words and numbers. With
``ax=`` it draws on axes of the caller, in the caller's style.
"""

from __future__ import annotations

from rsgen.figures.curves import draw_collapse, draw_damping, draw_resonance, draw_stiffness
from rsgen.figures.drawing import STYLE, Drawing
from rsgen.figures.forces import draw_forces, force_function
from rsgen.figures.law_figure import draw_derivation
from rsgen.figures.loops import draw_energy, draw_loops
from rsgen.figures.modal import draw_modal
from rsgen.figures.multisine import draw_best_linear, draw_line_misfit, draw_predicted_record
from rsgen.figures.overview import draw_map, draw_surface, draw_thumbnail
from rsgen.figures.responses import choose_levels, draw_held_out, draw_responses, draw_time_history
from rsgen.units.scale import choose_scale, count_text, number_text, quantity_text, unit_text

__all__ = [
    "STYLE",
    "Drawing",
    "choose_levels",
    "choose_scale",
    "count_text",
    "draw_best_linear",
    "draw_collapse",
    "draw_damping",
    "draw_derivation",
    "draw_energy",
    "draw_forces",
    "draw_held_out",
    "draw_line_misfit",
    "draw_loops",
    "draw_map",
    "draw_modal",
    "draw_predicted_record",
    "draw_resonance",
    "draw_responses",
    "draw_stiffness",
    "draw_surface",
    "draw_thumbnail",
    "draw_time_history",
    "force_function",
    "number_text",
    "quantity_text",
    "unit_text",
]


def __dir__() -> list[str]:
    return __all__
