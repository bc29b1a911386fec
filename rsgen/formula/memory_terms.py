"""What remembers in a force law: states with equations of their own, Masing laws, structural damping.

A law stays one expression. ``State`` is a state z of the law that carries the equations z' = g of all states
it depends on; ``Masing`` holds the virgin curve of a law whose branches follow Masing's rule; ``Structural``
the stiffness of rate-independent linear damping.
"""

from __future__ import annotations

from typing import Any

import sympy

__all__ = ["Inner", "Masing", "State", "Structural", "remembers"]


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
    """The value of a memory inside a law that was taken apart: it moves with time, as x and v do."""

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
