"""What the title of a column says about its numbers: a unit, an angular frequency."""

from __future__ import annotations

import re

__all__ = ["is_angular", "unit_in"]

_UNIT = re.compile(
    r"[\[(]\s*([^\])\s][^\])]{0,19}?)\s*[\])]\s*\Z"
    r"|_((?:Hz|kHz|rpm|s|ms|us|N|mN|kN|lbf|m|mm|um|µm|nm|mil|mils|in|g|deg|rad|V|mV)(?:_per_N)?)\Z"
    r"|\s(?:in|/)\s+([^\s()\[\]]{1,12})(?:\s|\Z)"
)
"""A unit in a title: "Kraft [N]", "force_N", "Kraft in N (rms)"."""
_ANGULAR = re.compile(
    r"^(?:w|omega|ω|Ω)(?:$|[\s_\d\[(])|angular|omega|kreisfreq|rad\s*(?:(?:/|_|per)\s*)?s(?:ec)?(?![a-z])",
    re.IGNORECASE,
)
"""Titles of angular frequencies: "Omega", "w", "freq_rad_s"."""
_CYCLIC = re.compile(r"Hz|rpm", re.IGNORECASE)
"""In such a title this says that it is no angular frequency all the same: "omega_Hz"."""


def unit_in(title: str) -> str:
    """Give the unit in a title, or "".

    Examples
    --------
    >>> unit_in("accelerance_g_per_N")
    'g/N'
    """
    found = _UNIT.search(title)
    return next(filter(None, found.groups())).replace("_per_", "/") if found else ""


def is_angular(title: str) -> bool:
    """Whether a title says that a frequency is angular, in rad/s.

    Examples
    --------
    >>> [is_angular(title) for title in ("Omega", "w [rad/s]", "omega_Hz", "f_Hz", "width")]
    [True, True, False, False, False]
    """
    return bool(_ANGULAR.search(title)) and not _CYCLIC.search(title)
