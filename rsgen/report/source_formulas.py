"""Formulas as a source prints them, held against the derivation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import sympy

from rsgen.data.oscillator import Model
from rsgen.describing import DescribingFunction, compare_printed, derive
from rsgen.formula import symbol
from rsgen.identification.results import Identification
from rsgen.report.figures import force_function, number_text, quantity_text
from rsgen.report.free_vibration import free_frequency
from rsgen.report.subject import Subject

__all__ = ["PrintedFormula", "check_printed"]

_POINTS = 240
_UNITS = {"stiffness": "N/m", "damping": "N*s/m"}


@dataclass(frozen=True, slots=True)
class PrintedFormula:
    """The verdict on one printed formula: whether it equals the derivation, and what that means.

    Parameters
    ----------
    what
        "stiffness" or "damping".
    largest_deviation
        Relative to the derived value [1].
    where
        The amplitude of the largest deviation, in words; "" where there is none.
    """

    what: str
    formula: sympy.Expr
    agrees: bool
    largest_deviation: float
    where: str
    sentences: tuple[str, ...]


def _number(formula: sympy.Expr, values: dict[str, float], X: float, X0: float, omega: float) -> float:
    """Evaluate a printed formula at one point."""
    named = {**values, "X": X, "X0": X0, "omega": omega}
    value = sympy.N(formula.subs({symbol(name): number for name, number in named.items()}))
    return float(value) if value.is_real else float("nan")


def check_printed(subject: Subject, identification: Identification) -> tuple[PrintedFormula, ...]:
    """Hold every formula that the source prints against the derivation, with the refined values.

    Raises
    ------
    RsgenError
        A formula is of something else than stiffness or damping, or has names that the law does not have.
    """
    model = identification.model
    values = {name: float(identification.values[name]) for name in model.parameters}
    low, high = identification.amplitude_range
    if not (subject.printed and np.isfinite(list(values.values())).all() and 0 < low < high):
        return ()
    derived = derive(model.force)
    amplitude = np.linspace(low, high, _POINTS)
    omega = 2 * np.pi * float(np.mean(identification.frequency_range))
    checked = []
    for item in compare_printed(derived, subject.printed, values, amplitude, omega):
        verdict = PrintedFormula(item.what, item.formula, item.agrees, item.largest_deviation, "", ())
        if not item.agrees and "X" in item.where:
            verdict = _place(verdict, derived, values, float(item.where["X"]), omega)
        if item.what == "stiffness" and derived.mean != 0:
            verdict = _with_period(verdict, derived, model, identification, omega)
        checked.append(verdict)
    return tuple(checked)


def _place(
    item: PrintedFormula, derived: DescribingFunction, values: dict[str, float], X: float, omega: float
) -> PrintedFormula:
    """Say how much and where a formula departs, in units that people read."""
    exact = derived.evaluate([X], omega, values)
    right = float((exact.stiffness if item.what == "stiffness" else exact.damping)[0])
    printed = _number(item.formula, values, X, float(exact.mean[0]), omega)
    unit = _UNITS[item.what]
    place = f"X = {quantity_text(X, 'm', 3)}"
    words = (
        f"The largest deviation over the tested range is {number_text(100 * item.largest_deviation, 3)} "
        "% of the "
        f"derived value, at {place}: printed {quantity_text(printed, unit)}, derived "
        f"{quantity_text(right, unit)}."
    )
    return replace(item, where=place, sentences=(words,))


def _with_period(
    item: PrintedFormula,
    derived: DescribingFunction,
    model: Model,
    identification: Identification,
    omega: float,
) -> PrintedFormula:
    """Add what free vibration says: it judges between formulas for a law that pushes the mean off zero."""
    values = {name: float(identification.values[name]) for name in model.parameters}
    high, mass = identification.amplitude_range[1], identification.mass
    force, still = force_function(model, values), np.zeros(1)
    exact = free_frequency(lambda x: float(force(np.array([x]), still)[0]), mass, high)
    balanced = derived.evaluate([high], omega, values)
    mean = float(balanced.mean[0])
    stiffness = {
        "the printed formula": _number(item.formula, values, high, mean, omega),
        "the derivation with the mean": float(balanced.stiffness[0]),
    }
    if not (np.isfinite(exact) and all(k > 0 for k in stiffness.values())):
        return item
    said = []
    for name, k in stiffness.items():
        frequency = float(np.sqrt(k / mass)) / (2 * np.pi)
        said.append(
            f"{name} gives {quantity_text(k, 'N/m')} and so {number_text(frequency, 5)} Hz "
            f"({_signed(frequency / exact - 1)} in frequency, "
            f"{_signed((frequency / exact) ** 2 - 1)} in stiffness)"
        )
    words = (
        f"Free vibration of the identified spring has exactly {number_text(exact, 5)} Hz, by energy "
        "between its "
        f"two turning points; {'; '.join(said)}. The law pushes the mean to {quantity_text(mean, 'm', 3)} at "
        f"X = {quantity_text(high, 'm', 3)}."
    )
    return replace(item, sentences=(*item.sentences, words))


def _signed(change: float) -> str:
    return f"{100 * change:+.2f} %".replace("-", "−")
