"""Time histories to surfaces and spectra: ``rsgen.data.history`` by the name that users write."""

from __future__ import annotations

from rsgen.data.history import *  # noqa: F403
from rsgen.data.history import __all__


def __dir__() -> list[str]:
    return sorted(__all__)
