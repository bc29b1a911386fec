"""The normal form of a law: smooth pieces behind switches.

A law is a sum of smooth terms, each behind the product of at most a few switches,
n(x, v) = sum_j d_j(x, v) * prod_i H(s_ji),  where H is the unit step. Describing functions integrate it piece
by piece, the kernel compiles it with the switches as events, and identification differentiates it; nothing
else takes a law apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import sympy

from rsgen.expression import symbol
from rsgen.law.normal_form import Key
from rsgen.law.rewriting import inner_switches, reduce_law

__all__ = ["NormalForm", "Piece", "Switch", "normal_form"]


@dataclass(frozen=True, slots=True)
class Switch:
    """A surface in the (x, v) plane on which a law changes its formula.

    ``function`` is s in H(s): ``x - b`` (``variable`` "x", ``threshold`` b), ``v - w`` (``variable`` "v",
    ``threshold`` w), or anything else that cannot be reduced to these (both None).
    Thresholds contain parameters and numbers only, never x or v; they may contain Max, Min, Abs and sign of
    parameters, since a law must hold for either sign of a parameter.
    """

    function: sympy.Expr
    variable: str | None
    threshold: sympy.Expr | None


@dataclass(frozen=True, slots=True)
class Piece:
    """A term d(x, v) and the switches it is multiplied with; it acts where all their functions are positive.

    A piece has at most one switch in x and one in v; without any it acts always. Between the switches of the
    normal form a term is smooth. It may contain every function of the expression language except Piecewise,
    Max and Min of x or v, and where it depends on x or v it contains sign nowhere, and Abs and Heaviside only

    * as ``Abs(g)**p`` with an exponent p that is no whole number (real on both sides of g = 0), and
    * inside functions and denominators, where taking them apart would lose all digits: ``exp(-Abs(v)/w)``,
      ``log(1 + Abs(x))``, ``v/(1 + Abs(v))``. What stands there belongs to switches of the normal form, so
      in a known mode ``Abs(x - b)`` is plus or minus ``x - b`` and ``Heaviside(x - b)`` is one or zero.

    Factors without x and v may contain Abs, sign, Max and Min of parameters. Where a term does not act it
    need not be defined (a root of a negative number); do not evaluate it there.
    """

    term: sympy.Expr
    switches: tuple[Switch, ...]


@dataclass(frozen=True, slots=True)
class NormalForm:
    """A force law as smooth pieces behind switches; the sum of the pieces is the law."""

    pieces: tuple[Piece, ...]

    @property
    def switches(self) -> tuple[Switch, ...]:
        """Every switch of the law once, in a stable order; those inside functions of a term included."""
        return _all_switches(self.pieces)

    @property
    def base(self) -> sympy.Expr:
        """The sum of the terms that act everywhere."""
        return sympy.Add(*(piece.term for piece in self.pieces if not piece.switches))


def _switches(key: Key) -> tuple[Switch, ...]:
    switches = []
    if key.x is not None:
        switches.append(Switch(symbol("x") - key.x, "x", key.x))
    if key.v is not None:
        switches.append(Switch(symbol("v") - key.v, "v", key.v))
    others = sorted(key.others, key=sympy.default_sort_key)
    return (*switches, *(Switch(function, None, None) for function in others))


def _renamed(key: Key, names: dict[sympy.Symbol, sympy.Symbol]) -> Key:
    return Key(
        None if key.x is None else key.x.xreplace(names),
        None if key.v is None else key.v.xreplace(names),
        frozenset(function.xreplace(names) for function in key.others),
    )


@lru_cache(maxsize=512)
def _all_switches(pieces: tuple[Piece, ...]) -> tuple[Switch, ...]:
    outer = [switch for piece in pieces for switch in piece.switches]
    inner = [s for piece in pieces for key in inner_switches(piece.term) for s in _switches(key)]
    return tuple(dict.fromkeys(outer + inner))


def _order(key: Key) -> tuple[object, ...]:
    places = [(p is not None, sympy.default_sort_key(p or sympy.S.Zero)) for p in (key.x, key.v)]
    return (*places, tuple(sorted(map(sympy.default_sort_key, key.others))))


@lru_cache(maxsize=512)
def normal_form(force: sympy.Expr, positive: frozenset[str] = frozenset()) -> NormalForm:
    """Reduce a law to smooth pieces behind switches (abs, sign, Heaviside, Piecewise, Min, Max disappear).

    The value on a switch itself (sign(0), Heaviside(0)) is not kept: it has measure zero. A switch function
    whose zero is not known as a value of x or of v alone, as in ``sign(x + v)``, gives a switch of its own
    with ``variable`` None. Factors of switch functions that depend on parameters only are taken as not zero.

    Parameters
    ----------
    force
        The law n(x, v).
    positive
        Names of parameters known to be positive. A law whose pieces depend on the sign of a parameter has
        fewer pieces then; without, the form holds for either sign.

    Raises
    ------
    ExpressionError
        The law is not real for negative x or v, not defined everywhere, or has hundreds of switches.

    Examples
    --------
    >>> from rsgen.expression import parse
    >>> [(str(p.term), [str(s.function) for s in p.switches]) for p in normal_form(parse("sign(v)")).pieces]
    [('-1', []), ('2', ['v'])]
    """
    known = {symbol(name): sympy.Dummy(name, positive=True) for name in positive}
    back = {dummy: free for free, dummy in known.items()}
    form = {
        _renamed(key, back): term.xreplace(back) for key, term in reduce_law(force.xreplace(known)).items()
    }
    return NormalForm(tuple(Piece(form[key], _switches(key)) for key in sorted(form, key=_order)))
