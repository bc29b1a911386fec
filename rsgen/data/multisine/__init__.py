"""Tests with a periodic multisine: their spectra, best linear approximation, and periodic responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use
from rsgen.data.multisine.spectra import MultisineSpectra

if TYPE_CHECKING:
    from rsgen.data.multisine.linear import BestLinear, best_linear, implausible

__all__ = ["BestLinear", "MultisineSpectra", "best_linear", "implausible"]

# most tests have one line a record
__getattr__ = on_first_use(__name__, dict.fromkeys(("BestLinear", "best_linear", "implausible"), "linear"))
