"""One spring or damper: a force law in x and v, its parameters, and its normal form.

The normal form is the one idea that carries the house: a law is a sum of smooth terms, each behind the
product of at most a few switches,  n(x, v) = sum_j d_j(x, v) * prod_i H(s_ji),  where H is the unit step.
Describing functions integrate it piece by piece, the kernel compiles it with the switches as events, and
identification differentiates it; nothing else takes a law apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy

__all__ = ["Element", "NormalForm", "Piece", "Switch", "normal_form"]


@dataclass(frozen=True, slots=True)
class Switch:
    """A surface in the (x, v) plane on which a law changes its formula.

    ``function`` is s in H(s): ``x - b`` (``variable`` "x", ``threshold`` b), ``v - w`` (``variable`` "v",
    ``threshold`` w), or anything else that cannot be reduced to these (both None).
    Thresholds contain parameters and numbers only, never x or v.
    """

    function: sympy.Expr
    variable: str | None
    threshold: sympy.Expr | None


@dataclass(frozen=True, slots=True)
class Piece:
    """A term d(x, v), smooth where it acts: where every switch function is positive (no switch: always)."""

    term: sympy.Expr
    switches: tuple[Switch, ...]


@dataclass(frozen=True, slots=True)
class NormalForm:
    """A force law as smooth pieces behind switches; the sum of the pieces is the law."""

    pieces: tuple[Piece, ...]

    @property
    def switches(self) -> tuple[Switch, ...]:
        """Every switch of the law once, in a stable order."""
        return tuple(dict.fromkeys(switch for piece in self.pieces for switch in piece.switches))

    @property
    def base(self) -> sympy.Expr:
        """The sum of the terms that act everywhere."""
        return sympy.Add(*(piece.term for piece in self.pieces if not piece.switches))


@dataclass(frozen=True, slots=True)
class Element:
    """A spring or damper: its name and its force law [N] in x [m] and v [m/s]; symbolic only.

    ``parameters`` are the free symbols of the law other than x and v, sorted by name.
    """

    name: str
    force: sympy.Expr
    parameters: tuple[str, ...]


def normal_form(force: sympy.Expr) -> NormalForm:
    """Reduce a law to smooth pieces behind switches (abs, sign, Heaviside, Piecewise, Min, Max disappear)."""
    raise NotImplementedError
