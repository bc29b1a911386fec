"""Names of the language, the symbols that stand for them, and the terms of a law that remember.

A law with memory stays one expression. ``State`` is a state z of the law that carries the equations z' = g of
all states it depends on; ``Masing`` holds the virgin curve of a law whose branches follow Masing's rule;
``Structural`` the stiffness of rate-independent linear damping.
"""

from __future__ import annotations

import difflib
import keyword
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any

import sympy

from rsgen.common.errors import ExpressionError, shown

FUNCTIONS = (
    "abs", "Abs", "sign", "Piecewise", "Min", "Max", "Heaviside", "sqrt", "exp", "log", "ln", "sin", "cos",
    "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "besselj", "besseli", "gamma",
    "masing", "structural",
)  # fmt: skip
"""Everything that may be called, in the order in which messages list it."""

CONSTANTS = ("pi",)

STATES = {
    "x": "the displacement", "v": "the velocity", "X": "the amplitude", "X0": "the mean displacement",
    "omega": "the angular frequency", "t": "the time", "F": "the force level",
}  # fmt: skip
"""Names with a fixed meaning: formulas may contain them, no parameter may be called so."""

# gamma is a customary parameter name; it is the function only where it is called
_RESERVED = frozenset(FUNCTIONS) - {"gamma"} | frozenset(CONSTANTS) | {"inf", "nan"}
_POSITIVE = frozenset({"X", "omega"})
_LEGAL = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_MAX_CHARACTERS = 40
_FORM = f"a name is a letter followed by letters, digits and _, at most {_MAX_CHARACTERS} characters"


def closest(name: str, known: Iterable[str]) -> str | None:
    """The known name that is most probably meant by ``name``, or None."""
    names = list(known)
    folded = {other.casefold(): other for other in reversed(names)}
    if name.casefold() in folded:
        return folded[name.casefold()]
    found = difflib.get_close_matches(name, names, n=1, cutoff=0.7)
    return found[0] if found else None


def _check_form(name: object) -> str:
    if not isinstance(name, str):
        raise ExpressionError(f"{shown(name)} is not a name but a {type(name).__name__}; {_FORM}")
    if len(name) > _MAX_CHARACTERS:
        raise ExpressionError(f"the name {shown(name)} has {len(name)} characters; {_FORM}")
    if not _LEGAL.fullmatch(name):
        raise ExpressionError(f"{shown(name)} cannot be a name; {_FORM}")
    if keyword.iskeyword(name):
        raise ExpressionError(
            f"'{name}' cannot be a name, it is a word of the Python language; write '{name}_', for example"
        )
    if name in _RESERVED:
        what = "a constant" if name in CONSTANTS else "no number" if name in ("inf", "nan") else "a function"
        raise ExpressionError(
            f"'{name}' cannot be a name, it is {what} in formulas; write '{name}_', for example"
        )
    return name


def check_name(name: str) -> str:
    """Check that a parameter may be called so.

    Parameters
    ----------
    name
        The name as the user wrote it.

    Returns
    -------
    str
        The same name.

    Raises
    ------
    ExpressionError
        It is no ASCII identifier, too long, a word of Python or of the expression language, or has a fixed
        meaning in formulas (x, v, X, X0, omega, t, F).

    Examples
    --------
    >>> check_name("kn1")
    'kn1'
    >>> check_name("lambda")
    Traceback (most recent call last):
    ...
    rsgen.common.errors.ExpressionError: 'lambda' cannot be a name, it is a word of the Python language; ...
    """
    legal = _check_form(name)
    if legal in STATES:
        raise ExpressionError(
            f"'{legal}' cannot be a parameter, it is {STATES[legal]}; write '{legal}_1', for example"
        )
    return legal


def symbol(name: str) -> sympy.Symbol:
    """The symbol of a state or parameter; the same name always gives the same symbol.

    Parameters
    ----------
    name
        A state (x, v, X, X0, omega, t, F) or a parameter.

    Returns
    -------
    sympy.Symbol
        X and omega are positive, every other symbol is real.

    Raises
    ------
    ExpressionError
        The name is not legal in formulas.

    Examples
    --------
    >>> symbol("omega").is_positive, symbol("k1").is_real
    (True, True)
    """
    legal = _check_form(name)
    return sympy.Symbol(legal, positive=True) if legal in _POSITIVE else sympy.Symbol(legal, real=True)


STATE_X, STATE_V = symbol("x"), symbol("v")
"""Displacement [m] and velocity [m/s] in a law."""

X, X0, OMEGA, PHI = symbol("X"), symbol("X0"), symbol("omega"), symbol("phi")
"""Amplitude and mean [m], angular frequency [rad/s] and phase [rad] of a motion in formulas."""


# ----------------------------------------------------------------------------
# Expressions with other symbols; what is the same whatever its symbols are called is not evaluated anew.

_EXTREMES = (sympy.Max, sympy.Min)
"""To find the largest of several arguments anew takes seconds."""


@lru_cache(maxsize=4096)
def free_symbols(expression: sympy.Basic) -> frozenset[sympy.Basic]:
    """Symbols of an expression but for those over which it integrates.

    The library builds an integral anew to find its symbols, which takes a second where it holds extremes.
    """
    if isinstance(expression, sympy.Integral):
        found = free_symbols(expression.function)
        for variable, *ends in expression.limits:
            found = (found - {variable}).union(*map(free_symbols, ends))
        return found
    if isinstance(expression, sympy.Add | sympy.Mul | sympy.Pow):
        return frozenset().union(*map(free_symbols, expression.args))
    return frozenset(expression.free_symbols)


def rebuilt(
    expression: sympy.Basic, arguments: tuple[sympy.Basic, ...], as_written: tuple[type, ...] = _EXTREMES
) -> sympy.Basic:
    """Build an expression anew from its arguments; those of the classes ``as_written`` are not evaluated."""
    plain = {"evaluate": False} if isinstance(expression, as_written) else {}
    return expression.func(*arguments, **plain)


def renamed(
    expression: sympy.Expr,
    names: Mapping[sympy.Symbol, sympy.Symbol],
    as_written: tuple[type, ...] = _EXTREMES,
) -> sympy.Expr:
    """Return symbols new names, which may be the old ones; what holds one of them is built anew.

    Parameters
    ----------
    expression
        Whose symbols are renamed.
    names
        The new symbols by the old ones; others stay.
    as_written
        Classes that are not evaluated anew.
    """
    done: dict[sympy.Basic, sympy.Basic] = {}
    replaced = set(names)

    def new(part: sympy.Basic) -> sympy.Basic:
        if not part.args:
            return names.get(part, part)
        if part not in done:
            touched = not replaced.isdisjoint(free_symbols(part))
            done[part] = rebuilt(part, tuple(map(new, part.args)), as_written) if touched else part
        return done[part]

    return new(expression)


class Masing(sympy.Function):  # type: ignore[misc]  # sympy has no types
    """masing(n(x)) [N]: n is the virgin curve for x >= 0.

    After a reversal at displacement x_r and force n_r the force is n_r -+ 2 n(|x - x_r|/2) (Masing, Proc. 2nd
    Int. Congress of Applied Mechanics, Zurich (1926) 332). ``args[0]`` is n(x), odd where it is continued.
    """

    nargs = 1
    is_real = True

    def _sympystr(self, printer: Any) -> str:
        return f"masing({printer.doprint(self.args[0])})"


class Structural(sympy.Function):  # type: ignore[misc]  # sympy has no types
    """structural(h) [N]: h times the displacement a quarter of a period later, for every harmonic; h in N/m.

    Rate-independent linear damping: it exists under periodic motion only (Crandall, J. Sound Vib. 11 (1970)
    3).
    """

    nargs = 1
    is_real = True

    def _sympystr(self, printer: Any) -> str:
        return f"structural({printer.doprint(self.args[0])})"


class Inner(sympy.Symbol):  # type: ignore[misc]  # sympy has no types
    """The value of a memory inside a law whose terms are separated: it moves with time, as x and v do."""

    __slots__ = ()


class State(sympy.Expr):  # type: ignore[misc]  # sympy has no types
    """The value of a state z of a law, with the equations z' = g(x, v, z) of all states it depends on.

    ``args`` are the symbol and a ``Tuple`` of pairs (symbol, g), sorted by name. The symbols of the states
    are bound: they are no free symbols of the law.
    """

    is_real = True
    is_commutative = True

    def __new__(cls, name: sympy.Symbol, equations: sympy.Tuple) -> State:
        """Take a symbol and its equations; nothing is simplified."""
        made: State = sympy.Expr.__new__(cls, name, equations)
        return made

    @property
    def name(self) -> str:
        """Name of the state, as in the formula."""
        return str(self.args[0])

    @property
    def equations(self) -> dict[sympy.Symbol, sympy.Expr]:
        """g(x, v, z) of every state, by symbol."""
        return {pair[0]: pair[1] for pair in self.args[1]}

    @property
    def free_symbols(self) -> set[sympy.Basic]:
        """x, v and the parameters of the equations."""
        rates = self.equations
        inside: set[sympy.Basic] = set().union(*(rate.free_symbols for rate in rates.values()))
        return inside - set(rates)

    def _eval_derivative(self, by: sympy.Symbol) -> sympy.Expr:
        """How a loop changes is no formula; it stays a derivative."""
        return sympy.Derivative(self, by, evaluate=False) if by in self.free_symbols else sympy.S.Zero

    def _sympystr(self, printer: Any) -> str:
        return self.name


def remembers(expression: sympy.Basic) -> bool:
    """Decide whether anything in an expression has a memory."""
    return bool(expression.atoms(State, Masing, Structural))
