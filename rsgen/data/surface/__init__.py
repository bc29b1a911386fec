"""The response surface: one row a test point, the one table that all later stages read."""

from __future__ import annotations

from rsgen.data.surface.columns import recognise_directions
from rsgen.data.surface.response_surface import (
    OUTCOMES,
    ResponseSurface,
    save_surface,
    typical_amounts,
    without_copies,
)

__all__ = [
    "OUTCOMES",
    "ResponseSurface",
    "recognise_directions",
    "save_surface",
    "typical_amounts",
    "without_copies",
]
