"""Exceptions of rsgen: place, fault, allowed values."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_type_hints

F = TypeVar("F", bound=Callable[..., Any])


class RsgenError(Exception):
    """A fault of the input, in a sentence that names place, fault and what is allowed."""


class UnknownNameError(RsgenError, KeyError):
    """Nothing has the name that was asked for; also a ``KeyError``."""

    def __str__(self) -> str:
        """Return the message as it is; a KeyError would quote it."""
        return str(self.args[0])


class UnknownArgumentError(RsgenError, TypeError):
    """A function has no argument of the name that was given; also a ``TypeError``."""


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


def shown(text: object, longest: int = 40) -> str:
    """Show a text of a formula or a unit in a message: in quotes, ASCII, cut to ``longest`` characters."""
    plain = text if isinstance(text, str) else repr(text)
    return ascii(plain if len(plain) <= longest else plain[: longest - 3] + "...")


def shown_path(path: str | os.PathLike[str]) -> str:
    """Show a path in a message as it was typed: relative if it was, in quotes where it holds odd signs."""
    text = os.fspath(path)
    return text if text.isprintable() else quote(text, 200)


def suggest(word: str, known: Collection[str]) -> str:
    """Return a did-you-mean in words, with a trailing blank, or nothing when no known word is close.

    Examples
    --------
    >>> suggest("frequncy", ["frequency", "level"])
    "did you mean 'frequency'? "
    """
    close = get_close_matches(word[:80], list(known)[:1000], n=1, cutoff=0.6)
    return f"did you mean {quote(close[0])}? " if close else ""


def near_file(path: Path, endings: str = "") -> str:
    """Return a did-you-mean for a file that is not there, by what its folder has, or nothing."""
    with contextlib.suppress(OSError):
        names = [file.name for file in path.parent.iterdir() if file.suffix == endings or not endings]
        full = path.name + endings
        near = [full] if endings and full in names else get_close_matches(path.name, names, 1, cutoff=0.8)
        return f"; did you mean {quote(path.with_name(near[0]), 200)}?" if near else ""
    return ""


LISTED = 6
"""Names in a list; the others are counted."""


def listed(names: Sequence[str]) -> str:
    """List the first names in a sentence, and count the others.

    Examples
    --------
    >>> listed([*"abcdefgh"])
    'a, b, c, d, e, f and 2 more'
    """
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")


def one_line(fault: object) -> str:
    """Return what an exception says, on one line."""
    return " ".join(str(fault).split())


def printable(text: str, limit: int | None = 1000) -> str:
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


def known_arguments(function: F) -> F:
    """Refuse a keyword that a function does not have, and name the argument that takes it."""
    known = [name for name in signature(function).parameters if name != "self"]

    @wraps(function)
    def called(*values: Any, **keywords: Any) -> Any:
        for name in keywords:
            if name not in known:
                near = suggest(name, known) or _place_of(function, name)
                if name == "fixed" and "mass" in known:
                    near = "the mass alone can be given, as mass=; "
                raise UnknownArgumentError(
                    f"{function.__qualname__.removesuffix('.__init__')}: {name[:80]}: no argument; "
                    f"{near}its arguments are {listed(known)}"
                )
        return function(*values, **keywords)

    return cast("F", called)


def _place_of(function: Callable[..., Any], name: str) -> str:
    """Say which argument of a function is an object with a field of this name, or nothing."""
    with contextlib.suppress(NameError, TypeError):
        for argument, hint in get_type_hints(function).items():
            for kind in (get_args(hint) or (hint,)) if argument != "return" else ():
                if is_dataclass(kind) and name in {entry.name for entry in fields(kind)}:
                    return f"write {argument}=rsgen.{getattr(kind, '__name__', kind)}({name}=...); "
    return ""


def require_number(value: object, place: str, unit: str = "") -> float:
    """Return a number of any numeric type as a float.

    Raises
    ------
    RsgenError
        It is a text, a truth value or no number at all.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise RsgenError(f"{place}: {value!r:.60}; must be a number{f' [{unit}]' if unit else ''}")
    return float(value)


# ----------------------------------------------------------------------------
# What a user sees only on request: warnings of libraries, and where a fault of the program came from.

DEBUG_VARIABLE = "RSGEN_DEBUG"
"""Environment variable: set to anything, it shows warnings of libraries and tracebacks on standard error."""


def keep_from_terminal() -> None:
    """Send warnings and messages of libraries to the log, for this process.

    What matters to a reader of a result is a finding; the text of a library names neither case nor remedy.
    """
    logging.captureWarnings(True)
    root = logging.getLogger()
    if not root.handlers:
        # without any handler, Python prints messages of libraries itself
        root.addHandler(logging.NullHandler())
    if os.environ.get(DEBUG_VARIABLE):
        shown = logging.StreamHandler()
        for name in ("rsgen", "py.warnings"):
            logger = logging.getLogger(name)
            logger.handlers = [shown]
            logger.setLevel(logging.DEBUG)


def faults_of(fault: Exception, about: str, place: str = "") -> tuple[str, ...]:
    """Return why a case failed, in sentences that begin with its file and key, while the error is handled."""
    if isinstance(fault, CaseError):
        return fault.faults
    if isinstance(fault, RsgenError):
        text = one_line(fault)
        return (text if text.startswith(about) else f"{about}: {place}{text}",)
    return (program_fault(fault, about),)


def program_fault(fault: BaseException, about: str) -> str:
    """Return an unexpected error as a sentence, and write its traceback to the log.

    What the system refused, a file or memory, is no fault of the program.

    Parameters
    ----------
    fault
        While it is handled.
    about
        The case, or the program: what the sentence begins with.
    """
    logging.getLogger("rsgen").debug("%s failed", about, exc_info=True)
    if isinstance(fault, MemoryError):
        return f"{about}: there is too little memory for it; give the program more, or ask for fewer points"
    if isinstance(fault, OSError):
        what = one_line(f"{fault.strerror or fault}{f': {name}' if (name := fault.filename) else ''}")
        return f"{about}: the system refuses what this needs: {what[:300]}"
    text = one_line(f"{type(fault).__name__}: {fault}")
    if isinstance(fault, ImportError) and not isinstance(fault, ModuleNotFoundError):
        return f"{about}: a library cannot be loaded, perhaps for want of memory or open files: {text[:300]}"
    return (
        f"{about}: {text[:300]}; this is a fault of rsgen, please report it with the files "
        f"({DEBUG_VARIABLE}=1 shows where it came from)"
    )
