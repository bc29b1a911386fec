"""Limits of formulas: of a text before it is read, and after every step of all algebra with what was read."""

from __future__ import annotations

import keyword
import math
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType

import sympy

from rsgen.common.errors import ExpressionError, shown
from rsgen.formula.names import Masing, Structural

# ----------------------------------------------------------------------------
# Faults of the algebra library on hostile texts become a refusal of the law, with its kind.

_LIBRARIES = ("sympy", "mpmath")


@contextmanager
def algebra_faults() -> Iterator[None]:
    """Turn a fault that the algebra library raises into a refusal of the law.

    It raises some on numbers that it cannot compare, such as the root of a number of 600 digits less another
    one, and calls itself without end on some nested cases.

    Raises
    ------
    ExpressionError
        The library raised; what rsgen raises itself passes as it is.
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as fault:
        # those of its polynomials and limits are of no class of Python's own
        if not isinstance(fault, RecursionError) and not _of_library(fault.__traceback__):
            raise
        raise ExpressionError(
            f"law: the algebra library cannot work it out ({type(fault).__name__}); write it with fewer "
            "cases or functions in each other, or with less extreme numbers"
        ) from fault


def _of_library(trace: TracebackType | None) -> bool:
    """Decide whether a fault began in the algebra library."""
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and str(trace.tb_frame.f_globals.get("__name__")).startswith(_LIBRARIES)


MAX_EXPONENT = 64
MAX_CHOICES = 8
"""Arguments of Min or Max."""
MAX_TERMS = 2000
"""Terms of an expanded formula."""
_MAX_POWER_TERMS = 500
"""Of one power; it is multiplied out again and again while a law is derived."""
_MAX_NUMBER = 1e300
MAX_BITS = int(_MAX_NUMBER).bit_length()
"""Of numerator and denominator in a text."""
MAX_DERIVED_BITS = 4 * MAX_BITS
"""Of numbers that algebra makes of them."""
_MAX_RADICAND_BITS = 110
"""SymPy factorises what stands under a root; 30 digits are quick."""
_MAX_IN_EXPONENT = 1000
"""Number in an exponent with names: SymPy works 3**(x - n) out digit by digit if it takes x for a number."""

_ALLOWED = (
    sympy.Symbol, sympy.Rational, sympy.core.numbers.Pi, sympy.core.numbers.Exp1, sympy.Add, sympy.Mul,
    sympy.Pow, sympy.Abs, sympy.sign, sympy.Min, sympy.Max, sympy.Heaviside, sympy.exp, sympy.log, sympy.sin,
    sympy.cos, sympy.tan, sympy.asin, sympy.acos, sympy.atan, sympy.atan2, sympy.sinh, sympy.cosh, sympy.tanh,
    sympy.besselj, sympy.besseli, sympy.gamma, sympy.Piecewise, Masing, Structural,
    sympy.functions.elementary.piecewise.ExprCondPair,
    sympy.StrictLessThan, sympy.LessThan, sympy.StrictGreaterThan, sympy.GreaterThan, sympy.And, sympy.Or,
    sympy.logic.boolalg.BooleanTrue,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Value:
    """A part of a formula as it has been read.

    ``number`` is the value of a constant as a float (inf where it exceeds the range of floats), None where
    states or parameters occur. ``terms`` bounds the number of terms after expansion and after splitting
    at every switch: products multiply it, so that nothing accepted can explode later.
    """

    expr: sympy.Expr
    number: float | None
    terms: int


def decimal_value(text: str) -> sympy.Rational:
    """The exact value of a decimal number."""
    mantissa, _, exponent = text.lower().partition("e")
    whole, _, fraction = mantissa.partition(".")
    power = int(exponent or 0) - len(fraction)
    digits = int(whole + fraction)
    return sympy.Rational(digits * 10 ** max(power, 0), 10 ** max(-power, 0))


def as_float(number: sympy.Rational) -> float:
    """The nearest float, inf beyond their range."""
    try:
        return int(number.p) / int(number.q)
    except OverflowError:
        return math.inf


def power_terms(base: Value, exponent: Value) -> int:
    """How many terms the expanded power has at most."""
    if exponent.number is None:
        return base.terms * exponent.terms
    whole = math.ceil(abs(exponent.number))
    return math.comb(base.terms + whole - 1, whole) if whole and base.terms > 1 else 1


def check_power(base: Value, exponent: Value) -> str | None:
    """Return the fault of a power before it is worked out, or None."""
    if base.expr == 0 and not (exponent.number is not None and exponent.number > 0):
        return "is a power of zero that is not defined"
    if exponent.number is None:
        if base.number is not None and base.number < 0:
            return "is a negative number to a power that is not always whole; it is not real"
        return _varying_fault(exponent.expr)
    if base.expr.is_Rational and exponent.number is not None:
        bits = max(int(base.expr.p).bit_length(), int(base.expr.q).bit_length())
        whole = exponent.expr.is_Integer
        if bits * abs(exponent.number) > MAX_BITS or (not whole and bits > _MAX_RADICAND_BITS):
            return f"is a number with too many digits; keep it below {_MAX_NUMBER:g}"
    terms = power_terms(base, exponent)
    if terms > max(_MAX_POWER_TERMS, base.terms):
        return f"would have up to {terms} terms when expanded; a power may have {_MAX_POWER_TERMS}"
    return None


def _varying_fault(exponent: sympy.Expr) -> str | None:
    if any(abs(as_float(number)) > _MAX_IN_EXPONENT for number in exponent.atoms(sympy.Rational)):
        return (
            f"has a number above {_MAX_IN_EXPONENT} in an exponent with names; write exp(...) if it is meant"
        )
    return None


def _top(expr: sympy.Basic, levels: int) -> Iterator[sympy.Basic]:
    yield expr
    if levels:
        for arg in expr.args:
            yield from _top(arg, levels - 1)


def _fault_of(part: sympy.Basic) -> str | None:
    if part.is_Rational:
        bits = max(int(part.p).bit_length(), int(part.q).bit_length())
        if bits > MAX_BITS or (part.p and not 1 / _MAX_NUMBER <= abs(as_float(part)) <= _MAX_NUMBER):
            return f"has a number out of range; numbers lie between {1 / _MAX_NUMBER:g} and {_MAX_NUMBER:g}"
    elif isinstance(part, sympy.Min | sympy.Max) and len(part.args) > MAX_CHOICES:
        return f"has {len(part.args)} arguments in Min or Max; at most {MAX_CHOICES} are allowed"
    elif part.is_Number or part is sympy.zoo:
        return "is not finite"
    elif part is sympy.I or (part.is_Pow and part.base.is_Rational and part.base.is_negative):
        return "is not real"
    elif part.is_Pow and part.exp.is_Rational and abs(part.exp) > MAX_EXPONENT:
        return f"has the power {part.exp}; powers up to {MAX_EXPONENT} are allowed"
    return None


def check_value(expr: sympy.Expr, terms: int) -> str | None:
    """Return the fault of a part just built; None where it is finite, real and small enough.

    Only the top levels are looked at: what lies deeper was checked when it was built.
    """
    if terms > MAX_TERMS:
        number = terms if terms < 10**9 else "over 10^9"
        return f"would have up to {number} terms when expanded; at most {MAX_TERMS} are allowed"
    for part in _top(expr, 3):
        fault = _fault_of(part)
        if fault:
            return fault
    return None


def check_finished(expr: sympy.Expr) -> str | None:
    """Return the fault of a whole formula; None where every part of it belongs to the language."""
    for part in sympy.preorder_traversal(expr):
        fault = _fault_of(part)
        if fault:
            return fault
        if part.is_Pow and part.base == 0:
            return f"has the power {part}, which is not defined for every value"
        fault = _varying_fault(part.exp) if part.is_Pow and part.exp.free_symbols else None
        if fault:
            return fault
        if not isinstance(part, _ALLOWED):
            return "is not real for every value of its names; take abs() of what stands under a root"
    return None


# ----------------------------------------------------------------------------
# The first look at a text, character by character: everything that is cheap to refuse is refused here.
#
# The parser of Python sees a text only after its length, its characters, its words and the depth of its
# parentheses are known to be harmless.


MAX_CHARACTERS = 2000
MAX_DEPTH = 40
"""Of parentheses and operations within each other."""
MAX_DIGITS = 30
"""Of a number."""
_MAX_EXPONENT_DIGITS = len(str(int(math.log10(_MAX_NUMBER))))

_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_ .+-*/(),<>=&|!")
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)(?P<tail>[A-Za-z0-9_.]*)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<other>\*\*|//|<<|>>|[<>=!]=|[^ ])"
)
_NO_OPERATOR = {
    "//": "write / for a quotient", "<<": "conditions compare with < <= > >=",
    ">>": "conditions compare with < <= > >=", "==": "conditions compare with < <= > >=",
    "!=": "conditions compare with < <= > >=",
    "=": "a formula is only what stands on the right of the equals sign",
    "!": "write gamma(n + 1) for a factorial", ".": "nothing can be looked up in a formula",
}  # fmt: skip
_SIGNS = ("+", "-")
_INSTEAD = {
    "^": "write ** for a power", "[": "write ( )", "]": "write ( )", "{": "write ( )", "}": "write ( )",
    "'": "write v for the velocity; a formula contains no text", '"': "a formula contains no text",
    ":": "conditions stand in Piecewise((value, condition), ..., (value, True))",
    ";": "a formula is one expression", "\n": "a formula is one line", "\t": "write blanks",
    "\u2212": "write -", "\u00b7": "write *", "\u00d7": "write *", "\u00f7": "write /",
    "\u03c0": "write pi", "\u221a": "write sqrt(...)", "\u221e": "a law must be finite",
    "\u00b2": "write **2", "\u00b3": "write **3", "\u1e8b": "write v",
}  # fmt: skip
_ASCII_ONLY = "allowed are ASCII letters, digits, blanks and _ . , + - * / ( ) < > = & |"


def refusal(column: int, fault: str) -> ExpressionError:
    """The error for a fault at a column of the formula, counted from 1."""
    return ExpressionError(f"column {column}: {fault}")


def _called(character: str) -> str:
    if character.isascii() and character.isprintable():
        return shown(character)
    name = unicodedata.name(character, "").lower()
    return f"U+{ord(character):04X}" + (f" ({name})" if name else "")


def _check_characters(text: str) -> None:
    for column, character in enumerate(text, 1):
        if character not in _CHARACTERS:
            letter = _called(character).rpartition("letter ")[2].rstrip(")")
            spelled = f"write {letter}" if "(greek" in _called(character) else _ASCII_ONLY
            instead = _INSTEAD.get(character, spelled)
            raise refusal(column, f"the character {_called(character)} has no meaning in formulas; {instead}")


def _check_number(number: str, tail: str, column: int) -> None:
    if tail:
        written = shown(number + tail)
        if tail.isidentifier() and not tail.startswith("_") and number not in ("0", "1"):
            raise refusal(
                column, f"{written} is neither number nor name; write {number}*{tail[:40]} if meant"
            )
        raise refusal(column, f"{written} is no number; allowed are decimals such as 12, 0.75 or 5.92e3")
    mantissa, _, exponent = number.lower().partition("e")
    if mantissa.isdigit() and mantissa.startswith("0") and len(mantissa) > 1:
        raise refusal(column, f"the number {shown(number)} begins with a superfluous 0")
    digits = mantissa.replace(".", "").lstrip("0")
    if len(digits) > MAX_DIGITS:
        raise refusal(column, f"a number with {len(digits)} digits; at most {MAX_DIGITS} are allowed")
    if len(exponent.lstrip("+-0")) > _MAX_EXPONENT_DIGITS:
        raise refusal(
            column, f"the number {shown(number)} is out of range; numbers lie between 1e-300 and 1e300"
        )


def _check_word(word: str, column: int) -> None:
    if word.startswith("_"):
        raise refusal(column, f"{shown(word)} begins with _; a name begins with a letter")
    if keyword.iskeyword(word) and word not in ("and", "or", "True"):
        instead = f"as a name write '{word}_'"
        if word in ("if", "else", "elif", "not"):
            instead = _INSTEAD[":"]
        raise refusal(column, f"'{word}' is a word of the Python language, without meaning here; {instead}")


def scan(text: object) -> str:
    """Check length, characters, numbers, words, missing operators and the depth of parentheses.

    Parameters
    ----------
    text
        What stands in the file where a formula is expected.

    Returns
    -------
    str
        The text itself.

    Raises
    ------
    ExpressionError
        It is no text, empty, too long, or has a character, number or word that no formula has.
    """
    if not isinstance(text, str):
        raise ExpressionError(f"a formula is text in quotes, not {type(text).__name__} {shown(text)}")
    if len(text) > MAX_CHARACTERS:
        raise ExpressionError(f"a formula of {len(text)} characters; at most {MAX_CHARACTERS} are allowed")
    if not text.strip(" "):
        raise ExpressionError("the formula is empty; write a law such as k1*x + kn1*x**3")
    _check_characters(text)
    depth = 0
    before = "("  # what stands to the left: "name", "value", or an operator
    for match in _TOKEN.finditer(text):
        column = match.start() + 1
        number, name, other = match["number"], match["name"], match["other"]
        if number is not None:
            _check_number(number, match["tail"], column)
        elif name is not None:
            _check_word(name, column)
        elif other == "," and not depth:
            raise refusal(column, "a comma stands between arguments only; write decimals with a point")
        elif other in _NO_OPERATOR:
            raise refusal(column, f"'{other}' has no meaning in formulas; {_NO_OPERATOR[other]}")
        operand = number is not None or (name is not None and name not in ("and", "or"))
        ended = before in ("name", "value")
        if ended and (operand or (other == "(" and before == "value")):
            left = text[: match.start()].split()[-1]
            raise refusal(
                column,
                f"an operator is missing before this; write {left[-20:]}*{match[0][:20]} for a product",
            )
        if not ended and not operand and other not in ("(", *_SIGNS) and (before, other) != ("(", ")"):
            size = "; write abs(v) for |v|" if other == "|" else ""
            raise refusal(column, f"a number or name is missing before '{match[0]}'{size}")
        depth += (other == "(") - (other == ")")
        if depth > MAX_DEPTH:
            raise refusal(column, f"parentheses more than {MAX_DEPTH} deep; at most {MAX_DEPTH} are allowed")
        if depth < 0:
            raise refusal(column, "a ')' without its '('")
        before = "value" if number is not None or other == ")" else "name" if operand else match[0]
    if before not in ("name", "value"):
        raise refusal(len(text), f"the formula ends in '{before}'; a number or name is missing after it")
    if depth:
        raise refusal(len(text), f"{depth} parenthes{'i' if depth == 1 else 'e'}s not closed; add ')'")
    return text
