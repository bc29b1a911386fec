"""What a describing function becomes for small and large amplitudes, by leading powers of X."""

from __future__ import annotations

from dataclasses import dataclass

import sympy

from rsgen.formula import symbol
from rsgen.formula.names import X0, X
from rsgen.law.normal_form import is_long

__all__ = ["Limit", "grows_slowly", "limit_at_infinity", "limit_at_rest", "limit_at_zero"]

STATES = symbol("x"), symbol("v")

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
    limit = _leading(formula, smallest=True)
    return _finite(formula.subs(X, 0)) if limit is None else limit


def limit_at_infinity(formula: sympy.Expr) -> sympy.Expr | None:
    """Give the limit for X -> oo, or None where it does not follow from leading powers."""
    formula = _branch(formula, first=False)
    if formula is None:
        return None
    formula = formula.replace(sympy.asin, _asin_series)
    for power in formula.atoms(sympy.Pow):
        rate = power.base.coeff(X, 2) if power.exp == sympy.Rational(1, 2) else sympy.S.Zero
        if not rate.is_zero:
            inner = 1 - power.base / (rate * X**2)
            formula = formula.xreplace({power: sympy.sqrt(rate) * X * _root_series(sympy.expand(inner))})
    # J_n(a X) falls off as X**(-1/2): its place is taken by a power, its factor does not matter
    swing = sympy.Dummy("swing", positive=True)
    formula = formula.replace(sympy.besselj, lambda n, z: swing * X ** sympy.Rational(-1, 2))
    limit = _leading(formula, smallest=False)
    return None if limit is None or limit.has(swing) else limit


def _asin_series(z: sympy.Expr) -> sympy.Expr:
    """Taylor polynomial of asin(z) at 0."""
    return sympy.Add(
        *(
            sympy.binomial(2 * n, n) / sympy.Integer(4) ** n / (2 * n + 1) * z ** (2 * n + 1)
            for n in range(ORDER)
        )
    )


def _root_series(z: sympy.Expr) -> sympy.Expr:
    """Taylor polynomial of sqrt(1 - z) at 0."""
    return sympy.Add(*(sympy.binomial(sympy.Rational(1, 2), n) * (-z) ** n for n in range(ORDER)))


def _finite(value: sympy.Expr) -> sympy.Expr | None:
    """Give a value, or None where it is not finite or is zero to a power that is not known."""
    unknown = any(power.base.is_zero for power in value.atoms(sympy.Pow))
    return None if unknown or value.has(sympy.nan, sympy.zoo, sympy.oo) else value


def _sides(alone: sympy.Expr, state: sympy.Symbol, t: sympy.Symbol) -> list[sympy.Expr]:
    """Give a law on either side of rest; none where it is not real there, as log(-t)."""
    try:
        return [alone.xreplace({state: side}) for side in (t, -t)]
    except TypeError:
        return []


def limit_at_rest(law: sympy.Expr, state: sympy.Symbol) -> sympy.Expr | None:
    """Give the limit of stiffness (``state`` x) or damping (v) for X -> 0 by the slope of the law at rest.

    The motion is centred. The slopes on both sides count alike; a jump is infinitely stiff. None where the
    terms in ``state`` contain the other state as well, or where a switch cannot be decided.
    """
    alone = _terms_alone(law, state)
    if alone is None:
        return None
    # the distance from rest is positive on either side
    t = sympy.Symbol("t", positive=True)
    sides = _sides(alone, state, t)
    if any(atom.has(t) for side in sides for atom in side.atoms(*_KINKED)):
        return None
    if not sides:
        return None
    right, left = (_finite(side.subs(t, 0)) for side in sides)
    if right is None or left is None:
        return None
    jump = sympy.expand(right - left)
    if not jump.is_zero:
        return sympy.oo * sympy.sign(jump / 2)
    ahead, behind = (_finite(side.diff(t).subs(t, 0)) for side in sides)
    return None if ahead is None or behind is None else sympy.expand((ahead - behind) / 2)


def grows_slowly(law: sympy.Expr, state: sympy.Symbol) -> bool:
    """Decide whether a law is seen to grow slower than its state, so that it adds nothing for X -> oo."""
    alone = _terms_alone(law, state)
    if alone is None:
        return False
    t = sympy.Symbol("t", positive=True)
    growths = [_growth(side, t) for side in _sides(alone, state, t)]
    return bool(growths) and all(growth is not None and growth < 1 for growth in growths)


def _terms_alone(law: sympy.Expr, state: sympy.Symbol) -> sympy.Expr | None:
    """Give the addends with a state; None where they contain the other one as well."""
    (other,) = (s for s in STATES if s != state)
    alone = sympy.Add(*(a for a in sympy.Add.make_args(sympy.expand_mul(law)) if a.has(state)))
    return None if alone.has(other) else alone


_KINKED = (sympy.Abs, sympy.sign, sympy.Heaviside, sympy.Max, sympy.Min, sympy.Piecewise)
_BOUNDED = (sympy.tanh, sympy.atan, sympy.sin, sympy.cos, sympy.sign, sympy.Heaviside)


def _growth(law: sympy.Expr, t: sympy.Symbol) -> sympy.Expr | None:
    """Bound the power of t with which a law grows; None where no bound is seen."""
    if not law.has(t) or isinstance(law, _BOUNDED):
        return sympy.S.Zero
    if law == t:
        return sympy.S.One
    if law.is_Add or law.is_Mul or isinstance(law, sympy.Abs):
        rates = [_growth(argument, t) for argument in law.args]
        if None in rates:
            return None
        return sympy.Add(*rates) if law.is_Mul else sympy.Max(*rates)
    if isinstance(law, sympy.log):
        # slower than any power
        rate = _growth(law.args[0], t)
        return None if rate is None else sympy.Rational(1, 100) * sympy.sign(rate)
    if law.is_Pow and law.exp.is_Rational and law.base.is_polynomial(t):
        # every coefficient may be any number but zero
        return law.exp * sympy.degree(law.base, t)
    return None


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
    if is_long(formula):
        return None
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
