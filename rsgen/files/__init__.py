"""Measured files to response surfaces: one reader a format, one plan for where what is found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.files.files_to_surface import read_measurement
    from rsgen.files.plan import HistoryRule, Layout, LevelRule, MeasuredTest, SweepRule
    from rsgen.files.signals import Channel
    from rsgen.files.surface_file import load_surface

__all__ = [
    "Channel", "HistoryRule", "Layout", "LevelRule", "MeasuredTest", "SweepRule", "load_surface",
    "read_measurement",
]  # fmt: skip

# a process that opens a file of strangers loads what it needs for that alone
__getattr__ = on_first_use(
    __name__,
    dict.fromkeys(__all__, "plan")
    | {"Channel": "signals", "read_measurement": "files_to_surface"}
    | {"load_surface": "surface_file"},
)
