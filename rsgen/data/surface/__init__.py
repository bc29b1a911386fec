"""The response surface: one row a test point, the one table that all later stages read."""

from __future__ import annotations

from rsgen.data.surface.columns import recognise_directions
from rsgen.data.surface.response_surface import (
    OUTCOMES,
    ResponseSurface,
    typical_amounts,
    without_copies,
)
from rsgen.data.surface.surface_file import load_surface, save_surface

__all__ = [
    "OUTCOMES",
    "ResponseSurface",
    "load_surface",
    "recognise_directions",
    "save_surface",
    "typical_amounts",
    "without_copies",
]
