"""A force law as fast array functions: the force, its slopes, and what each parameter adds to it.

Steps H(s) of the normal form are taken as the share of a sampling interval in which s is positive, so that
sums over samples converge in the sampling step although the law has jumps and corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.expression import symbol
from rsgen.expression.evaluation import Numeric, compiled
from rsgen.law.character import Character, character
from rsgen.law.pieces import normal_form

__all__ = ["ForceLaw", "ForceSample", "compile_law"]

Array = NDArray[np.float64]


class Periodic(Protocol):
    """What a law needs of n periodic motions: one period of them as waveforms (n, samples)."""

    def waveforms(self, samples: int) -> tuple[Array, Array, Array]:
        """Displacement [m], velocity [m/s] and acceleration [m/s^2]."""
        ...

    def interval(self, samples: int) -> Array:
        """(n, 1) time from sample to sample [s]."""
        ...


@dataclass(frozen=True, slots=True)
class ForceSample:
    """The law along a motion: force n, slopes dn/dx and dn/dv, and dn/dp for each parameter (same shape)."""

    force: Array
    by_x: Array
    by_v: Array
    by_parameter: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class _Term:
    """A piece of the normal form: which outputs of the compiled function are its value and derivatives."""

    value: int
    derivatives: tuple[int | None, ...]  # by x, v, then each parameter; None where zero
    switches: tuple[int, ...]
    everywhere: bool  # finite also where its switches are off


@dataclass(frozen=True, slots=True)
class _Step:
    value: int
    derivatives: tuple[int | None, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ForceLaw(Character):
    """A compiled law n(x, v; p) and its character."""

    _function: Numeric
    _terms: tuple[_Term, ...]
    _steps: tuple[_Step, ...]

    def sample(self, x: Array, v: Array, a: Array, step: Array, values: Array) -> ForceSample:
        """Evaluate the law and all its derivatives along a motion.

        Parameters
        ----------
        x, v, a
            Displacement [m], velocity [m/s], acceleration [m/s^2], of one shape.
        step
            Sampling interval [s], broadcast against x.
        values
            (p,) SI values of the parameters.
        """
        count = 2 + len(self.parameters)
        sums = [np.zeros_like(x) for _ in range(1 + count)]
        with np.errstate(all="ignore"):
            outputs = self._function(x, v, *values)
            shares = [_share(outputs, switch, v, a, step) for switch in self._steps]
            for term in self._terms:
                self._add(sums, term, outputs, shares)
            for total in sums[1:]:
                # a power law with exponent below one has an infinite slope at a single instant
                if not np.isfinite(np.sum(total)):
                    np.nan_to_num(total, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return ForceSample(sums[0], sums[1], sums[2], tuple(sums[3:]))

    def _add(
        self,
        sums: list[Array],
        term: _Term,
        outputs: Sequence[Any],
        shares: list[tuple[Array, Array]],
    ) -> None:
        if not term.switches:
            sums[0] += outputs[term.value]
            for total, index in zip(sums[1:], term.derivatives, strict=True):
                if index is not None:
                    total += outputs[index]
            return
        factor = shares[term.switches[0]][0]
        for switch in term.switches[1:]:
            factor = factor * shares[switch][0]
        active = None if term.everywhere else factor > 0

        def inside(output: Any) -> Any:
            return output if active is None else np.where(active, output, 0.0)

        value = inside(outputs[term.value])
        sums[0] += factor * value
        for total, index in zip(sums[1:], term.derivatives, strict=True):
            if index is not None:
                total += factor * inside(outputs[index])
        for switch in term.switches:
            rest = shares[switch][1] * value
            for other in term.switches:
                if other != switch:
                    rest = rest * shares[other][0]
            if not term.everywhere:
                rest = np.where(shares[switch][1] > 0, rest, 0.0)
            for total, index in zip(sums[1:], self._steps[switch].derivatives, strict=True):
                if index is not None:
                    total += rest * outputs[index]

    def along(self, motion: Periodic, values: Array, samples: int) -> ForceSample:
        """Evaluate the law and all its derivatives (n, samples) over one period of n motions.

        Parameters
        ----------
        motion
            A ``rsgen.motion.Motion``.
        values
            (p,) SI values of the parameters.
        samples
            A period.
        """
        return self.sample(*motion.waveforms(samples), motion.interval(samples), values)

    def force(self, x: Array, v: Array, values: Array) -> Array:
        """Evaluate n(x, v) [N] point by point; a step counts one half where its switch is zero."""
        still = np.zeros_like(x)
        return self.sample(x, v, still, still, values).force


def _share(outputs: Sequence[Any], switch: _Step, v: Array, a: Array, step: Array) -> tuple[Array, Array]:
    """Share of the sampling interval in which the switch is on, and its derivative by the switch function."""
    value = np.broadcast_to(np.asarray(outputs[switch.value], dtype=float), v.shape)
    speed = np.zeros_like(v)
    for index, rate in zip(switch.derivatives[:2], (v, a), strict=True):
        if index is not None:
            speed = speed + outputs[index] * rate
    width = np.abs(speed) * step
    share = value / width
    still = (value == 0) & (width == 0)
    share[still] = 0.0
    share += 0.5
    slope = np.where((share > 0) & (share < 1), 1 / width, 0.0)
    slope[still] = 0.0
    return np.clip(share, 0.0, 1.0, out=share), slope


@lru_cache(maxsize=256)
def compile_law(force: sympy.Expr) -> ForceLaw:
    """Compile a law for arrays, once; parameters are every symbol but x and v, sorted by name."""
    kind = character(force)
    x, v = states = (symbol("x"), symbol("v"))
    parameters = tuple(map(symbol, kind.parameters))
    pieces = normal_form(force).pieces
    switches = list(dict.fromkeys(switch.function for piece in pieces for switch in piece.switches))
    outputs: list[sympy.Expr] = []

    def emit(expression: sympy.Expr) -> int | None:
        if expression == 0:
            return None
        outputs.append(expression)
        return len(outputs) - 1

    def emit_with_slopes(expression: sympy.Expr) -> tuple[int, tuple[int | None, ...]]:
        outputs.append(expression)
        value = len(outputs) - 1
        return value, tuple(emit(_plain(expression.diff(p))) for p in (*states, *parameters))

    steps = [_Step(*emit_with_slopes(function)) for function in switches]
    terms = [
        _Term(
            *emit_with_slopes(piece.term),
            tuple(switches.index(switch.function) for switch in piece.switches),
            all(term.is_polynomial(x, v) for term in (piece.term, *(piece.term.diff(p) for p in parameters))),
        )
        for piece in pieces
    ]
    facts: dict[str, Any] = {field.name: getattr(kind, field.name) for field in fields(Character)}
    return ForceLaw(
        **facts,
        _function=compiled(tuple(outputs), (*states, *parameters)),
        _terms=tuple(terms),
        _steps=tuple(steps),
    )


def _plain(expression: sympy.Expr) -> sympy.Expr:
    """Drop the impulses that differentiating a jump leaves; the steps carry them."""
    return expression.replace(sympy.DiracDelta, lambda *_: sympy.Integer(0))
