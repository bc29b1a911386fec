"""Time histories to response surfaces: swept sine, stepped sine, free decay."""

from __future__ import annotations

from rsgen.history.law import SweepLaw
from rsgen.history.record import TimeHistory
from rsgen.history.sweep import demodulate_sweep

__all__ = ["SweepLaw", "TimeHistory", "demodulate_sweep"]
