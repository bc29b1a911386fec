"""Remarks on tables of values and of held-out levels."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rsgen.common.tolerances import HELD_OUT_ERROR_SMALL, MAX_ERROR_TO_MISFIT

_SMALL = f"{100 * HELD_OUT_ERROR_SMALL:g} %"
HELD_OUT_SCALE = f"up to {MAX_ERROR_TO_MISFIT:g} times it is as good as the fit, up to {_SMALL} is small"
"""With what errors of held-out levels are to be compared."""


def mass_lines(estimates: Iterable[Any]) -> list[str]:
    """Return what values owe to the mass, given or identified: a line, none where it has no value in kg."""
    given = "m is taken as exact: its error comes on top, 1 % of m moves the linear stiffness by about 1 %"
    free = "a wrong unit or factor of force or response shows in m alone: compare it with what moves"
    masses = (one for one in estimates if one.name == "m" and one.unit == "kg" and one.identifiable)
    return [free if one.standard_error else given for one in masses]
