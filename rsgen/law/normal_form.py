"""The normal form of a law: smooth pieces behind switches.

A law is a sum of smooth terms, each behind the product of at most a few switches,
n(x, v) = sum_j d_j(x, v) * prod_i H(s_ji),  where H is the unit step. Describing functions integrate it piece
by piece, the kernel compiles it with the switches as events, and identification differentiates it: a
``SwitchedSum`` has the form and its slopes as array functions. There a step H(s) is the share of a sampling
interval in which s is positive, so that sums over samples converge in the sampling step although the
expression has jumps and corners.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.formula.names import symbol
from rsgen.law.forms import MAX_OPERATIONS, Form, Key, add, expanded, moves
from rsgen.law.memory import memory_form
from rsgen.law.rewriting import inner_switches, reduce_law

if TYPE_CHECKING:
    from rsgen.law.motion import FourierSeries


# ----------------------------------------------------------------------------
# Derivatives of laws between their jumps.


def slope_between_jumps(expression: sympy.Expr, by: sympy.Symbol) -> sympy.Expr:
    """Differentiate an expression, without the impulses that a jump leaves; steps carry those.

    Examples
    --------
    >>> from rsgen.formula.names import symbol
    >>> from rsgen.formula.reading import parse
    >>> slope_between_jumps(parse("k*x + Ff*sign(v)"), symbol("v"))
    0
    """
    slope = expression.diff(by).replace(sympy.DiracDelta, lambda *_: sympy.Integer(0))
    # of sign(p**(1/3)) SymPy does not know that it is real, and leaves its derivative as it is
    return slope.replace(
        lambda part: isinstance(part, sympy.Derivative | sympy.Subs) and part.has(sympy.sign),
        lambda _: sympy.Integer(0),
    )


CHOICES = (sympy.Max, sympy.Min, sympy.Abs, sympy.sign)
"""Functions of parameters that their signs or their order decide."""


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
    * inside functions and denominators, where a decomposition would lose all digits: ``exp(-Abs(v)/w)``,
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
    def expression(self) -> sympy.Expr:
        """The law as one expression, steps written as Heaviside."""
        return sympy.Add(
            *(
                piece.term * sympy.Mul(*(sympy.Heaviside(switch.function) for switch in piece.switches))
                for piece in self.pieces
            )
        )


def _switches(key: Key) -> tuple[Switch, ...]:
    switches = []
    if key.x is not None:
        switches.append(Switch(symbol("x") - key.x, "x", key.x))
    if key.v is not None:
        switches.append(Switch(symbol("v") - key.v, "v", key.v))
    others = sorted(key.others, key=sympy.default_sort_key)
    return (*switches, *(Switch(function, None, None) for function in others))


def _mapped(key: Key, change: Callable[[sympy.Expr], sympy.Expr]) -> Key:
    return Key(
        None if key.x is None else change(key.x),
        None if key.v is None else change(key.v),
        frozenset(map(change, key.others)),
    )


def _along_states(force: sympy.Expr) -> sympy.Expr:
    """Return a law with memory as f(x, v, z): the states stand for what is remembered."""
    memory = memory_form(force)
    return force if memory is None else memory.force


@lru_cache(maxsize=512)
def _all_switches(pieces: tuple[Piece, ...]) -> tuple[Switch, ...]:
    outer = [switch for piece in pieces for switch in piece.switches]
    inner = [s for piece in pieces for key in inner_switches(piece.term) for s in _switches(key)]
    return tuple(dict.fromkeys(outer + inner))


def _order(key: Key) -> tuple[object, ...]:
    places = [(p is not None, sympy.default_sort_key(p or sympy.S.Zero)) for p in (key.x, key.v)]
    return (*places, tuple(sorted(map(sympy.default_sort_key, key.others))))


@lru_cache(maxsize=512)
def normal_form(force: sympy.Expr) -> NormalForm:
    """Reduce a law to smooth pieces behind switches (abs, sign, Heaviside, Piecewise, Min, Max disappear).

    The value on a switch itself (sign(0), Heaviside(0)) is lost: it has measure zero. A switch function
    whose zero is not known as a value of x or of v alone, as in ``sign(x + v)``, gives a switch
    with ``variable`` None. Factors of switch functions that depend on parameters only are taken as not zero.

    Parameters
    ----------
    force
        The law n(x, v). It has fewer pieces where the sign of a parameter on which they depend is known to
        SymPy; else the form holds for either sign.

    The form of a law with memory is that of f(x, v, z); its states are ``Inner`` symbols (``memory_form``).

    Raises
    ------
    ExpressionError
        The law is not real for negative x or v, not defined everywhere, or has hundreds of switches or
        thousands of operations.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> [(str(p.term), [str(s.function) for s in p.switches]) for p in normal_form(parse("sign(v)")).pieces]
    [('-1', []), ('2', ['v'])]
    """
    form = reduce_law(_along_states(force))
    operations = sum(term.count_ops() for term in form.values())
    operations += sum(function.count_ops() for key in form for function in key.others)
    if operations > MAX_OPERATIONS:
        raise ExpressionError(
            f"law: its pieces, multiplied out, take {operations} operations, at most {MAX_OPERATIONS} are "
            "allowed; write it with fewer abs, sign, Min, Max, Piecewise or powers of sums"
        )
    return _sorted(form)


def normal_form_at(force: sympy.Expr, values: Mapping[str, float]) -> NormalForm:
    """Return the normal form near some values of the parameters: the same for every wording of a law.

    Where the sign or the order of parameters decides (``abs(x) <= b`` is never true for a negative b), the
    normal form for all values has switches that meet or never act, and which ones depends on the wording.
    Here Max, Min, Abs and sign of parameters are what they are at ``values``.

    Parameters
    ----------
    force
        The law n(x, v).
    values
        Of every parameter [SI]; others are ignored.

    Raises
    ------
    ExpressionError
        As for ``normal_form``.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> gap = parse("Piecewise((x - b, x > b), (x + b, x < -b), (0, True))")
    >>> [str(s.function) for s in normal_form(gap).switches]
    ['b + x', '-b + x', 'x - Max(-b, b)']
    >>> [str(s.function) for s in normal_form_at(gap, {"b": 0.5}).switches]
    ['b + x', '-b + x']
    """
    choices = _choices(force)
    if not choices:
        return normal_form(force)
    names = sorted({name for choice in choices for name in choice.free_symbols}, key=str)
    arguments = tuple(argument for choice in choices for argument in choice.args)
    numbers = iter(compiled(arguments, tuple(names))(*(float(values[name.name]) for name in names)))
    taken = tuple(_taken(choice, [float(next(numbers)) for _ in choice.args]) for choice in choices)
    return _resolved(force, taken)


@lru_cache(maxsize=512)
def _choices(force: sympy.Expr) -> tuple[sympy.Expr, ...]:
    """List the functions in the normal form that signs or the order of parameters decide."""
    form = normal_form(force)
    places = [piece.term for piece in form.pieces] + [switch.function for switch in form.switches]
    found = {choice for place in places for choice in place.atoms(*CHOICES) if not moves(choice)}
    return tuple(sorted(found, key=sympy.default_sort_key))


def _taken(choice: sympy.Expr, numbers: list[float]) -> int:
    """Say which argument Max and Min take, and which sign Abs and sign see; 0: none."""
    if isinstance(choice, sympy.Max | sympy.Min):
        return numbers.index(max(numbers) if isinstance(choice, sympy.Max) else min(numbers))
    # without a sign, as at values where the law is not defined, it stays as it is written
    return 0 if np.isnan(numbers[0]) else int(np.sign(numbers[0]))


@lru_cache(maxsize=512)
def _resolved(force: sympy.Expr, taken: tuple[int, ...]) -> NormalForm:
    """Return the normal form of a law with each Abs, sign, Max and Min of parameters as ``taken``."""
    choice_of = dict(zip(_choices(force), taken, strict=True))

    def resolved(expression: sympy.Expr) -> sympy.Expr:
        if expression not in choice_of:
            return expression.func(*map(resolved, expression.args)) if expression.args else expression
        place = choice_of[expression]
        if isinstance(expression, sympy.Max | sympy.Min):
            return resolved(expression.args[place])
        inner = resolved(expression.args[0])
        if place == 0:
            return expression.func(inner)
        return place * inner if isinstance(expression, sympy.Abs) else sympy.Integer(place)

    def threshold(expression: sympy.Expr) -> sympy.Expr:
        return sympy.expand_mul(resolved(expression))

    form = reduce_law(_along_states(force))
    return _sorted(add(*({_mapped(key, threshold): expanded(resolved(term))} for key, term in form.items())))


def _sorted(form: Form) -> NormalForm:
    return NormalForm(tuple(Piece(form[key], _switches(key)) for key in sorted(form, key=_order)))


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
        self, sums: list[Array], term: _Term, outputs: Sequence[Any], shares: list[tuple[Array, Array]]
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

    def emit(expression: sympy.Expr) -> int:
        outputs.append(expression)
        return len(outputs) - 1

    def emit_with_slopes(expression: sympy.Expr) -> tuple[int, tuple[int | None, ...]]:
        value, slopes = emit(expression), (slope_between_jumps(expression, p) for p in variables)
        return value, tuple(None if slope == 0 else emit(slope) for slope in slopes)

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
