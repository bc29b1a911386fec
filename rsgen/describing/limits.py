"""What a describing function becomes for small and large amplitudes, by leading powers of X."""

from __future__ import annotations

from dataclasses import dataclass

import sympy

from rsgen.expression import symbol

__all__ = ["Limit", "limit_at_infinity", "limit_at_zero"]

X, X0 = symbol("X"), symbol("X0")

ORDER = 5
"""Terms kept of every series in X or 1/X: more than any cancellation of leading terms has needed."""


@dataclass(frozen=True, slots=True)
class Limit:
    """The limit of "stiffness" or "damping" for X -> 0 or X -> oo (``place``), possibly infinite."""

    quantity: str
    place: sympy.Expr
    value: sympy.Expr


def limit_at_zero(formula: sympy.Expr) -> sympy.Expr | None:
    """Give the limit for X -> 0, or None where it does not follow from leading powers."""
    formula = _branch(formula, first=True)
    if formula is None:
        return None
    formula = formula.replace(sympy.besselj, lambda n, z: _bessel_series(n, z, -1))
    formula = formula.replace(sympy.besseli, lambda n, z: _bessel_series(n, z, 1))
    return _leading(formula, smallest=True)


def limit_at_infinity(formula: sympy.Expr) -> sympy.Expr | None:
    """Give the limit for X -> oo, or None where it does not follow from leading powers."""
    formula = _branch(formula, first=False)
    if formula is None:
        return None
    t = sympy.Symbol("t")
    angle = sympy.series(sympy.asin(t), t, 0, 2 * ORDER).removeO()
    root = sympy.series(sympy.sqrt(1 - t), t, 0, ORDER).removeO()
    formula = formula.replace(sympy.asin, lambda z: angle.subs(t, z))
    for power in formula.atoms(sympy.Pow):
        rate = power.base.coeff(X, 2) if power.exp == sympy.Rational(1, 2) else sympy.S.Zero
        if not rate.is_zero:
            inner = 1 - power.base / (rate * X**2)
            formula = formula.xreplace({power: sympy.sqrt(rate) * X * root.subs(t, sympy.expand(inner))})
    # J_n(a X) falls off as X**(-1/2): its place is taken by a power, its factor does not matter
    swing = sympy.Dummy("swing", positive=True)
    formula = formula.replace(sympy.besselj, lambda n, z: swing * X ** sympy.Rational(-1, 2))
    limit = _leading(formula, smallest=False)
    return None if limit is None or limit.has(swing) else limit


def _branch(formula: sympy.Expr, first: bool) -> sympy.Expr | None:
    """Take the case for small or for large amplitude out of every Piecewise."""
    for cases in formula.atoms(sympy.Piecewise):
        if len(cases.args) > 2 and first:
            return None
        formula = formula.xreplace({cases: cases.args[0 if first else -1][0]})
    if formula.has(sympy.Piecewise, sympy.Integral, sympy.Max, sympy.Min, X0):
        return None
    return formula


def _bessel_series(order: sympy.Expr, z: sympy.Expr, sign: int) -> sympy.Expr:
    return sympy.Add(
        *(
            sign**k * (z / 2) ** (2 * k + order) / (sympy.factorial(k) * sympy.gamma(k + order + 1))
            for k in range(ORDER)
        )
    )


def _leading(formula: sympy.Expr, smallest: bool) -> sympy.Expr | None:
    """Find the limit of a sum of real powers of X from its leading one."""
    powers: dict[sympy.Expr, sympy.Expr] = {}
    for addend in sympy.Add.make_args(sympy.powsimp(sympy.expand(formula))):
        coefficient, exponent = addend.as_coeff_exponent(X)
        if coefficient.has(X) or not exponent.is_Rational:
            return None
        powers[exponent] = powers.get(exponent, sympy.S.Zero) + coefficient
    present = {e: sympy.expand(c) for e, c in powers.items()}
    present = {e: c for e, c in present.items() if not c.is_zero}
    if not present:
        return sympy.S.Zero
    leading = min(present) if smallest else max(present)
    if leading == 0:
        return present[leading]
    if (leading < 0) == smallest:
        return sympy.oo * sympy.sign(present[leading])
    return sympy.S.Zero
