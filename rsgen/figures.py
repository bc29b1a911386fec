"""Figures of tests and results: ``rsgen.report.figures`` by the name that users write."""

from __future__ import annotations

from rsgen.report.figures import *  # noqa: F403
from rsgen.report.figures import __all__


def __dir__() -> list[str]:
    return sorted(__all__)
