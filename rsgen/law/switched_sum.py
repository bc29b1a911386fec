"""An expression in normal form as fast array functions: its value and slopes along moving variables.

Steps H(s) of the normal form are taken as the share of a sampling interval in which s is positive, so that
sums over samples converge in the sampling step although the expression has jumps and corners.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.law.pieces import normal_form, slope_between_jumps

if TYPE_CHECKING:
    from rsgen.law.motion import FourierSeries

# ----------------------------------------------------------------------------
# A law along periodic motions: its force and the derivatives by parameters and motion.

Perturbation = Callable[[Array, Array], Array]
"""From changes of displacement (d, s) [m] and velocity (n, d, s) [m/s] along n motions to those of q memories
(q, n, d, s)."""


@dataclass(frozen=True, slots=True)
class ForceSample:
    """The law along a motion: force n, slopes dn/dx and dn/dv, and dn/dp for each parameter (same shape).

    Slopes by x and v are those with all memories kept; ``by_memory`` has the others: dn/dz (q, n, s) of some
    memories and their change for a change of the whole motion.
    """

    force: Array
    by_x: Array
    by_v: Array
    by_parameter: tuple[Array, ...]
    by_memory: tuple[tuple[Array, Perturbation], ...] = ()

    def tangent(self, series: FourierSeries, omega: Array) -> Array:
        """(n, d, d) derivative of the projected force by the coordinates of the motion (column).

        Parameters
        ----------
        series
            Of the motion, at the samples of the law.
        omega
            (n,) base frequency [rad/s].
        """
        tangent = series.tangent(self.by_x, omega[:, None] * self.by_v)
        for slope, perturbation in self.by_memory:
            change = perturbation(series.shape, omega[:, None, None] * series.rate)
            moved = np.sum(slope[:, :, None] * change, axis=0)
            tangent += np.swapaxes(moved @ series.project, 1, 2)
        return tangent


@dataclass(frozen=True, slots=True)
class _Term:
    """A piece of the normal form: which outputs of the compiled function are its value and derivatives."""

    value: int
    derivatives: tuple[int | None, ...]  # by the moving ones, then each parameter; None where zero
    switches: tuple[int, ...]
    everywhere: bool  # finite also where its switches are off


@dataclass(frozen=True, slots=True)
class _Step:
    value: int
    derivatives: tuple[int | None, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SwitchedSum:
    """A compiled expression of moving variables (x, v, states of memories) and parameters."""

    _function: Numeric
    _terms: tuple[_Term, ...]
    _steps: tuple[_Step, ...]
    _slopes: int

    def __call__(
        self,
        moving: Sequence[Array],
        rates: Sequence[Array],
        step: Array,
        values: Sequence[Any] | Array,
        *,
        by_parameters: bool = True,
    ) -> tuple[Array, ...]:
        """Evaluate the expression, its slopes by each moving variable, and those by each parameter.

        Parameters
        ----------
        moving, rates
            The moving variables and their derivatives by time, of one shape.
        step
            Sampling interval [s], broadcast against them.
        values
            (p,) SI values of the parameters, or arrays that broadcast.
        by_parameters
            Whether the slopes by the parameters are wanted.
        """
        slopes = self._slopes if by_parameters else len(moving)
        sums = [np.zeros_like(moving[0]) for _ in range(1 + slopes)]
        with np.errstate(all="ignore"):
            outputs = self._function(*moving, *values)
            shares = [_share(outputs, switch, rates, step) for switch in self._steps]
            for term in self._terms:
                self._add(sums, term, outputs, shares)
            for total in sums[1:]:
                # a power law with exponent below one has an infinite slope at a single instant
                if not np.isfinite(np.sum(total)):
                    np.nan_to_num(total, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return tuple(sums)

    def _add(
        self,
        sums: list[Array],
        term: _Term,
        outputs: Sequence[Any],
        shares: list[tuple[Array, Array]],
    ) -> None:
        if not term.switches:
            sums[0] += outputs[term.value]
            for total, index in zip(sums[1:], term.derivatives, strict=False):
                if index is not None:
                    total += outputs[index]
            return
        factor = shares[term.switches[0]][0]
        for switch in term.switches[1:]:
            factor = factor * shares[switch][0]
        active = None if term.everywhere else factor > 0

        def inside(output: Any) -> Any:
            if active is None:
                return output
            # an interval with a share in (x - b)**1.5, x > b, may begin where that is not defined
            return np.where(active & ~((factor < 1) & np.isnan(output)), output, 0.0)

        value = inside(outputs[term.value])
        sums[0] += factor * value
        for total, index in zip(sums[1:], term.derivatives, strict=False):
            if index is not None:
                total += factor * inside(outputs[index])
        for switch in term.switches:
            rest = shares[switch][1] * value
            for other in term.switches:
                if other != switch:
                    rest = rest * shares[other][0]
            if not term.everywhere:
                rest = np.where(shares[switch][1] > 0, rest, 0.0)
            for total, index in zip(sums[1:], self._steps[switch].derivatives, strict=False):
                if index is not None:
                    total += rest * outputs[index]


def _share(outputs: Sequence[Any], switch: _Step, rates: Sequence[Array], step: Array) -> tuple[Array, Array]:
    """Share of the sampling interval in which the switch is on, and its derivative by the switch function."""
    value = np.broadcast_to(np.asarray(outputs[switch.value], dtype=float), rates[0].shape)
    speed = np.zeros_like(rates[0])
    for index, rate in zip(switch.derivatives, rates, strict=False):
        if index is not None:
            speed = speed + outputs[index] * rate
    width = np.abs(speed) * step
    share = value / width
    constant_zero = (value == 0) & (width == 0)
    share[constant_zero] = 0.0
    share += 0.5
    slope = np.where((share > 0) & (share < 1), 1 / width, 0.0)
    slope[constant_zero] = 0.0
    return np.clip(share, 0.0, 1.0, out=share), slope


@lru_cache(maxsize=512)
def switched_sum(
    expression: sympy.Expr, moving: tuple[sympy.Symbol, ...], parameters: tuple[sympy.Symbol, ...]
) -> SwitchedSum:
    """Compile an expression for arrays, once."""
    pieces = normal_form(expression).pieces
    switches = list(dict.fromkeys(switch.function for piece in pieces for switch in piece.switches))
    outputs: list[sympy.Expr] = []
    variables = (*moving, *parameters)

    def emit(expression: sympy.Expr) -> int | None:
        if expression == 0:
            return None
        outputs.append(expression)
        return len(outputs) - 1

    def emit_with_slopes(expression: sympy.Expr) -> tuple[int, tuple[int | None, ...]]:
        outputs.append(expression)
        value = len(outputs) - 1
        return value, tuple(emit(slope_between_jumps(expression, p)) for p in variables)

    steps = [_Step(*emit_with_slopes(function)) for function in switches]
    terms = [
        _Term(
            *emit_with_slopes(piece.term),
            tuple(switches.index(switch.function) for switch in piece.switches),
            all(
                term.is_polynomial(*moving)
                for term in (piece.term, *(piece.term.diff(p) for p in parameters))
            ),
        )
        for piece in pieces
    ]
    return SwitchedSum(compiled(tuple(outputs), variables), tuple(terms), tuple(steps), len(variables))
