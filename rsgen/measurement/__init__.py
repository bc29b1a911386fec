"""Measured files to response surfaces: one reader a format, one plan for where what is found."""

from __future__ import annotations

from rsgen.measurement.mapping import HistoryRule, Layout, LevelRule, MeasuredTest, Signal, SweepRule
from rsgen.measurement.reading import read_measurement

__all__ = ["HistoryRule", "Layout", "LevelRule", "MeasuredTest", "Signal", "SweepRule", "read_measurement"]
