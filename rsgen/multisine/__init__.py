"""Tests with a periodic multisine: their spectra, best linear approximation, and periodic responses."""

from __future__ import annotations

from rsgen.multisine.linear import BestLinear, best_linear
from rsgen.multisine.plausible import implausible
from rsgen.multisine.spectra import MultisineSpectra

__all__ = ["BestLinear", "MultisineSpectra", "best_linear", "implausible"]
