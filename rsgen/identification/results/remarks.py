"""Remarks on tables of values and of held-out levels."""

from __future__ import annotations

from collections.abc import Iterable
from math import nan
from typing import Any

from rsgen.common.text_table import short
from rsgen.common.tolerances import HELD_OUT_ERROR_SMALL, MAX_ERROR_TO_MISFIT, MISFIT_NEGLIGIBLE

_SMALL = f"{100 * HELD_OUT_ERROR_SMALL:g} %"
HELD_OUT_SCALE = f"up to {MAX_ERROR_TO_MISFIT:g} times it is as good as the fit, up to {_SMALL} is small"
"""With what errors of held-out levels are to be compared, where nothing else is doubted."""


def mass_lines(estimates: Iterable[Any]) -> list[str]:
    """Return what values owe to the mass, given or identified: a line, none where it has no value in kg."""
    given = "m is taken as exact: its error comes on top, 1 % of m moves the linear stiffness by about 1 %"
    free = "a wrong unit or factor of force or response shows in m alone: compare it with what moves"
    masses = (one for one in estimates if one.name == "m" and one.unit == "kg" and one.identifiable)
    return [free if one.standard_error else given for one in masses]


def held_out_lines(held_out: Iterable[Any], usable: bool = False) -> list[str]:
    """Return a line for each held-out level or record: its error relative to the measured response.

    What is small is said only next to a ``usable`` verdict: a doubtful law is not to be trusted for it.
    """
    return [
        f"held out {short(one.level, 4)} {one.level_unit}"
        + (f", {one.sweep}" if getattr(one, "sweep", "rest") != "rest" else "")
        + f": predicted with an error of {100 * one.error:.2g} %"
        + (f", {one.missing} of {len(one.frequency)} points not at all" if getattr(one, "missing", 0) else "")
        + _scale_of_error(one, f"; {HELD_OUT_SCALE}" if usable else "")
        for one in held_out
    ]


def _scale_of_error(one: Any, scale: str) -> str:
    """Say with what to compare the error of a level, and where it is largest; nothing of exact data, or of a
    record.
    """
    if not (one.error > MISFIT_NEGLIGIBLE and getattr(one, "misfit", nan) > 0):
        return ""
    largest = f"{100 * one.largest_error:.2g} % of the root mean square at {one.largest_at:.5g} Hz"
    return f", at most {largest}; {one.error / one.misfit:.2g} times the misfit{scale}"
