"""Formulas as a source prints them, held against the derivation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.case import Case
from rsgen.describing import derive
from rsgen.expression import symbol
from rsgen.figures import force_function, number_text, quantity_text
from rsgen.identification import Identification
from rsgen.oscillator import Model
from rsgen.report.free_vibration import free_frequency

__all__ = ["PrintedFormula", "check_printed"]

Floats = NDArray[np.float64]

_AGREES = 1e-9
"""Largest relative deviation of a formula that agrees: round-off of two ways to write the same thing."""

_POINTS = 240
_UNITS = {"stiffness": "N/m", "damping": "N*s/m"}


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


def _function(expression: sympy.Expr, names: tuple[str, ...]) -> Callable[..., Any]:
    # dummies: names of the generated code are never names of a file
    function: Callable[..., Any] = sympy.lambdify(
        [symbol(name) for name in names], expression, modules="numpy", dummify=True
    )
    return function


def check_printed(case: Case, identification: Identification) -> tuple[PrintedFormula, ...]:
    """Hold every printed formula of a case against the derivation, with the refined values.

    The two are compared as numbers over the tested amplitudes at the lowest, middle and highest frequency.
    """
    values = {name: float(identification.values[name]) for name in case.model.parameters}
    low, high = identification.amplitude_range
    if not (case.printed and np.isfinite(list(values.values())).all() and 0 < low < high):
        return ()
    amplitude = np.linspace(low, high, _POINTS)
    omega = 2 * np.pi * np.array([[f] for f in np.linspace(*identification.frequency_range, 3)])
    derived = derive(case.model.force).evaluate(amplitude, omega, values)
    checked = []
    for what, formula in case.printed.items():
        function = _function(formula, ("X", "X0", "omega", *case.model.parameters))
        numbers = [values[name] for name in case.model.parameters]
        with np.errstate(all="ignore"):
            printed = function(amplitude, derived.mean, omega, *numbers)
        exact = np.asarray(derived.stiffness if what == "stiffness" else derived.damping)
        checked.append(
            _verdict(what, formula, np.broadcast_to(np.real(printed), exact.shape), exact, amplitude)
        )
    shifted = bool(np.nanmax(np.abs(derived.mean) / amplitude, initial=0.0) > 1e-6)
    return tuple(_with_period(item, case.model, identification) if shifted else item for item in checked)


def _verdict(
    what: str, formula: sympy.Expr, printed: Floats, exact: Floats, amplitude: Floats
) -> PrintedFormula:
    scale = np.where(exact == 0, np.nanmax(np.abs(exact), initial=0.0) or 1.0, np.abs(exact))
    deviation = np.abs(printed - exact) / scale
    if not np.isfinite(deviation).any():
        return PrintedFormula(
            what, formula, False, float("nan"), "", ("It has no value over the tested range.",)
        )
    row, column = np.unravel_index(int(np.nanargmax(deviation)), deviation.shape)
    largest = float(deviation[row, column])
    if largest < _AGREES:
        return PrintedFormula(what, formula, True, largest, "", ())
    unit = _UNITS.get(what, "")
    place = quantity_text(float(amplitude[column]), "m", 3)
    first = amplitude[int(np.argmax((deviation > _AGREES).any(axis=0)))]
    words = (
        f"The largest deviation is {number_text(100 * largest, 3)} % of the derived value, at X = "
        f"{place}: printed "
        f"{quantity_text(float(printed[row, column]), unit)}, derived "
        f"{quantity_text(float(exact[row, column]), unit)}. "
        f"The two part from X = {quantity_text(float(first), 'm', 3)} on."
    )
    return PrintedFormula(what, formula, False, largest, f"X = {place}", (words,))


def _with_period(item: PrintedFormula, model: Model, identification: Identification) -> PrintedFormula:
    """Add what free vibration says, the judge between two formulas for a law that pushes the mean off "
    "zero."""
    if item.what != "stiffness":
        return item
    values = {name: float(identification.values[name]) for name in model.parameters}
    high = identification.amplitude_range[1]
    mass = identification.mass
    force = force_function(model, values)
    still = np.zeros(1)
    exact = free_frequency(lambda x: float(force(np.array([x]), still)[0]), mass, high)
    omega = np.array([2 * np.pi * np.mean(identification.frequency_range)])
    derived = derive(model.force).evaluate(np.array([high]), omega, values)
    numbers = [values[name] for name in model.parameters]
    function = _function(item.formula, ("X", "X0", "omega", *model.parameters))
    stiffness = {
        "the printed formula, taken about zero mean,": float(function(high, 0.0, float(omega[0]), *numbers)),
        "the derivation with the mean": float(derived.stiffness[0]),
    }
    if not np.isfinite(exact) or min(stiffness.values()) <= 0:
        return item
    said = []
    for name, k in stiffness.items():
        frequency = np.sqrt(k / mass) / (2 * np.pi)
        said.append(
            f"{name} gives {quantity_text(k, 'N/m')} and so {number_text(frequency, 5)} Hz "
            f"({100 * (frequency / exact - 1):+.2f} % in frequency, "
            f"{100 * ((frequency / exact) ** 2 - 1):+.2f} % in stiffness)"
        )
    words = (
        f"Free vibration of the identified spring has exactly {number_text(exact, 5)} Hz, by energy "
        "between its two turning "
        f"points; {'; '.join(said)}. The law pushes the mean to "
        f"{quantity_text(float(derived.mean[0]), 'm', 3)} at "
        f"X = {quantity_text(high, 'm', 3)}."
    )
    return PrintedFormula(
        item.what, item.formula, item.agrees, item.largest_deviation, item.where, (*item.sentences, words)
    )
