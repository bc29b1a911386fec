"""Laws from periodic multisines: the balance of forces at every line, weighted by its noise."""

from __future__ import annotations

from rsgen.identification.lines.identify_multisine import MultisineIdentification, identify_multisine

__all__ = ["MultisineIdentification", "identify_multisine"]
