"""From a response surface to the law behind it: candidates of the library compared, with a verdict."""

from __future__ import annotations

from rsgen.ranking.ranking import rank

__all__ = ["rank"]
