"""Where a smooth function of x and v changes its sign: H(s) as steps x - b and v - w where that can be."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import sympy

from rsgen.formula.bounds import EXPONENT
from rsgen.law.normal_form import (
    STATE_V,
    STATE_X,
    Form,
    add,
    apart,
    complement,
    constant,
    is_long,
    moves,
    multiply,
    scale,
    sign_of_parameter,
    step,
)

__all__ = ["sign_of_smooth", "step_of_smooth"]

LARGEST_COEFFICIENT = 2**128
"""Polynomials with larger numbers, above or below the line, are not factored: 1e300 in a law of three minima
took half a minute. Numbers of twice the digits of a double are below."""

HIGHEST_DEGREE = 12
"""Polynomials beyond are not factored: their roots would be numbers without meaning to a reader."""

_INVERSE: dict[type, tuple[Callable[[sympy.Expr], sympy.Expr], float, float]] = {
    sympy.exp: (sympy.log, 0, sympy.oo),
    sympy.log: (sympy.exp, -sympy.oo, sympy.oo),
    sympy.sinh: (sympy.asinh, -sympy.oo, sympy.oo),
    sympy.tanh: (sympy.atanh, -1, 1),
    sympy.atan: (sympy.tan, -sympy.pi / 2, sympy.pi / 2),
    sympy.asin: (sympy.sin, -sympy.pi / 2, sympy.pi / 2),
}
"""Increasing functions, their inverse and their range."""


def _step_at(variable: sympy.Symbol, threshold: sympy.Expr) -> Form:
    return step(x=threshold) if variable == STATE_X else step(v=threshold)


def _signs_from_roots(variable: sympy.Symbol, roots: list[sympy.Expr]) -> Form:
    """Give the sign of prod (variable - root)."""
    product = constant(1)
    for root in roots:
        product = multiply(product, add(constant(-1), scale(_step_at(variable, root), 2)))
    return product


def _quadratic(variable: sympy.Symbol, a: sympy.Expr, b: sympy.Expr, c: sympy.Expr) -> Form:
    """Give the sign of a s**2 + b s + c; a negative discriminant makes both roots one, which never acts."""
    discriminant = sympy.expand(b**2 / 4 - a * c)
    if discriminant.is_nonpositive:
        return sign_of_parameter(a)
    if not discriminant.is_nonnegative:
        discriminant = sympy.Max(0, discriminant)
    half = sympy.sqrt(discriminant) / sympy.Abs(a)
    middle = -b / (2 * a)
    inside = add(_step_at(variable, middle - half), scale(_step_at(variable, middle + half), -1))
    return multiply(add(constant(1), scale(inside, -2)), sign_of_parameter(a))


def _polynomial(factor: sympy.Expr, variable: sympy.Symbol) -> Form | None:
    """Give the sign of an irreducible polynomial in one variable, or None where its roots are not known."""
    if is_long(factor):
        return None
    try:
        polynomial = sympy.Poly(factor, variable)
    except sympy.PolynomialError:
        return None
    coefficients = polynomial.all_coeffs()
    if any(moves(c) for c in coefficients):
        return None
    degree = polynomial.degree()
    if degree == 1:
        slope, offset = coefficients
        threshold = sympy.expand_mul(-offset / slope)
        return multiply(_signs_from_roots(variable, [threshold]), sign_of_parameter(slope))
    if degree == 2:
        return _quadratic(variable, *coefficients)
    if degree <= HIGHEST_DEGREE and all(c.is_Rational for c in coefficients):
        # irreducible: real roots are simple and no radicals worth reading
        roots = [root.evalf(30) for root in sympy.real_roots(polynomial)]
        return scale(_signs_from_roots(variable, roots), sympy.sign(coefficients[0]))
    if len(polynomial.terms()) == 2 and degree % 2 == 1 and not coefficients[-1].is_zero:
        ratio = -coefficients[-1] / coefficients[0]
        root = sympy.sign(ratio) * sympy.Abs(ratio) ** sympy.Rational(1, degree)
        return multiply(_signs_from_roots(variable, [root]), sign_of_parameter(coefficients[0]))
    return None


def _monotone(factor: sympy.Expr) -> Form | None:
    """Give the sign of a f(g) + c for an increasing f, by g against the inverse of f at -c/a."""
    offset, moving = apart(factor, as_Add=True)
    slope, inner = apart(moving, as_Add=False)
    known = _INVERSE.get(type(inner))
    if known is None:
        return None
    inverse, lowest, highest = known
    level = -offset / slope
    unbounded = lowest == -sympy.oo and highest == sympy.oo
    if not (unbounded or level.is_number):
        return None
    if not unbounded and (level <= lowest) == True:  # noqa: E712 - a sympy relation, undecided is no
        up = constant(1)
    elif not unbounded and (level >= highest) == True:  # noqa: E712 - as above
        up = {}
    else:
        up = step_of_smooth(inner.args[0] - inverse(level))
    return multiply(sign_of_parameter(slope), add(scale(up, 2), constant(-1)))


def _other(factor: sympy.Expr) -> Form:
    """Keep a step whose place is not known, its function in one of its two signs always."""
    factor = sympy.expand_mul(factor)
    if factor.could_extract_minus_sign():
        return add(constant(1), scale(step(other=-factor), -2))
    return add(constant(-1), scale(step(other=factor), 2))


def _sign_of_factor(factor: sympy.Expr) -> Form:
    if not moves(factor):
        return sign_of_parameter(factor)
    if factor.is_nonnegative:
        return constant(1)
    if factor.is_nonpositive:
        return constant(-1)
    states = factor.free_symbols & {STATE_X, STATE_V}
    known = _polynomial(factor, states.pop()) if len(states) == 1 else None
    if known is None:
        known = _monotone(factor)
    return _other(factor) if known is None else known


@lru_cache(maxsize=4096)
def _factors(function: sympy.Expr) -> tuple[tuple[sympy.Expr, int], ...]:
    """Split into factors; numerator and denominator alike, since only signs matter."""
    if is_long(function):
        return ((function, 1),)
    listed: list[tuple[sympy.Expr, int]] = []
    for part in sympy.fraction(sympy.together(function)):
        for base in sympy.Mul.make_args(part):
            root, power = base.as_base_exp()
            exponent = int(power) if power.is_Integer else 1
            root = root if power.is_Integer else base
            degrees = [sympy.degree(root, s) for s in (STATE_X, STATE_V) if root.is_polynomial(s)]
            small = len(degrees) == 2 and sum(degrees) <= HIGHEST_DEGREE and not _explodes(root)
            found = _factored(root) if small and root.is_Add and len(root.args) <= 12 else ((root, 1),)
            listed.extend((factor, exponent * order) for factor, order in found)
    return tuple(listed)


def _factored(function: sympy.Expr) -> tuple[tuple[sympy.Expr, int], ...]:
    """Factor a polynomial in x and v; one whose coefficients SymPy takes for no numbers, as 2**n, stays."""
    try:
        number, factors = sympy.factor_list(function)
    except sympy.PolynomialError:
        return ((function, 1),)
    return ((number, 1), *factors)


def _explodes(expression: sympy.Expr) -> bool:
    """Whether numbers are long, or powers of a number as exp(1e29) would be polynomials of that degree."""
    if any(_longest(number) > LARGEST_COEFFICIENT for number in expression.atoms(sympy.Rational)):
        return True
    powers = (power.exp for power in expression.atoms(sympy.Pow, sympy.exp) if power.exp.is_Rational)
    return any(_longest(power) > EXPONENT for power in powers)


def _longest(number: sympy.Rational) -> int:
    return max(abs(int(number.p)), int(number.q))


@lru_cache(maxsize=4096)
def sign_of_smooth(function: sympy.Expr) -> Form:
    """Give sign(s) of a function without switches of its own, as a form."""
    sign = constant(1)
    for factor, order in _factors(function):
        if order % 2:
            sign = multiply(sign, _sign_of_factor(factor))
    return sign


def step_of_smooth(function: sympy.Expr) -> Form:
    """Give H(s) of a function without switches of its own, as a form."""
    return scale(complement(scale(sign_of_smooth(function), -1)), sympy.Rational(1, 2))
