"""Reduction of a law: every abs, sign, Heaviside, Piecewise, Min and Max becomes steps and terms.

    |s| = s sign(s),  sign(s) = 2 H(s) - 1,  Max(a, b) = b + (a - b) H(a - b)

Sums and products are decomposed completely. Inside other functions (exp, log, non-integer powers,
denominators) a decomposition would give differences of huge or undefined numbers: exp(-abs(v)/w) would be
exp(v/w) plus a step times (exp(-v/w) - exp(v/w)). There Abs(g) and Heaviside(s) of one switch stay, and a
term is smooth between the switches.

Thresholds of a step H(s), s without switches: s is split into factors, numerator and denominator alike, and
polynomials in x and v of moderate degree are factored further (``_factors``). Only factors of odd order
change the sign. One that is linear in x or v alone has its root for a threshold. All others that change it,
as quadratics without rational roots and functions of both x and v, keep their function as the place of the
step (``_other``). A distance with an offset, a abs(g) + c, has two thresholds (``_step_of_distance``); any
other s with switches is asked with each of them on and off (``_step_by_cases``).

A Piecewise is the sum of its branches, each where its condition holds and none before it does; together they
must hold everywhere, so that the last condition is mostly True. A relation a < b is the step H(b - a), and
a <= b is the same one; equality, which holds at single moments, is false.
"""

from __future__ import annotations

from functools import lru_cache

import sympy
from sympy.core.function import AppliedUndef
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from rsgen.common.errors import ExpressionError
from rsgen.formula.bounds import MAX_DERIVED_BITS, MAX_EXPONENT
from rsgen.formula.names import STATE_V, STATE_X
from rsgen.law.forms import (
    ALWAYS,
    Form,
    Key,
    add,
    complement,
    constant,
    expanded,
    is_long,
    is_zero,
    moves,
    multiply,
    scale,
    sign_of_parameter,
    split_moving,
    step,
    step_of_parameter,
    without_signs,
)

# ----------------------------------------------------------------------------
# Where a smooth function of x and v changes its sign: H(s) as steps x - b and v - w where that can be.

MAX_COEFFICIENT = 2**128
"""Largest numerator or denominator in a polynomial that is factored: of 1e300 it took half a minute."""

MAX_DEGREE = 12
"""Largest degree of a polynomial that is factored."""


def _linear(factor: sympy.Expr, variable: sympy.Symbol) -> Form | None:
    """Return the sign of a polynomial in one variable; None where it is not linear."""
    if is_long(factor):
        return None
    try:
        polynomial = sympy.Poly(factor, variable)
    except sympy.PolynomialError:
        return None
    coefficients = polynomial.all_coeffs()
    if polynomial.degree() != 1 or any(moves(c) for c in coefficients):
        return None
    slope, offset = coefficients
    threshold = sympy.expand_mul(-offset / slope)
    place = step(x=threshold) if variable == STATE_X else step(v=threshold)
    return multiply(add(constant(-1), scale(place, 2)), sign_of_parameter(slope))


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
    form = _linear(factor, states.pop()) if len(states) == 1 else None
    return _other(factor) if form is None else form


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
            small = len(degrees) == 2 and sum(degrees) <= MAX_DEGREE and not _explodes(root)
            factors = _factored(root) if small and root.is_Add and len(root.args) <= 12 else ((root, 1),)
            listed.extend((factor, exponent * order) for factor, order in factors)
    return tuple(listed)


def _factored(function: sympy.Expr) -> tuple[tuple[sympy.Expr, int], ...]:
    """Factor a polynomial in x and v; one whose coefficients SymPy takes for no numbers, as 2**n, stays."""
    try:
        number, factors = sympy.factor_list(function)
    except sympy.PolynomialError:
        return ((function, 1),)
    return ((number, 1), *factors)


def _explodes(expression: sympy.Expr) -> bool:
    """Decide whether numbers are long, or a power of a number, as exp(1e29), would be a long polynomial."""
    if any(_longest(number) > MAX_COEFFICIENT for number in expression.atoms(sympy.Rational)):
        return True
    powers = (power.exp for power in expression.atoms(sympy.Pow, sympy.exp) if power.exp.is_Rational)
    return any(_longest(power) > MAX_EXPONENT for power in powers)


def _longest(number: sympy.Rational) -> int:
    return max(abs(int(number.p)), int(number.q))


@lru_cache(maxsize=4096)
def sign_of_smooth(function: sympy.Expr) -> Form:
    """Return sign(s) of a function without switches of its own, as a form."""
    return multiply(*(_sign_of_factor(factor) for factor, order in _factors(function) if order % 2))


def step_of_smooth(function: sympy.Expr) -> Form:
    """Return H(s) of a function without switches of its own, as a form."""
    return scale(complement(scale(sign_of_smooth(function), -1)), sympy.Rational(1, 2))


SWITCHING = (sympy.Abs, sympy.sign, sympy.Heaviside, sympy.Piecewise, sympy.Max, sympy.Min)
_EVEN = (sympy.cos, sympy.cosh)
_ODD = (sympy.sin, sympy.tan, sympy.sinh, sympy.tanh, sympy.asin, sympy.atan)


def _switches(expression: sympy.Basic) -> bool:
    return any(moves(atom) for atom in expression.atoms(*SWITCHING))


def reduce_law(force: sympy.Expr) -> Form:
    """Return the form of a law; the sum of its terms times their steps is the law.

    Raises
    ------
    ExpressionError
        The law is not real (``x**1.5``), not defined everywhere (a Piecewise that ends), contains a function
        that is not known, or has more pieces than any sensible law.
    """
    if force.atoms(AppliedUndef) or force.has(sympy.I, sympy.zoo, sympy.nan, sympy.oo):
        raise ExpressionError(f"law: {force}: every function and number in it must be known, real and finite")
    for power in force.atoms(sympy.Pow):
        _check_power(power)
    exact = {f: sympy.Rational(str(f)) for f in force.atoms(sympy.Float)}
    form = without_signs(_form(force.xreplace(exact)))
    reduced = {key: _cancelled(expanded(term)) for key, term in form.items()}
    numbers = (number for term in reduced.values() for number in term.atoms(sympy.Rational))
    if any(max(int(n.p).bit_length(), int(n.q).bit_length()) > MAX_DERIVED_BITS for n in numbers):
        raise ExpressionError(
            "law: multiplied out it has a number of more than a thousand digits; use numbers and powers of "
            "sizes that a measurement has"
        )
    return {key: term for key, term in reduced.items() if not is_zero(term)}


def _cancelled(term: sympy.Expr) -> sympy.Expr:
    """Divide out denominators that move where that leaves none: ``x/(x - b) - b/(x - b)`` is one."""
    divided = any(moves(power.base) and power.exp.is_negative for power in term.atoms(sympy.Pow))
    if not divided or is_long(term) or not term.is_rational_function(STATE_X, STATE_V):
        return term
    quotient = sympy.cancel(term)
    return term if moves(sympy.fraction(quotient)[1]) else expanded(quotient)


def _form(expression: sympy.Expr) -> Form:
    """Rewrite an expression as a sum of terms behind steps, from the outermost operation inwards."""
    if not _switches(expression):
        return constant(expression)
    if expression.is_Add:
        return add(*map(_form, expression.args))
    if expression.is_Mul:
        return multiply(*map(_form, expression.args))
    if expression.is_Pow:
        return _power(expression)
    if isinstance(expression, sympy.Abs):
        return _absolute(expression.args[0])
    if isinstance(expression, sympy.sign):
        return _sign(expression.args[0])
    if isinstance(expression, sympy.Heaviside):
        return _step(expression.args[0])
    if isinstance(expression, sympy.Max | sympy.Min):
        return _extreme(expression)
    if isinstance(expression, sympy.Piecewise):
        return _piecewise(expression)
    return _function(expression)


def _check_power(expression: sympy.Pow) -> None:
    if expression.exp.is_integer or not moves(expression.base):
        return
    _, rest = split_moving(expression.base, as_Add=False)
    if rest in (STATE_X, STATE_V):
        raise ExpressionError(
            f"law: {expression}: not real for negative {rest}; write abs({rest})**p*sign({rest}) for an odd "
            f"power, abs({rest})**p for an even one, or a whole number as exponent"
        )


def _power(power: sympy.Pow) -> Form:
    """Rewrite a power: whole powers are multiplied out, of others the sign goes to the base."""
    base, exponent = power.as_base_exp()
    if exponent.is_Integer and 0 < exponent <= MAX_EXPONENT:
        return multiply(*[_form(base)] * int(exponent))
    if exponent.is_Integer and isinstance(base, sympy.Abs):
        inner = base.args[0]
        if not _switches(inner):
            return scale(_sign(inner), inner**exponent) if exponent % 2 else constant(inner**exponent)
    if moves(exponent) or not exponent.is_real:
        return constant(_within(power))
    if isinstance(base, sympy.Abs) and not _switches(base.args[0]):
        coefficient, rest = split_moving(base.args[0], as_Add=False)
        return constant(sympy.Abs(coefficient) ** exponent * sympy.Abs(rest) ** exponent)
    form = _form(base)
    if len(form) == 1 and ALWAYS not in form and not exponent.is_nonpositive:
        ((key, term),) = form.items()
        if not _switches(term):
            factors = [
                f**exponent if f.is_nonnegative else sympy.Abs(f) ** exponent
                for f in sympy.Mul.make_args(sympy.factor_terms(term))
            ]
            return {key: sympy.Mul(*factors)}
    return constant(_within(power))


def _absolute(inner: sympy.Expr) -> Form:
    coefficient, rest = split_moving(inner, as_Add=False)
    if _switches(rest):
        return scale(multiply(_form(rest), _sign(rest)), sympy.Abs(coefficient))
    return scale(scale(sign_of_smooth(rest), rest), sympy.Abs(coefficient))


def _sign(inner: sympy.Expr) -> Form:
    return add(scale(_step(inner), 2), constant(-1)) if _switches(inner) else sign_of_smooth(inner)


def _step(inner: sympy.Expr) -> Form:
    """Return H(s), s with switches of its own or without."""
    if not moves(inner):
        return step_of_parameter(inner)
    if not _switches(inner):
        return step_of_smooth(inner)
    symmetric = _step_of_distance(inner)
    return _step_by_cases(_form(inner)) if symmetric is None else symmetric


def _step_of_distance(inner: sympy.Expr) -> Form | None:
    """Return H(a abs(g) + c) with the two thresholds +-max(0, -c/a), which holds for either sign of c."""
    offset, moving = split_moving(inner, as_Add=True)
    slope, distance = split_moving(moving, as_Add=False)
    if not isinstance(distance, sympy.Abs) or _switches(distance.args[0]):
        return None
    factor, function = split_moving(distance.args[0], as_Add=False)
    reach = sympy.expand_mul(-offset / (slope * sympy.Abs(factor)))
    reach = reach if reach.is_nonnegative else sympy.Max(0, reach)
    outside = add(step_of_smooth(function - reach), step_of_smooth(-function - reach))
    sign = multiply(sign_of_parameter(slope), add(scale(outside, 2), constant(-1)))
    return scale(add(constant(1), sign), sympy.Rational(1, 2))


MAX_NESTED_SWITCHES = 7
"""Largest number of switches inside a switch function; each doubles the number of cases."""


def _step_by_cases(form: Form) -> Form:
    """Return H(sum of terms behind steps): with one step on and off in turn, until none is left."""
    if len({single for key in form for single in _singles(key)}) > MAX_NESTED_SWITCHES:
        raise ExpressionError(
            f"law: a condition with more than {MAX_NESTED_SWITCHES} switches of its own; write it with fewer "
            "abs, sign, Min, Max inside each other"
        )
    for key in form:
        for single in _singles(key):
            with_step = add(*({_without(k, single): t} for k, t in form.items()))
            without_step = {k: t for k, t in form.items() if single not in _singles(k)}
            indicator: Form = {single: sympy.S.One}
            return add(
                multiply(indicator, _step_by_cases(with_step)),
                multiply(complement(indicator), _step_by_cases(without_step)),
            )
    term = form.get(ALWAYS, sympy.S.Zero)
    return step_of_smooth(term) if moves(term) else step_of_parameter(term)


def _singles(key: Key) -> list[Key]:
    """List the steps of a key, each as a key of its own."""
    singles = [Key(x=key.x)] if key.x is not None else []
    if key.v is not None:
        singles.append(Key(v=key.v))
    singles += [Key(others=frozenset((s,))) for s in sorted(key.others, key=sympy.default_sort_key)]
    return singles + [Key(signs=frozenset((s,))) for s in sorted(key.signs, key=sympy.default_sort_key)]


def _without(key: Key, single: Key) -> Key:
    return Key(
        None if single.x is not None and key.x == single.x else key.x,
        None if single.v is not None and key.v == single.v else key.v,
        key.others - single.others,
        key.signs - single.signs,
    )


def _extreme(extreme: sympy.Max | sympy.Min) -> Form:
    """Return Max(a, b) = b + (a - b) H(a - b), Min likewise with the step the other way."""
    constants = [argument for argument in extreme.args if not moves(argument)]
    arguments = [argument for argument in extreme.args if moves(argument)]
    if constants:
        arguments.append(extreme.func(*constants))
    arguments.sort(key=lambda a: (moves(a), sympy.default_sort_key(a)))
    first, *rest = arguments
    largest = _form(first)
    for argument in rest:
        difference = add(_form(argument), scale(largest, -1))
        if len(rest) == 1 and not isinstance(first, SWITCHING):
            larger = _step(argument - first)
        else:
            larger = _step_by_cases(difference)
        if isinstance(extreme, sympy.Min):
            larger = complement(larger)
        largest = add(largest, multiply(difference, larger))
    return largest


def _piecewise(law: sympy.Piecewise) -> Form:
    """Return the sum of the branches, each where its condition holds and none before it does."""
    remaining, total = constant(1), dict[Key, sympy.Expr]()
    for branch, condition in law.args:
        case = multiply(remaining, _condition(condition))
        total = add(total, multiply(case, _form(branch)))
        remaining = add(remaining, scale(case, -1))
    if remaining:
        raise ExpressionError(
            f"law: {law}: not defined everywhere; the last branch of a Piecewise needs the condition True"
        )
    return total


def _condition(condition: sympy.Basic) -> Form:
    """Return 1 where a condition holds, else 0; equality, which holds at single moments, is false."""
    if isinstance(condition, BooleanTrue | sympy.Ne):
        return constant(1)
    if isinstance(condition, BooleanFalse | sympy.Eq):
        return {}
    if isinstance(condition, sympy.Not):
        return complement(_condition(condition.args[0]))
    if isinstance(condition, sympy.And | sympy.Or):
        negate = isinstance(condition, sympy.Or)
        parts = map(_condition, condition.args)
        return complement(multiply(*map(complement, parts))) if negate else multiply(*parts)
    if isinstance(condition, sympy.Rel):
        return _step(condition.gts - condition.lts)
    raise ExpressionError(f"law: {condition}: no condition; use <, <=, >, >= with & and |")


def _function(function: sympy.Expr) -> Form:
    """Write f(g) as steps and terms if that is exact: by parity, or one term behind steps; else keep it."""
    if len(function.args) == 1:
        (argument,) = function.args
        coefficient, rest = split_moving(argument, as_Add=False)
        if isinstance(rest, sympy.Abs) and isinstance(function, _EVEN + _ODD):
            smooth = _form(function.func(coefficient * rest.args[0]))
            return smooth if isinstance(function, _EVEN) else multiply(smooth, _sign(rest.args[0]))
        form = _form(argument)
        if len(form) == 1 and ALWAYS not in form:
            ((key, term),) = form.items()
            rest_value = function.func(sympy.S.Zero)
            if not _switches(term) and rest_value.is_finite:
                return add(constant(rest_value), {key: function.func(term) - rest_value})
    return constant(_within(function))


def _within(expression: sympy.Expr) -> sympy.Expr:
    """Rewrite what stands inside a function with Abs(g) and Heaviside(s) of single switches only."""
    if not _switches(expression):
        return expression
    if isinstance(expression, SWITCHING):
        return _written(_form(expression))
    return expression.func(*(_within(a) if isinstance(a, sympy.Expr) else a for a in expression.args))


def _function_of(single: Key) -> sympy.Expr:
    if single.x is not None:
        return STATE_X - single.x
    if single.v is not None:
        return STATE_V - single.v
    (function,) = single.others
    return function


def _written(form: Form) -> sympy.Expr:
    """Write a form as one expression; a continuous change of slope at one switch becomes Abs."""
    form = without_signs(form)
    rest, total = form.get(ALWAYS, sympy.S.Zero), sympy.S.Zero
    for key, term in form.items():
        singles = _singles(key)
        if not singles:
            continue
        distance = _function_of(singles[0])
        slope = term
        if len(singles) == 1:
            slope = term / distance if is_long(term) else sympy.cancel(term / distance)
        if len(singles) == 1 and not moves(slope) and not key.others:
            rest += term / 2
            total += slope * sympy.Abs(distance) / 2
        else:
            total += term * sympy.Mul(*(sympy.Heaviside(_function_of(s)) for s in singles))
    return expanded(rest) + total


def inner_switches(term: sympy.Expr) -> tuple[Key, ...]:
    """List the switches that a term keeps inside functions, as keys of one step each."""
    found: dict[Key, None] = {}
    for atom in sorted(term.atoms(sympy.Abs, sympy.Heaviside), key=sympy.default_sort_key):
        if moves(atom):
            for key in without_signs(_step(atom.args[0])):
                found.update(dict.fromkeys(_singles(key)))
    return tuple(found)
