"""What a source prints against what is derived: agreement, or the largest deviation and where it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy
from numpy.typing import ArrayLike

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.describing.function import DescribingFunction
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.notation import readable

__all__ = ["PrintedComparison", "compare_printed"]

QUANTITIES = ("stiffness", "damping")

AGREEMENT = 1e-9
"""Relative difference up to which a printed formula is the derived one."""

RANDOM_SETS = 64


@dataclass(frozen=True, slots=True)
class PrintedComparison:
    """One printed formula held against the derived one.

    Parameters
    ----------
    what
        "stiffness" or "damping".
    formula
        The printed formula.
    agrees
        Whether both are the same, symbolically or on all points compared.
    largest_deviation
        Largest \\|printed - derived\\| / \\|derived\\| [1]; zero where both agree symbolically.
    where
        The point of the largest deviation: X, omega and the parameters, in SI units; empty where all agrees.
    regime
        The condition of the derived case that holds there; True where one formula holds for all X.
    sentence
        The result as a sentence for a report.
    """

    what: str
    formula: sympy.Expr
    agrees: bool
    largest_deviation: float
    where: Mapping[str, float]
    regime: sympy.Basic
    sentence: str


def compare_printed(
    derived: DescribingFunction,
    printed: Mapping[str, sympy.Expr],
    values: Mapping[str, float] | None = None,
    X: ArrayLike | None = None,
    omega: float = 1.0,
) -> tuple[PrintedComparison, ...]:
    """Compare printed formulas with the derived ones, symbolically or else regime by regime in numbers.

    A printed formula without X0 is compared with the derived one at the mean that balances the law, so that
    a formula about zero mean shows how much it is biased.

    Parameters
    ----------
    derived
        Describing function of the whole force.
    printed
        "stiffness", "damping" or both, in X, omega and the parameters of the law.
    values
        Parameters in SI units at which to compare; None compares at random positive ones.
    X
        Amplitudes [m] at which to compare with ``values``; None takes amplitudes in every regime.
    omega
        Angular frequency [rad/s] that goes with ``values``.

    Raises
    ------
    RsgenError
        A quantity other than stiffness and damping, or a name in a formula that the law does not have.
    """
    results = []
    for what, formula in printed.items():
        if what not in QUANTITIES:
            raise RsgenError(f"printed.{what}: unknown; printed formulas are {' and '.join(QUANTITIES)}")
        known = {"X", "X0", "omega", *derived.parameters}
        unknown = sorted({s.name for s in formula.free_symbols} - known)
        if unknown:
            raise RsgenError(
                f"printed.{what}: {', '.join(unknown)}: not in the law; known: {', '.join(sorted(known))}"
            )
        own = derived.stiffness if what == "stiffness" else derived.damping
        if _same(own, formula, derived.positive):
            sentence = f"The printed {what} is the derived one, symbolically."
            results.append(PrintedComparison(what, formula, True, 0.0, {}, sympy.true, sentence))
        else:
            results.append(_numerically(derived, what, formula, _points(derived, values, X, omega)))
    return tuple(results)


def _same(own: sympy.Expr, formula: sympy.Expr, positive: tuple[str, ...]) -> bool:
    """Decide whether both are the same after multiplying out; no is no proof of difference."""
    names = {symbol(name): sympy.Symbol(name, positive=True) for name in positive}
    difference = own.xreplace(names) - formula.xreplace(names)
    if difference.has(sympy.Piecewise, sympy.Integral):
        return bool(difference == 0)
    return bool(sympy.expand(difference) == 0)


def _points(
    derived: DescribingFunction, values: Mapping[str, float] | None, X: ArrayLike | None, omega: float
) -> list[tuple[dict[str, float], Array, float]]:
    """List parameter sets with amplitudes below, between and above all thresholds."""
    if values is not None and X is not None:
        return [(dict(values), np.atleast_1d(np.asarray(X, dtype=np.float64)), omega)]
    rng = np.random.default_rng(20)
    sets = [dict(values)] if values is not None else []
    for _ in range(0 if values is not None else RANDOM_SETS):
        sets.append({name: float(np.exp(rng.uniform(-1, 1))) for name in derived.parameters})
    points = []
    for numbers in sets:
        speed = omega if values is not None else float(np.exp(rng.uniform(-1, 1)))
        edges = [edge for edge in _edges(derived, numbers, speed) if edge > 0]
        low, high = (min(edges) / 5, 5 * max(edges)) if edges else (0.1, 3.0)
        points.append((numbers, np.exp(rng.uniform(np.log(low), np.log(high), 16)), speed))
    return points


def _edges(derived: DescribingFunction, numbers: Mapping[str, float], omega: float) -> list[float]:
    """Give the amplitudes at which a case of the derived formulas ends, at mean zero."""
    X, edges = symbol("X"), []
    known = {symbol(name): value for name, value in numbers.items()} | {symbol("omega"): omega}
    for condition in derived.regimes:
        for relation in condition.atoms(sympy.core.relational.Relational):
            level = (relation.gts - relation.lts).subs(symbol("X0"), 0).subs(known)
            slope = level.coeff(X)
            if slope != 0 and slope.is_number:
                edge = -level.subs(X, 0) / slope
                edges += [float(edge)] if edge.is_number else []
    return edges


def _numerically(
    derived: DescribingFunction,
    what: str,
    formula: sympy.Expr,
    points: list[tuple[dict[str, float], Array, float]],
) -> PrintedComparison:
    names = tuple(symbol(name) for name in ("X", "X0", "omega", *derived.parameters))
    function = compiled((formula,), names)
    worst, where = 0.0, dict[str, float]()
    for numbers, amplitude, omega in points:
        found = derived.evaluate(amplitude, omega, numbers)
        own = found.stiffness if what == "stiffness" else found.damping
        ordered = (numbers[name] for name in derived.parameters)
        (shown,) = function(amplitude, np.nan_to_num(found.mean), omega, *ordered)
        with np.errstate(all="ignore"):
            deviation = np.abs(shown - own) / np.maximum(np.abs(own), 1e-12 * np.abs(shown))
        deviation = np.where(np.isfinite(own), np.where(np.isnan(deviation), 0.0, deviation), -1.0)
        place = int(np.argmax(deviation))
        if deviation[place] > worst:
            worst = float(deviation[place])
            where = {"X": float(amplitude[place]), "omega": omega, **numbers}
            mean = float(found.mean[place])
            where |= {"X0": mean} if np.isfinite(mean) and mean != 0 else {}
    if worst <= AGREEMENT:
        sentence = f"The printed {what} agrees with the derived one to {worst:.1e} in all regimes."
        return PrintedComparison(what, formula, True, worst, {}, sympy.true, sentence)
    regime = _regime(derived, where)
    place_text = ", ".join(f"{name} = {number:.4g}" for name, number in where.items())
    sentence = (
        f"The printed {what} differs from the derived one by up to {100 * worst:.3g} %"
        f"{f' where {readable(regime)}' if regime != sympy.true else ''}, at {place_text} (SI units)."
    )
    return PrintedComparison(what, formula, False, worst, where, regime, sentence)


def _regime(derived: DescribingFunction, where: Mapping[str, float]) -> sympy.Basic:
    numbers = {symbol(name): value for name, value in where.items()} | {symbol("X0"): where.get("X0", 0.0)}
    for condition in derived.regimes:
        if condition.subs(numbers) == sympy.true:
            return condition
    return sympy.true
