"""Time histories to response surfaces: swept sine, stepped sine, free decay."""

from __future__ import annotations

from rsgen.history.record import TimeHistory

__all__ = ["TimeHistory"]
