"""The algebra of forms: sums of terms, each behind the unit steps of at most three kinds.

A form is a mapping from a key to a term. The key names the steps that the term is multiplied with: one in x
(a threshold b: H(x - b)), one in v (a threshold w: H(v - w)) and any number of others. Since
H(x - a) H(x - b) = H(x - max(a, b)) and H(-s) = 1 - H(s), sums and products of forms are forms again.
"""

from __future__ import annotations

from functools import lru_cache, reduce
from math import comb, prod
from typing import NamedTuple

import sympy

from rsgen.common.errors import ExpressionError
from rsgen.formula.names import STATE_V, STATE_X, Inner

STATES = frozenset((STATE_X, STATE_V))

# budgets of the algebra: each keeps a text of a few operations from taking minutes
MAX_PIECES = 96
"""Largest number of pieces of a law; one with more is refused."""

MAX_ADDENDS = 400
"""Largest number of addends of an expanded sum, and of a numerator or denominator of a common fraction."""

MAX_ATOMS = 10_000
"""Largest number of numbers, names and functions in an expanded sum."""

MAX_OPERATIONS = 2500
"""Largest number of operations in all pieces and switch functions. Ten elements of the library have at most
600, the loop of ramberg-osgood 2483."""

COUNT_LIMIT = 10**9
"""Counts of addends end here."""


class Key(NamedTuple):
    """The steps of a term: threshold in x or None, threshold in v or None, functions of other steps.

    ``signs`` are steps H(p) of parameters only. They exist during the reduction of a law, so that cases that
    exclude each other (k > 0 and k < 0) are never multiplied, and become factors (1 + sign(p))/2 at its end.
    """

    x: sympy.Expr | None = None
    v: sympy.Expr | None = None
    others: frozenset[sympy.Expr] = frozenset()
    signs: frozenset[sympy.Expr] = frozenset()


ALWAYS = Key()
Form = dict[Key, sympy.Expr]
"""A sum of terms by where they act: the coefficient of each ``Key``; an empty one is zero."""


def moves(expression: sympy.Basic) -> bool:
    """Decide whether an expression depends on x, v or the state of a memory."""
    return any(free in STATES or isinstance(free, Inner) for free in expression.free_symbols)


def split_moving(expression: sympy.Expr, *, as_Add: bool) -> tuple[sympy.Expr, sympy.Expr]:
    """Split a sum or product into the part free of x, v and memories, and the rest."""
    moving = [free for free in expression.free_symbols if isinstance(free, Inner)]
    split: tuple[sympy.Expr, sympy.Expr] = expression.as_independent(STATE_X, STATE_V, *moving, as_Add=as_Add)
    return split


def constant(value: sympy.Expr | int) -> Form:
    """Return the form of a term that acts everywhere."""
    term = sympy.sympify(value)
    return {} if is_zero(term) else {ALWAYS: term}


def is_zero(term: sympy.Expr) -> bool:
    """Decide whether a term is zero as it is written; a proof for a function may take SymPy seconds."""
    return bool(term.is_zero) if term.is_number else term == 0


def step(x: sympy.Expr | None = None, v: sympy.Expr | None = None, other: sympy.Expr | None = None) -> Form:
    """Return the form of one unit step: H(x - threshold), H(v - threshold) or H(other)."""
    return {Key(x, v, frozenset() if other is None else frozenset((other,))): sympy.S.One}


def sign_of_parameter(value: sympy.Expr) -> Form:
    """Return sign(value) of an expression of parameters, by the signs of its factors."""
    form = constant(1)
    product = value if is_long(value) else sympy.factor_terms(sympy.together(value))
    for factor in sympy.Mul.make_args(product):
        base, exponent = factor.as_base_exp()
        factor = base if exponent.is_integer and exponent.is_number and exponent % 2 else factor
        sign = sympy.sign(factor)
        if sign.is_number:
            form = scale(form, sign)
            continue
        if factor.could_extract_minus_sign():
            factor, form = -factor, scale(form, -1)
        positive = Key(signs=frozenset((sympy.expand_mul(factor),)))
        form = multiply(form, {ALWAYS: sympy.Integer(-1), positive: sympy.Integer(2)})
    return form


def step_of_parameter(value: sympy.Expr) -> Form:
    """Return H(value) of an expression of parameters."""
    return scale(add(constant(1), sign_of_parameter(value)), sympy.Rational(1, 2))


def without_signs(form: Form) -> Form:
    """Write the steps of parameters as factors (1 + sign(p))/2."""
    return add(
        *(
            {
                key._replace(signs=frozenset()): expanded(
                    term * sympy.Mul(*((1 + sympy.sign(p)) / 2 for p in key.signs))
                )
            }
            for key, term in form.items()
        )
    )


@lru_cache(maxsize=4096)
def _growth(expression: sympy.Basic) -> tuple[int, int]:
    """Bound what multiplying out gives, without doing it: addends, and the parts of the largest of them.

    Denominators and arguments of functions are multiplied out as well, and stay one addend.
    """
    inner = [_growth(argument) for argument in expression.args]
    if not inner:
        return 1, 1
    if expression.is_Add:
        return min(sum(count for count, _ in inner), COUNT_LIMIT), max(parts for _, parts in inner)
    if expression.is_Mul:
        return min(prod(count for count, _ in inner), COUNT_LIMIT), min(
            sum(parts for _, parts in inner), COUNT_LIMIT
        )
    if expression.is_Pow and expression.exp.is_Integer:
        (count, parts), power = inner[0], min(abs(int(expression.exp)), 500)
        raised = min(comb(count + power - 1, power), COUNT_LIMIT)
        parts = min(parts * min(power, count), COUNT_LIMIT)
        if expression.exp > 0:
            return raised, parts
        return 1, COUNT_LIMIT if raised > MAX_ADDENDS else min(raised * parts, COUNT_LIMIT)
    return 1, min(1 + sum(count * parts for count, parts in inner), COUNT_LIMIT)


@lru_cache(maxsize=4096)
def _fraction_growth(expression: sympy.Expr) -> tuple[int, int]:
    """Bound the addends above and below the line when an expression becomes one fraction."""
    if expression.is_Add:
        parts = [(sympy.fraction(term)[1], *_fraction_growth(term)) for term in expression.args]
        below = min(prod({line: count for line, _, count in parts}.values()), COUNT_LIMIT)
        return min(sum(above * below // count for _, above, count in parts), COUNT_LIMIT), below
    if expression.is_Mul:
        lines = [_fraction_growth(factor) for factor in expression.args]
        return min(prod(above for above, _ in lines), COUNT_LIMIT), min(
            prod(below for _, below in lines), COUNT_LIMIT
        )
    if expression.is_Pow and expression.exp.is_Integer:
        power = min(abs(int(expression.exp)), 500)
        above, below = (
            min(comb(n + power - 1, power), COUNT_LIMIT) for n in _fraction_growth(expression.base)
        )
        return (above, below) if expression.exp > 0 else (below, above)
    return 1, 1


def is_long(expression: sympy.Expr) -> bool:
    """Decide whether an expression is too long to become one fraction or a polynomial: a budget in terms."""
    return max(_fraction_growth(expression)) > MAX_ADDENDS or _explodes(expression)


def _explodes(expression: sympy.Expr) -> bool:
    addends, parts = _growth(expression)
    return addends > MAX_ADDENDS or addends * parts > MAX_ATOMS


def _tidy(addend: sympy.Expr) -> sympy.Expr:
    """Write c sign(c) as abs(c) and drop sign(c)**2: coefficients of laws are not zero."""
    factors = list(sympy.Mul.make_args(addend))
    places = {factor.as_base_exp()[0]: place for place, factor in enumerate(factors)}
    for sign, place in places.items():
        if not isinstance(sign, sympy.sign) or moves(sign):
            continue
        power, inner = factors[place].as_base_exp()[1], sign.args[0]
        if not power.is_Integer or power < 1:
            continue
        factors[place] = sign if power % 2 else sympy.S.One
        for found, instead in ((inner, sympy.Abs(inner)), (sympy.Abs(inner), inner)):
            partner = places.get(found)
            if power % 2 and inner.is_Symbol and partner is not None and factors[partner] == found:
                factors[partner], factors[place] = instead, sympy.S.One
                break
    return sympy.Mul(*factors)


def expanded(term: sympy.Expr) -> sympy.Expr:
    """Multiply a term out, so that equal terms cancel; leave it where that would explode."""
    if _explodes(term):
        return term
    term = sympy.expand_mul(sympy.expand_multinomial(term))
    if term.has(sympy.sign):
        term = sympy.Add(*(_tidy(addend) for addend in sympy.Add.make_args(term)))
    return term


MAX_COMPARED_OPERATIONS = 10
"""Largest number of operations in a difference of thresholds whose sign is asked for: SymPy takes 0.1 s."""


@lru_cache(maxsize=4096)
def _larger(a: sympy.Expr | None, b: sympy.Expr | None) -> sympy.Expr | None:
    if a is None or a == b:
        return b
    if b is None:
        return a
    difference = sympy.expand_mul(a - b)
    if not difference.is_number and sympy.count_ops(difference) > MAX_COMPARED_OPERATIONS:
        return sympy.Max(*{*_candidates(a), *_candidates(b)}, evaluate=False)
    if difference.is_nonnegative:
        return a
    if difference.is_nonpositive:
        return b
    return sympy.Max(a, b)


def _candidates(level: sympy.Expr) -> tuple[sympy.Expr, ...]:
    return level.args if isinstance(level, sympy.Max) else (level,)


def add(*forms: Form) -> Form:
    """Add forms; equal steps share one term, terms that cancel disappear."""
    parts: dict[Key, list[sympy.Expr]] = {}
    for form in forms:
        for key, term in form.items():
            parts.setdefault(key, []).append(term)
    total = {
        key: terms[0] if len(terms) == 1 else expanded(sympy.Add(*terms)) for key, terms in parts.items()
    }
    return {key: term for key, term in total.items() if not is_zero(term)}


def scale(form: Form, factor: sympy.Expr | int) -> Form:
    """Multiply every term with a factor."""
    return {key: expanded(term * factor) for key, term in form.items()} if factor != 0 else {}


def complement(form: Form) -> Form:
    """Return 1 - form; for a step this is the step the other way."""
    return add(constant(1), scale(form, -1))


def multiply(*forms: Form) -> Form:
    """Multiply forms, merging steps in the same variable.

    Raises
    ------
    ExpressionError
        The product has more pieces than any sensible law.
    """
    return reduce(_multiply_two, forms, constant(1))


def _multiply_two(left: Form, right: Form) -> Form:
    too_many = len(left) * len(right) > 8 * MAX_PIECES
    products = (
        {Key(_larger(a.x, b.x), _larger(a.v, b.v), a.others | b.others, a.signs | b.signs): expanded(f * g)}
        for a, f in left.items()
        for b, g in right.items()
    )
    product = {} if too_many else add(*products)
    if too_many or len(product) > MAX_PIECES:
        raise ExpressionError(
            f"law: more than {MAX_PIECES} pieces behind switches; write it with fewer abs, sign, Min, Max"
        )
    return product
