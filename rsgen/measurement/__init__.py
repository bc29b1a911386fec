"""Measured files to response surfaces: one reader a format, one plan for where what is found."""

from __future__ import annotations

from rsgen.measurement.plan import HistoryRule, Layout, LevelRule, MeasuredTest, Signal, SweepRule
from rsgen.measurement.read_measurement import read_measurement

__all__ = ["HistoryRule", "Layout", "LevelRule", "MeasuredTest", "Signal", "SweepRule", "read_measurement"]
