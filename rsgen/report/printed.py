"""Formulas as a source prints them, held against the derivation."""

from __future__ import annotations

from dataclasses import dataclass

import sympy

from rsgen.case import Case
from rsgen.identification import Identification

__all__ = ["PrintedFormula", "check_printed"]


@dataclass(frozen=True, slots=True)
class PrintedFormula:
    """The verdict on one printed formula.

    Parameters
    ----------
    what
        "stiffness" or "damping".
    formula
        As printed.
    agrees
        True where it equals the derivation.
    largest_deviation
        Relative to the derived value [1].
    where
        The amplitude of the largest deviation, in words; "" where there is none.
    sentences
        What the verdict means.
    """

    what: str
    formula: sympy.Expr
    agrees: bool
    largest_deviation: float
    where: str
    sentences: tuple[str, ...]


def check_printed(case: Case, identification: Identification) -> tuple[PrintedFormula, ...]:
    """Hold every printed formula of a case against the derivation."""
    return ()
