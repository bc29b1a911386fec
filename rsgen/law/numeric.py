"""A force law as fast array functions: the force, its slopes, and what each parameter adds to it.

Steps H(s) of the normal form are taken as the share of a sampling interval in which s is positive, so that
sums over samples converge in the sampling step although the law has jumps and corners.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy.printing.numpy import SciPyPrinter

from rsgen.expression import symbol
from rsgen.law.homogeneity import scaled_groups
from rsgen.law.pieces import Piece, normal_form

__all__ = ["ForceLaw", "ForceSample", "compile_law"]

Array = NDArray[np.float64]

_WHOLE_POWERS = 8

_PLACES = 64
_ZERO = 1e-9
"""Relative size at which terms cancel."""

_MOST_LINEAR_SETS = 12
"""Above so many parameters the linear ones are chosen greedily instead of by trying every set."""


def _printer() -> Any:
    """Print whole powers as products: ten times quicker for arrays than a general power."""
    printer = SciPyPrinter(
        {"fully_qualified_modules": False, "inline": True, "allow_unknown_functions": True}
    )
    general = printer._print_Pow

    def product(power: sympy.Pow, **settings: Any) -> str:
        if power.base.is_Symbol and power.exp.is_Integer and 2 <= power.exp <= _WHOLE_POWERS:
            return "(" + "*".join([printer._print(power.base)] * int(power.exp)) + ")"
        return str(general(power, **settings))

    printer._print_Pow = product
    return printer


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
class ForceLaw:
    """A compiled law n(x, v; p).

    Parameters
    ----------
    parameters
        Names, in the order of every parameter array.
    linear
        Indices of parameters in which the law is jointly linear once the others are fixed.
    nonlinear
        The other indices (breakpoints, exponents, widths of a tanh ...).
    scaled
        Groups of nonlinear indices in whose common positive factor the law is linear: force and stiffness
        of a saturation.
    odd
        True where n(-x, -v) = -n(x, v): the mean and all even harmonics vanish.
    switched
        True where the law has switches at all.
    rough
        True where the law jumps or has a corner at one of them; x|x| does not.
    jumps
        True where it jumps.
    springs
        True where the force depends on x: the mean displacement then follows from the law.
    """

    parameters: tuple[str, ...]
    linear: tuple[int, ...]
    nonlinear: tuple[int, ...]
    scaled: tuple[tuple[int, ...], ...]
    odd: bool
    switched: bool
    rough: bool
    jumps: bool
    springs: bool
    _function: Callable[..., Sequence[Any]]
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
    by_name = {free.name: free for free in force.free_symbols}
    x, v = (by_name.pop(name, symbol(name)) for name in ("x", "v"))
    names = tuple(sorted(by_name))
    own = [symbol(f"p{i}") for i in range(len(names))]
    renamed = {by_name[name]: place for name, place in zip(names, own, strict=True)}
    variables = [x, v, *own]

    pieces = normal_form(force).pieces
    switches = list(dict.fromkeys(switch.function for piece in pieces for switch in piece.switches))
    outputs: list[sympy.Expr] = []

    def emit(expression: sympy.Expr) -> int | None:
        if expression == 0:
            return None
        outputs.append(expression)
        return len(outputs) - 1

    def emit_with_slopes(expression: sympy.Expr) -> tuple[int | None, tuple[int | None, ...]]:
        value = emit(expression)
        return value, tuple(emit(_plain(expression.diff(variable))) for variable in variables)

    steps = []
    for function in switches:
        value, slopes = emit_with_slopes(function.subs(renamed))
        if value is not None:
            steps.append(_Step(value, slopes))
    terms = []
    for piece in pieces:
        value, slopes = emit_with_slopes(piece.term.subs(renamed))
        if value is not None:
            everywhere = all(
                term.is_polynomial(x, v)
                for term in (piece.term, *(piece.term.diff(f) for f in by_name.values()))
            )
            places = tuple(switches.index(s.function) for s in piece.switches)
            terms.append(_Term(value, slopes, places, everywhere))

    plain_terms = [piece.term.subs(renamed) for piece in pieces]
    thresholds = {free for function in switches for free in function.subs(renamed).free_symbols}
    linear = _jointly_linear(plain_terms, own, thresholds)
    function = sympy.lambdify(
        variables, outputs, modules=[{"functools": functools}, "scipy", "numpy"], cse=True, printer=_printer()
    )
    law = ForceLaw(
        parameters=names,
        linear=linear,
        nonlinear=tuple(i for i in range(len(names)) if i not in linear),
        scaled=scaled_groups(
            [(piece.term, [switch.function for switch in piece.switches]) for piece in pieces],
            [by_name[name] for name in names],
            linear,
        ),
        odd=False,
        switched=bool(steps),
        rough=any(any(_onset(piece)) for piece in pieces),
        jumps=any(_onset(piece)[0] for piece in pieces),
        springs=bool(force.has(x)),
        _function=function,
        _terms=tuple(terms),
        _steps=tuple(steps),
    )
    return _with_symmetry(law)


def _onset(piece: Piece) -> tuple[bool, bool]:
    """Tell whether a piece sets in with a jump, with a corner; where that cannot be told, with both."""
    if not piece.switches:
        return False, False
    switch = piece.switches[0]
    if len(piece.switches) > 1 or switch.variable is None:
        return True, True
    variable = symbol(switch.variable)
    onset = [piece.term, piece.term.diff(variable)]
    values = [term.subs(variable, switch.threshold) for term in onset]
    # a breakpoint Max(0, b) is b wherever it matters
    values = [
        value.replace(sympy.Max, lambda *args: sympy.Add(*args) if 0 in args else sympy.Max(*args))
        for value in values
    ]
    # 0**(q - 1) with q unknown: an exponent is taken to be above one, as a lower one would be seen as a jump
    values = [value.replace(lambda e: e.is_Pow and e.base == 0, lambda e: sympy.S.Zero) for value in values]
    jump, corner = (bool(value.simplify() not in (0, sympy.nan)) for value in values)
    return jump, corner


def _plain(expression: sympy.Expr) -> sympy.Expr:
    """Drop the impulses that differentiating a jump leaves; the steps carry them."""
    return expression.replace(sympy.DiracDelta, lambda *_: sympy.Integer(0))


def _jointly_linear(
    terms: list[sympy.Expr], parameters: list[sympy.Symbol], thresholds: set[sympy.Symbol]
) -> tuple[int, ...]:
    """Find the largest set of parameters in which every term is linear at once (first such set by name)."""
    slopes = [[term.diff(p) for term in terms] for p in parameters]
    clash = {
        (i, j)
        for i, row in enumerate(slopes)
        for j, other in enumerate(parameters)
        if i <= j and not all(_vanishes(slope.diff(other)) for slope in row if slope.has(other))
    }
    free = [i for i, p in enumerate(parameters) if p not in thresholds and (i, i) not in clash]
    if len(free) <= _MOST_LINEAR_SETS:
        for size in range(len(free), 0, -1):
            for chosen in combinations(free, size):
                if not any(pair in clash for pair in combinations(chosen, 2)):
                    return chosen
    picked: list[int] = []
    for i in sorted(free, key=lambda i: sum(i in pair for pair in clash)):
        if not any(tuple(sorted((i, j))) in clash for j in picked):
            picked.append(i)
    return tuple(sorted(picked))


def _vanishes(expression: sympy.Expr) -> bool:
    """Tell whether an expression is zero, from its value at random places: to simplify one may not end."""
    if expression == 0:
        return True
    if expression.has(sympy.DiracDelta):
        # the slope of |p| jumps where p changes its sign
        return False
    variables = sorted(expression.free_symbols, key=str)
    parts = sympy.Add.make_args(expression)
    evaluate = sympy.lambdify(variables, parts, modules=[{"functools": functools}, "scipy", "numpy"])
    generator = np.random.default_rng(0)
    # sizes differ, so that what a large number in a law hides at most places shows at some
    places = 10.0 ** generator.uniform(-4, 4, (len(variables), _PLACES)) * generator.uniform(
        0.5, 2.0, _PLACES
    )
    with np.errstate(all="ignore"):
        values = np.array([np.broadcast_to(np.asarray(part, float), _PLACES) for part in evaluate(*places)])
        size = np.sum(np.abs(values), axis=0)
        told = np.isfinite(size) & (size > 0)
        return bool(told.any() and np.all(np.abs(values.sum(axis=0))[told] <= _ZERO * size[told]))


def _with_symmetry(law: ForceLaw) -> ForceLaw:
    # Tried at random states and values of several sizes: a symbolic proof does not end for every law.
    generator = np.random.default_rng(0)
    odd = True
    for scale in (1e-3, 1.0, 1e3):
        x, v = generator.normal(size=(2, 64)) * scale
        for _ in range(3):
            values = np.exp(generator.normal(size=len(law.parameters))) * scale
            one, other = law.force(x, v, values), law.force(-x, -v, values)
            told = np.isfinite(one) & np.isfinite(other)
            largest = np.max(np.abs(one[told]), initial=0.0)
            odd &= bool(np.all(np.abs(one[told] + other[told]) <= 1e-9 * largest))
    return replace(law, odd=odd)
