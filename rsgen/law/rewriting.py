"""The walk through a law: every abs, sign, Heaviside, Piecewise, Min and Max becomes steps and terms.

What is added and multiplied is taken apart wholly. Inside other functions (exp, log, non-integer powers,
denominators) taking apart would give differences of huge or undefined numbers: exp(-abs(v)/w) would become
exp(v/w) plus a step times (exp(-v/w) - exp(v/w)). There Abs(g) and Heaviside(s) of one switch stay, and a
term is smooth between the switches.
"""

from __future__ import annotations

import sympy
from sympy.core.function import AppliedUndef
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from rsgen.common.errors import ExpressionError
from rsgen.law.normal_form import (
    ALWAYS,
    STATE_V,
    STATE_X,
    Form,
    Key,
    add,
    apart,
    complement,
    constant,
    expanded,
    is_long,
    is_zero,
    moves,
    multiply,
    scale,
    sign_of_parameter,
    step_of_parameter,
    without_signs,
)
from rsgen.law.switches import sign_of_smooth, step_of_smooth

__all__ = ["inner_switches", "reduce_law"]

SWITCHING = (sympy.Abs, sympy.sign, sympy.Heaviside, sympy.Piecewise, sympy.Max, sympy.Min)
_EVEN = (sympy.cos, sympy.cosh)
_ODD = (sympy.sin, sympy.tan, sympy.sinh, sympy.tanh, sympy.asin, sympy.atan)
_MOST_FACTORS = 64
_MOST_BITS = 4000
"""Of the numbers in a law that is multiplied out, four times what the language allows to be written."""
MOST_NESTED = 7
"""Switches inside a switch function: each may be on or off, so that the cases double with every one."""


def _switches(expression: sympy.Basic) -> bool:
    return any(moves(atom) for atom in expression.atoms(*SWITCHING))


def reduce_law(force: sympy.Expr) -> Form:
    """Give the form of a law; the sum of its terms times their steps is the law.

    Raises
    ------
    ExpressionError
        The law is not real (``x**1.5``), not defined everywhere (a Piecewise that ends), contains a function
        nobody knows, or has more pieces than any sensible law.
    """
    if force.atoms(AppliedUndef) or force.has(sympy.I, sympy.zoo, sympy.nan, sympy.oo):
        raise ExpressionError(f"law: {force}: every function and number in it must be known, real and finite")
    for power in force.atoms(sympy.Pow):
        _check_power(power)
    exact = {f: sympy.Rational(str(f)) for f in force.atoms(sympy.Float)}
    form = without_signs(_form(force.xreplace(exact)))
    reduced = {key: _cancelled(expanded(term)) for key, term in form.items()}
    numbers = (number for term in reduced.values() for number in term.atoms(sympy.Rational))
    if any(max(int(n.p).bit_length(), int(n.q).bit_length()) > _MOST_BITS for n in numbers):
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
    if not _switches(expression):
        return constant(expression)
    if expression.is_Add:
        return add(*map(_form, expression.args))
    if expression.is_Mul:
        product = constant(1)
        for factor in expression.args:
            product = multiply(product, _form(factor))
        return product
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
    _, rest = apart(expression.base, as_Add=False)
    if rest in (STATE_X, STATE_V):
        raise ExpressionError(
            f"law: {expression}: not real for negative {rest}; write abs({rest})**p*sign({rest}) for an odd "
            f"power, abs({rest})**p for an even one, or a whole number as exponent"
        )


def _power(power: sympy.Pow) -> Form:
    base, exponent = power.as_base_exp()
    if exponent.is_Integer and 0 < exponent <= _MOST_FACTORS:
        if isinstance(base, sympy.Abs):
            inner = base.args[0]
            even = inner ** (exponent - exponent % 2)
            return multiply(_form(even), _absolute(inner)) if exponent % 2 else _form(even)
        form, product = _form(base), constant(1)
        for _ in range(int(exponent)):
            product = multiply(product, form)
        return product
    if exponent.is_Integer and isinstance(base, sympy.Abs):
        inner = base.args[0]
        if not _switches(inner):
            return scale(_sign(inner), inner**exponent) if exponent % 2 else constant(inner**exponent)
    if moves(exponent) or not exponent.is_real:
        return constant(_within(power))
    if isinstance(base, sympy.Abs) and not _switches(base.args[0]):
        coefficient, rest = apart(base.args[0], as_Add=False)
        return constant(sympy.Abs(coefficient) ** exponent * sympy.Abs(rest) ** exponent)
    if base.is_Mul:
        signless = [f for f in base.args if f.is_nonnegative]
        rest = sympy.Mul(*(f for f in base.args if not f.is_nonnegative))
        if signless:
            product = constant(1) if rest == 1 else _power_of(rest, exponent)
            for factor in signless:
                product = multiply(product, _power_of(factor, exponent))
            return product
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


def _power_of(base: sympy.Expr, exponent: sympy.Expr) -> Form:
    power = base**exponent
    return _form(power)


def _absolute(inner: sympy.Expr) -> Form:
    coefficient, rest = apart(inner, as_Add=False)
    if _switches(rest):
        return scale(multiply(_form(rest), _sign(rest)), sympy.Abs(coefficient))
    return scale(scale(sign_of_smooth(rest), rest), sympy.Abs(coefficient))


def _sign(inner: sympy.Expr) -> Form:
    return add(scale(_step(inner), 2), constant(-1)) if _switches(inner) else sign_of_smooth(inner)


def _step(inner: sympy.Expr) -> Form:
    """Give H(s), s with switches of its own or without."""
    if not moves(inner):
        return step_of_parameter(inner)
    if not _switches(inner):
        return step_of_smooth(inner)
    symmetric = _step_of_distance(inner)
    if symmetric is not None:
        return symmetric
    return _step_by_cases(_form(inner))


def _step_of_distance(inner: sympy.Expr) -> Form | None:
    """Give H(a abs(g) + c) with the two thresholds +-max(0, -c/a), which holds for either sign of c."""
    offset, moving = apart(inner, as_Add=True)
    slope, distance = apart(moving, as_Add=False)
    if not isinstance(distance, sympy.Abs) or _switches(distance.args[0]):
        return None
    factor, function = apart(distance.args[0], as_Add=False)
    reach = sympy.expand_mul(-offset / (slope * sympy.Abs(factor)))
    if reach.is_nonpositive:
        outside = constant(1)
    else:
        reach = reach if reach.is_nonnegative else sympy.Max(0, reach)
        above, below = step_of_smooth(function - reach), step_of_smooth(-function - reach)
        outside = add(above, below)
    sign = multiply(sign_of_parameter(slope), add(scale(outside, 2), constant(-1)))
    return scale(add(constant(1), sign), sympy.Rational(1, 2))


def _step_by_cases(form: Form) -> Form:
    """Give H(sum of terms behind steps): with one step on and off in turn, until none is left."""
    if len({single for key in form for single in _singles(key)}) > MOST_NESTED:
        raise ExpressionError(
            f"law: a condition with more than {MOST_NESTED} switches of its own; write it with fewer abs, "
            "sign, Min, Max inside each other"
        )
    for key in form:
        for single in _singles(key):
            on = add(*({_without(k, single): t} for k, t in form.items()))
            off = {k: t for k, t in form.items() if single not in _singles(k)}
            indicator: Form = {single: sympy.S.One}
            return add(
                multiply(indicator, _step_by_cases(on)),
                multiply(complement(indicator), _step_by_cases(off)),
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
    """Give Max(a, b) = b + (a - b) H(a - b), Min likewise with the step the other way."""
    still = [argument for argument in extreme.args if not moves(argument)]
    arguments = [argument for argument in extreme.args if moves(argument)]
    if still:
        arguments.append(extreme.func(*still))
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
    remaining, total = constant(1), dict[Key, sympy.Expr]()
    for branch, condition in law.args:
        here = multiply(remaining, _condition(condition))
        total = add(total, multiply(here, _form(branch)))
        remaining = add(remaining, scale(here, -1))
    if remaining:
        raise ExpressionError(
            f"law: {law}: not defined everywhere; the last branch of a Piecewise needs the condition True"
        )
    return total


def _condition(condition: sympy.Basic) -> Form:
    if isinstance(condition, BooleanTrue | sympy.Ne):
        return constant(1)
    if isinstance(condition, BooleanFalse | sympy.Eq):
        return {}
    if isinstance(condition, sympy.Not):
        return complement(_condition(condition.args[0]))
    if isinstance(condition, sympy.And | sympy.Or):
        negate = isinstance(condition, sympy.Or)
        product = constant(1)
        for part in condition.args:
            form = _condition(part)
            product = multiply(product, complement(form) if negate else form)
        return complement(product) if negate else product
    if isinstance(condition, sympy.Rel):
        return _step(condition.gts - condition.lts)
    raise ExpressionError(f"law: {condition}: no condition; use <, <=, >, >= with & and |")


def _function(function: sympy.Expr) -> Form:
    """Take apart f(g) where that is exact and harmless: parity, or one term behind steps; else keep it."""
    if len(function.args) == 1:
        (argument,) = function.args
        coefficient, rest = apart(argument, as_Add=False)
        if isinstance(rest, sympy.Abs) and isinstance(function, _EVEN):
            return _form(function.func(coefficient * rest.args[0]))
        if isinstance(rest, sympy.Abs) and isinstance(function, _ODD):
            odd = function.func(coefficient * rest.args[0])
            return multiply(_form(odd), _sign(rest.args[0]))
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
        return _written(_form(expression)) if not _plain(expression) else expression
    return expression.func(*(_within(a) if isinstance(a, sympy.Expr) else a for a in expression.args))


def _plain(expression: sympy.Expr) -> bool:
    """Decide whether this is the distance from one switch, Abs(x - b) or Abs(v - w)."""
    if not isinstance(expression, sympy.Abs):
        return False
    inner = expression.args[0]
    return any(inner.diff(s) in (1, -1) and len(inner.free_symbols & {STATE_X, STATE_V}) == 1
               for s in (STATE_X, STATE_V))  # fmt: skip


def _function_of(single: Key) -> sympy.Expr:
    if single.x is not None:
        return STATE_X - single.x
    if single.v is not None:
        return STATE_V - single.v
    (function,) = single.others
    return function


def _written(form: Form) -> sympy.Expr:
    """Write a form as one expression; a continuous change of slope at one switch becomes Abs."""
    rest = without_signs(form).get(ALWAYS, sympy.S.Zero)
    total = sympy.S.Zero
    for key, term in without_signs(form).items():
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
