"""Tests with a periodic multisine: their spectra, best linear approximation, and periodic responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use
from rsgen.data.multisine.spectra import MultisineSpectra

if TYPE_CHECKING:
    from rsgen.data.multisine.linear import BestLinear, best_linear, best_linear_surface, implausible
    from rsgen.data.multisine.spectra_file import load_spectra, save_spectra

__all__ = [
    "BestLinear",
    "MultisineSpectra",
    "best_linear",
    "best_linear_surface",
    "implausible",
    "load_spectra",
    "save_spectra",
]

# most tests have one line a record
_LINEAR = dict.fromkeys(("BestLinear", "best_linear", "best_linear_surface", "implausible"), "linear")
_FILE = dict.fromkeys(("load_spectra", "save_spectra"), "spectra_file")
__getattr__ = on_first_use(__name__, _LINEAR | _FILE)
