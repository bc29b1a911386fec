"""The response surface: one row a test point, the one table that all later stages read."""

from __future__ import annotations

from rsgen.surface.amounts import match_level, typical_amounts
from rsgen.surface.copies import without_copies
from rsgen.surface.directions import recognise_directions
from rsgen.surface.response_surface import OUTCOMES, ResponseSurface
from rsgen.surface.surface_file import load_surface, save_surface

__all__ = [
    "OUTCOMES",
    "ResponseSurface",
    "load_surface",
    "match_level",
    "recognise_directions",
    "save_surface",
    "typical_amounts",
    "without_copies",
]
