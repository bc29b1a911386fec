"""The first look at a formula, character by character: everything that is cheap to refuse is refused here.

Python's parser sees a text only after its length, its characters, its words and the depth of its
parentheses are known to be harmless.
"""

from __future__ import annotations

import keyword
import re
import unicodedata

from rsgen.common.errors import ExpressionError
from rsgen.formula.names import shown

__all__ = ["DEPTH", "DIGITS", "LENGTH", "refusal", "scan"]

LENGTH = 2000
DEPTH = 40
DIGITS = 30
_EXPONENT_DIGITS = 3

_ALLOWED = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_ .+-*/(),<>=&|!")
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)(?P<tail>[A-Za-z0-9_.]*)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<other>\*\*|//|<<|>>|[<>=!]=|[^ ])"
)
_NO_OPERATOR = {
    "//": "write / for a quotient",
    "<<": "conditions compare with < <= > >=",
    ">>": "conditions compare with < <= > >=",
    "==": "conditions compare with < <= > >=",
    "!=": "conditions compare with < <= > >=",
    "=": "a formula is only what stands on the right of the equals sign",
    "!": "write gamma(n + 1) for a factorial",
    ".": "nothing can be looked up in a formula",
}
_SIGNS = ("+", "-")
_INSTEAD = {
    "^": "write ** for a power",
    "[": "write ( )",
    "]": "write ( )",
    "{": "write ( )",
    "}": "write ( )",
    "'": "a formula contains no text",
    '"': "a formula contains no text",
    ":": "conditions stand in Piecewise((value, condition), ..., (value, True))",
    ";": "a formula is one expression",
    "\n": "a formula is one line",
    "\t": "write blanks",
    "\u2212": "write -",
    "\u00b7": "write *",
    "\u00d7": "write *",
    "\u00f7": "write /",
    "\u03c0": "write pi",
    "\u221a": "write sqrt(...)",
    "\u221e": "a law must be finite",
    "\u00b2": "write **2",
    "\u00b3": "write **3",
}
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
        if character not in _ALLOWED:
            instead = _INSTEAD.get(character, _ASCII_ONLY)
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
    if len(digits) > DIGITS:
        raise refusal(column, f"a number with {len(digits)} digits; at most {DIGITS} are allowed")
    if len(exponent.lstrip("+-0")) > _EXPONENT_DIGITS:
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
    if len(text) > LENGTH:
        raise ExpressionError(f"a formula of {len(text)} characters; at most {LENGTH} are allowed")
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
        elif other in _NO_OPERATOR:
            raise refusal(column, f"'{other}' has no meaning in formulas; {_NO_OPERATOR[other]}")
        operand = number is not None or (name is not None and name not in ("and", "or"))
        ended = before in ("name", "value")
        if ended and (operand or (other == "(" and before == "value")):
            raise refusal(column, "an operator is missing before this; write * for a product")
        if not ended and not operand and other not in ("(", *_SIGNS) and (before, other) != ("(", ")"):
            raise refusal(column, f"a number or name is missing before '{match[0]}'")
        if other == "(":
            depth += 1
            if depth > DEPTH:
                raise refusal(column, f"parentheses more than {DEPTH} deep; at most {DEPTH} are allowed")
        elif other == ")":
            depth -= 1
            if depth < 0:
                raise refusal(column, "a ')' without its '('")
        before = "value" if number is not None or other == ")" else "name" if operand else match[0]
    if before not in ("name", "value"):
        raise refusal(len(text), f"the formula ends in '{before}'; a number or name is missing after it")
    if depth:
        raise refusal(len(text), f"{depth} parenthes{'i' if depth == 1 else 'e'}s not closed; add ')'")
    return text
