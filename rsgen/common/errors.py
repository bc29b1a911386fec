"""What rsgen says when it cannot go on: where, what is wrong, what is allowed."""

from __future__ import annotations

from collections.abc import Iterable
from numbers import Real

__all__ = [
    "CaseError",
    "ExpressionError",
    "MeasurementError",
    "RsgenError",
    "UnknownNameError",
    "printable",
    "quote",
    "require",
    "require_number",
]


class RsgenError(Exception):
    """A fault of the input, in a sentence that names place, fault and what is allowed."""


class UnknownNameError(RsgenError, KeyError):
    """Nothing has the name that was asked for; also a ``KeyError``."""

    def __str__(self) -> str:
        """Give the message as it is; a KeyError would quote it."""
        return str(self.args[0])


class ExpressionError(RsgenError):
    """A formula is not in the expression language, or a force law cannot be used as asked."""


class MeasurementError(RsgenError):
    """A measured file cannot be read as the case describes it."""


class CaseError(RsgenError):
    """A case file is faulty; all its faults are reported at once.

    Attributes
    ----------
    faults
        One line a fault, each ``file: path.to.key: what is wrong; what is allowed``.
    """

    def __init__(self, faults: Iterable[str]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(self.faults))


def quote(text: object, limit: int = 60) -> str:
    """Show a text from a file in a message: in quotes, shortened, control characters escaped.

    Examples
    --------
    >>> quote("k1")
    "'k1'"
    >>> quote("a" * 100, limit=5)
    "'aaaaa'..."
    """
    shown = str(text)
    escaped = shown[:limit].encode("utf-8", "backslashreplace").decode("utf-8")
    return repr(escaped) + ("..." if len(shown) > limit else "")


def printable(text: str, limit: int = 1000) -> str:
    """Show what another program says in a message: shortened, control characters escaped."""
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)[:limit]


def require(value: object, kinds: type | tuple[type, ...], place: str) -> None:
    """Refuse an argument that is of none of these kinds.

    Raises
    ------
    RsgenError
        With the place, the kind that was given, and the kinds that are allowed.
    """
    if not isinstance(value, kinds):
        allowed = kinds if isinstance(kinds, tuple) else (kinds,)
        names = " or ".join(kind.__name__ for kind in allowed)
        raise RsgenError(f"{place}: {type(value).__name__}; must be {names}")


def require_number(value: object, place: str, unit: str = "") -> float:
    """Give a number of any numeric type as a float.

    Raises
    ------
    RsgenError
        It is a text, a truth value or no number at all.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise RsgenError(f"{place}: {value!r:.60}; must be a number{f' [{unit}]' if unit else ''}")
    return float(value)
