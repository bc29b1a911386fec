"""Measured files to response surfaces: one reader a format, one plan for where what is found."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsgen.measurement.files_to_surface import read_measurement
    from rsgen.measurement.plan import HistoryRule, Layout, LevelRule, MeasuredTest, Signal, SweepRule

__all__ = ["HistoryRule", "Layout", "LevelRule", "MeasuredTest", "Signal", "SweepRule", "read_measurement"]


def __getattr__(name: str) -> Any:
    # on first use: a process that opens a file of strangers loads what it needs for that alone
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place = "files_to_surface" if name == "read_measurement" else "plan"
    value = getattr(import_module(f"{__name__}.{place}"), name)
    globals()[name] = value
    return value
