"""Tests with a periodic multisine: their spectra, best linear approximation, and periodic responses."""

from __future__ import annotations

from rsgen.data.multisine.linear import BestLinear, best_linear, implausible
from rsgen.data.multisine.spectra import MultisineSpectra

__all__ = ["BestLinear", "MultisineSpectra", "best_linear", "implausible"]
