"""Identified against true: relative errors and a verdict for every parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import RsgenError
from rsgen.identification import Estimate, Identification

__all__ = ["FORCE_KEYS", "Comparison", "Row", "compare"]

FORCE_KEYS = ("stiffness_force", "damping_force")
"""Keys of ``accept`` that judge whole forces: largest deviation over the tested range, relative to the largest."""

_FORCE_POINTS = 401


@dataclass(frozen=True, slots=True)
class Row:
    """One parameter, or one force over the tested range, identified against true.

    Parameters
    ----------
    name
        Parameter, "m", "stiffness_force" or "damping_force".
    unit
        SI unit, "" where unknown.
    true
        The truth; NaN where none is known, and for forces the largest absolute true force [N].
    paper, first_order, refined
        The three estimates; for forces the value is the largest absolute identified force [N].
    relative_error
        |refined - true| / |true|, for forces the largest deviation over the largest true force; NaN without truth.
    paper_error, first_order_error
        The same for the other two estimates.
    tolerance
        From ``accept``; None where nothing is asked.
    passed
        True where the tolerance is kept or nothing is asked.
    """

    name: str
    unit: str
    true: float
    paper: Estimate | None
    first_order: Estimate | None
    refined: Estimate
    relative_error: float
    paper_error: float
    first_order_error: float
    tolerance: float | None
    passed: bool


@dataclass(frozen=True, slots=True)
class Comparison:
    """The verdict: one row a parameter (and a judged force); passed where every tolerance is kept."""

    rows: tuple[Row, ...]
    passed: bool


def compare(
    identification: Identification,
    truth: Mapping[str, float] | None = None,
    accept: Mapping[str, float] | None = None,
) -> Comparison:
    """Hold the estimates against the truth."""
    raise NotImplementedError
