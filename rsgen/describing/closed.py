"""The closed part of a describing function: exact integrals of every piece of the law over its arcs.

On the cycle x = X0 + X sin(phi), v = omega X cos(phi) it computes

    k = 1/(pi X) integral n sin(phi) dphi,  c = 1/(pi omega X) integral n cos(phi) dphi,
    mean force = 1/(2 pi) integral n dphi.

A law in normal form is a sum of smooth pieces, each behind at most one switch in x and one in v. A switch is
on over one arc of phi whose ends are an arcsine or an arccosine, so that the integral of powers of x and v is
a polynomial in the angle, sine and cosine of the ends. Integrals of real powers over quarters of the cycle
are gamma functions, those with trigonometric and exponential factors are Bessel functions. A law has a closed
form if each of its addends has one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, X
from rsgen.law.normal_form import NormalForm

# ----------------------------------------------------------------------------
# Real powers: |sin|**p |cos|**q over quarters of a cycle, by gamma functions.
#
# The quarter integral is half a beta function,
# integral_0^(pi/2) sin**p cos**q = Gamma((p+1)/2) Gamma((q+1)/2) / (2 Gamma((p+q)/2 + 1))
# (Abramowitz and Stegun, 6.2.1 and 6.2.2); with q = 0 it is the factor of docs/method.md, 3 for |x|**(p-1)
# x.


def quarter(p: sympy.Expr, q: sympy.Expr) -> sympy.Expr:
    """Integrate sin**p cos**q over a quarter of a cycle; p and q real, both above -1."""
    half = sympy.Rational(1, 2)
    return sympy.gamma((p + 1) * half) * sympy.gamma((q + 1) * half) / (2 * sympy.gamma((p + q) * half + 1))


def over_quarters(
    m: int, p: sympy.Expr, n: int, q: sympy.Expr, only_positive_x: bool, only_positive_v: bool
) -> sympy.Expr:
    """Integrate sin**m |sin|**p cos**n |cos|**q over a cycle, or where sin (cos) is positive.

    Raises
    ------
    ExpressionError
        The integral has no finite value.
    """
    sides_x = 1 if only_positive_x else 2 * (m % 2 == 0)
    sides_v = 1 if only_positive_v else 2 * (n % 2 == 0)
    if not sides_x * sides_v:
        return sympy.S.Zero
    for power in (m + p, n + q):
        if (power <= -1) == True:  # noqa: E712 - a sympy relation, undecided is no
            raise ExpressionError(
                f"law: a power is so singular at zero that the force has no fundamental (it needs the "
                f"integral of |sin|**({power}), which is not finite); use an exponent above -2 of x or v"
            )
    return sides_x * sides_v * quarter(m + p, n + q)


# ----------------------------------------------------------------------------
# Trigonometric and exponential laws: moments integral sin(phi)**m cos(phi)**n f(z sin(phi) + c) dphi.
#
# They are Bessel functions (Jacobi-Anger expansion). With J0(z) = 1/(2 pi) integral cos(z sin(phi)) dphi and
# I0(z) = 1/(2 pi) integral exp(z sin(phi)) dphi (Abramowitz and Stegun, 9.1.18 and 9.6.16) every moment
# sin**m is a derivative in z, and derivatives of J0 and I0 are sums of J_k and I_k (9.1.31, 9.6.29).

_CIRCULAR = (sympy.sin, sympy.cos)
_EXPONENTIAL = (sympy.exp, sympy.sinh, sympy.cosh)


@dataclass(frozen=True, slots=True)
class Wave:
    """A function f(rate s + shift) of one state s, f one of sin, cos, exp, sinh, cosh."""

    kind: type
    rate: sympy.Expr
    shift: sympy.Expr


def read_wave(function: sympy.Expr, state: sympy.Symbol, other: sympy.Symbol) -> Wave | None:
    """Read f(a s + c) with a and c free of both states; None where it is something else."""
    if function.func not in _CIRCULAR + _EXPONENTIAL:
        return None
    (argument,) = function.args
    rate = argument.diff(state)
    if rate.is_zero or rate.free_symbols & {state, other}:
        return None
    shift = sympy.expand_mul(argument - rate * state)
    return None if shift.free_symbols & {state, other} else Wave(function.func, rate, shift)


def _split(kind: type, shift: sympy.Expr) -> list[tuple[sympy.Expr, type]]:
    """Take the shift out by the addition theorems: f(z s + shift) as a sum of waves in z s."""
    if shift == 0:
        return [(sympy.S.One, kind)]
    if kind is sympy.exp:
        return [(sympy.exp(shift), sympy.exp)]
    odd, even = (sympy.sin, sympy.cos) if kind in _CIRCULAR else (sympy.sinh, sympy.cosh)
    if kind is odd:
        return [(even(shift), odd), (odd(shift), even)]
    return [(even(shift), even), (odd(shift) * (-1 if kind in _CIRCULAR else 1), odd)]


def _derivative(kind: type, order: int, z: sympy.Expr) -> sympy.Expr:
    """Differentiate J0 or I0 ``order`` times."""
    total = sympy.S.Zero
    for r in range(order + 1):
        index = 2 * r - order
        if kind in _CIRCULAR:
            bessel = (-1) ** (r + max(-index, 0)) * sympy.besselj(abs(index), z)
        else:
            bessel = sympy.besseli(abs(index), z)
        total += sympy.binomial(order, r) * bessel
    return total / 2**order


def _over_cycle(kind: type, m: int, z: sympy.Expr) -> sympy.Expr:
    """Integrate sin**m f(z sin(phi)) over a cycle."""
    odd = m % 2
    if kind in ((sympy.cos, sympy.cosh) if odd else (sympy.sin, sympy.sinh)):
        # odd in s, so that both signs of s cancel
        return sympy.S.Zero
    sign = (-1) ** ((m + odd) // 2) if kind in _CIRCULAR else 1
    return 2 * sympy.pi * sign * _derivative(kind, m, z)


def moment(wave: Wave, size: sympy.Expr, mean: sympy.Expr, m: int, n: int) -> sympy.Expr:
    """Integrate sin**m cos**n f(rate (mean + size sin(phi)) + shift) over a cycle."""
    if n % 2:
        return sympy.S.Zero
    z = wave.rate * size
    shift = sympy.expand_mul(wave.rate * mean + wave.shift)
    negative = z.could_extract_minus_sign()
    z = -z if negative else z
    s = sympy.Symbol("s")
    weight = sympy.Poly(s**m * (1 - s**2) ** (n // 2), s)
    total = sympy.S.Zero
    for factor, kind in _split(wave.kind, shift):
        flip = -1 if negative and kind in (sympy.sin, sympy.sinh) else 1
        for (power,), number in weight.terms():
            mirrored = (-1) ** power if negative and kind is sympy.exp else 1
            total += factor * flip * mirrored * number * _over_cycle(kind, power, z)
    return total


# ----------------------------------------------------------------------------
# Which terms have closed forms: reading one addend of a piece, and its integrals over the cycle.

MAX_POWER = 40
"""Largest whole power of x or v with a closed form; the formula of a larger one would be pages long."""

Moment = Callable[[int, int], sympy.Expr]
"""integral of sin**i cos**j, times the other factors of an addend, for (i, j)."""


@dataclass(frozen=True, slots=True)
class Addend:
    """coefficient x**m |x|**p v**n |v|**q times a wave in x or in v."""

    coefficient: sympy.Expr
    m: int
    p: sympy.Expr
    n: int
    q: sympy.Expr
    wave_x: Wave | None
    wave_v: Wave | None

    def integral(self, arc: Arc, mean: sympy.Expr, i: int, j: int) -> sympy.Expr | None:
        """Integrate the addend times sin**i cos**j over an arc; None if there is no closed form."""
        real_powers = not (self.p.is_zero and self.q.is_zero)
        moment: Moment | None = None
        if wave := self.wave_x or self.wave_v:
            if not real_powers and arc.x is None and arc.v is None:
                moment = self._wave_moment(wave, mean)
        else:
            moment = self._quarters(arc, mean) if real_powers else partial(integral_over, arc)
        return None if moment is None else self._expanded(moment, mean, i, j)

    def _expanded(self, moment: Moment, mean: sympy.Expr, i: int, j: int) -> sympy.Expr:
        """Sum over the binomial expansion of (X0 + X sin)**m."""
        total = sympy.S.Zero
        speed = (OMEGA * X) ** (self.n + self.q)
        for r in range(self.m + 1):
            if r < self.m and mean == 0:
                continue
            part = moment(r + i, self.n + j)
            total += sympy.binomial(self.m, r) * mean ** (self.m - r) * X ** (r + self.p) * part
        return self.coefficient * speed * total

    def _quarters(self, arc: Arc, mean: sympy.Expr) -> Moment | None:
        centred_switch = arc.x is None or (arc.x.is_zero and mean == 0)
        if not centred_switch or not (arc.v is None or arc.v.is_zero):
            return None
        if mean != 0 and not self.p.is_zero:
            return None
        return lambda i, j: over_quarters(i, self.p, j, self.q, arc.x is not None, arc.v is not None)

    def _wave_moment(self, wave: Wave, mean: sympy.Expr) -> Moment:
        if self.wave_x is not None:
            return partial(moment, wave, X, mean)
        # v = omega X cos(phi): a quarter of a cycle later sine and cosine have changed places
        return lambda i, j: moment(wave, OMEGA * X, sympy.S.Zero, j, i)


def read_addend(addend: sympy.Expr) -> Addend | None:
    """Read one product of a piece; None where a factor is none of the known kinds."""
    coefficient, moving = addend.as_independent(STATE_X, STATE_V, as_Add=False)
    integers = {STATE_X: 0, STATE_V: 0}
    reals = {STATE_X: sympy.S.Zero, STATE_V: sympy.S.Zero}
    waves: dict[sympy.Symbol, Wave] = {}
    for factor in sympy.Mul.make_args(moving):
        base, exponent = (factor, sympy.S.One) if factor.func is sympy.exp else factor.as_base_exp()
        if not _read_factor(base, exponent, integers, reals, waves):
            return None
    for state, power in integers.items():
        if power < 0:
            integers[state] = power % 2
            reals[state] += power - power % 2
    if max(integers.values()) > MAX_POWER:
        return None
    return Addend(
        coefficient, integers[STATE_X], reals[STATE_X], integers[STATE_V], reals[STATE_V],
        waves.get(STATE_X), waves.get(STATE_V),
    )  # fmt: skip


def _read_factor(
    base: sympy.Expr,
    exponent: sympy.Expr,
    integers: dict[sympy.Symbol, int],
    reals: dict[sympy.Symbol, sympy.Expr],
    waves: dict[sympy.Symbol, Wave],
) -> bool:
    """Enter a factor as an integer power of a state, a real power of its modulus, or a wave, if it is one."""
    if base == 1:
        return True
    if base in integers and exponent.is_Integer:
        integers[base] += int(exponent)
        return True
    if isinstance(base, sympy.Abs) and base.args[0] in integers and not exponent.free_symbols & set(integers):
        reals[base.args[0]] += exponent
        return True
    if exponent != 1 or waves:
        return False
    for state, other in ((STATE_X, STATE_V), (STATE_V, STATE_X)):
        wave = read_wave(base, state, other)
        if wave is not None:
            waves[state] = wave
            return True
    return False


# ----------------------------------------------------------------------------
# Powers of sine and cosine over the part of a cycle on which a piece acts.
#
# On x = X0 + X sin(phi), v = omega X cos(phi) a switch x - b is on for phi in (alpha, pi - alpha) with
# alpha = asin(clip((b - X0)/X)), a switch v - w for phi in (-beta, beta) with beta = acos(clip(w/(omega
# X))).
# Every piece integrates to a polynomial in the angle, sine and cosine of these ends. The ends stay symbols
# ("atoms") until it is known whether a number, a regime or a formula is wanted.


class End(NamedTuple):
    """One end of an arc: the angle and its sine and cosine."""

    angle: sympy.Expr
    sine: sympy.Expr
    cosine: sympy.Expr


def _atoms(name: str) -> End:
    return End(*(sympy.Symbol(f"{part}_{name}", real=True) for part in ("angle", "sine", "cosine")))


@dataclass(frozen=True, slots=True)
class Arc:
    """Where a pair of switches is on: thresholds in x and v (None: no switch), atoms, pairs of ends.

    ``x_end`` is the rising end of the x-switch, ``v_end`` the falling end of the v-switch.
    """

    x: sympy.Expr | None
    v: sympy.Expr | None
    x_end: End | None
    v_end: End | None
    spans: tuple[tuple[End, End], ...]


_TOP = End(sympy.pi / 2, sympy.S.One, sympy.S.Zero)
_CENTRE = End(sympy.S.Zero, sympy.S.Zero, sympy.S.One)


@lru_cache(maxsize=1024)
def make_arc(x: sympy.Expr | None, v: sympy.Expr | None, centred: bool) -> Arc | None:
    """Find the arcs of a piece; ``centred`` says that the mean X0 is zero."""
    x_end = None if x is None else _CENTRE if centred and x.is_zero else _atoms(f"x[{x}]")
    v_end = None if v is None else _TOP if v.is_zero else _atoms(f"v[{v}]")
    spans: tuple[tuple[End, End], ...]
    if x_end is None and v_end is None:
        bottom = End(-sympy.pi / 2, -sympy.S.One, sympy.S.Zero)
        spans = ((bottom, End(3 * sympy.pi / 2, -sympy.S.One, sympy.S.Zero)),)
    elif v_end is None and x_end is not None:
        # it falls at pi - alpha
        spans = ((x_end, End(sympy.pi - x_end.angle, x_end.sine, -x_end.cosine)),)
    elif x_end is None and v_end is not None:
        # it rises at -beta
        spans = ((End(-v_end.angle, -v_end.sine, v_end.cosine), v_end),)
    elif v_end is _TOP and x_end is not None:
        spans = ((x_end, _TOP),)
    else:
        # two general switches at once: quadrature integrates them
        return None
    return Arc(x, v, x_end, v_end, spans)


_ANGLE, _SINE, _COSINE = sympy.symbols("angle sine cosine", real=True)


@lru_cache(maxsize=4096)
def antiderivative(m: int, n: int) -> sympy.Expr:
    """Integrate sin**m cos**n, as a polynomial in the angle, its sine and its cosine."""
    if n % 2 or m % 2:
        # by powers of the other one, whose derivative the odd power has
        odd, other, base, sign = (n, m, _SINE, 1) if n % 2 else (m, n, _COSINE, -1)
        parts = ((sympy.binomial(odd // 2, r) * (-1) ** r, other + 2 * r + 1) for r in range(odd // 2 + 1))
        return sign * sympy.Add(*(factor * base**power / power for factor, power in parts))
    if m:
        return sympy.expand(
            -(_SINE ** (m - 1)) * _COSINE ** (n + 1) / (m + n)
            + sympy.Rational(m - 1, m + n) * antiderivative(m - 2, n)
        )
    if n:
        return sympy.expand(
            _COSINE ** (n - 1) * _SINE / n + sympy.Rational(n - 1, n) * antiderivative(0, n - 2)
        )
    return _ANGLE


@lru_cache(maxsize=4096)
def integral_over(arc: Arc, m: int, n: int) -> sympy.Expr:
    """Integrate sin**m cos**n over the arcs of a piece."""
    primitive = antiderivative(m, n)
    total = sympy.S.Zero
    for start, stop in arc.spans:
        for end, sign in ((stop, 1), (start, -1)):
            places = dict(zip((_ANGLE, _SINE, _COSINE), end, strict=True))
            total += sign * primitive.xreplace(places)
    return sympy.expand(total)


MAX_TERMS = 150
"""Largest number of terms of a closed form; a longer one would take many seconds, quadrature less."""

Triple = tuple[sympy.Expr, ...]
"""Stiffness [N/m], damping [N s/m] and mean force [N]."""


@dataclass(frozen=True, slots=True)
class ClosedPart:
    """Sums over the pieces of a law, by the arc on which they act; formulas in the atoms of their arcs."""

    parts: tuple[tuple[Arc, Triple], ...]
    mean: sympy.Expr

    @property
    def total(self) -> Triple:
        """The sum over all arcs, in atoms."""
        return tuple(sympy.Add(*(triple[place] for _, triple in self.parts)) for place in range(3))

    def evaluate(
        self, X_: Array, mean: Array, omega: Array, values: Mapping[sympy.Symbol, Array]
    ) -> list[Array]:
        """Return stiffness, damping and mean force as arrays; all inputs broadcast against each other."""
        names = tuple(values)
        atoms: dict[sympy.Symbol, Array] = {}
        for arc, _ in self.parts:
            _place_atoms(arc, X_, mean, omega, names, tuple(values.values()), atoms)
        arguments = (X, X0, OMEGA, *names, *atoms)
        results = compiled(self.total, arguments)(X_, mean, omega, *values.values(), *atoms.values())
        shape = np.broadcast_shapes(X_.shape, mean.shape, omega.shape, *(v.shape for v in values.values()))
        return [np.broadcast_to(result, shape) for result in results]


def _place_atoms(
    arc: Arc,
    X_: Array,
    mean: Array,
    omega: Array,
    names: tuple[sympy.Symbol, ...],
    values: tuple[Array, ...],
    atoms: dict[sympy.Symbol, Array],
) -> None:
    """Compute the ends of an arc and enter them under their symbols."""

    def enter(end: End, angle: Array, sine: Array, cosine: Array) -> None:
        for place, value in zip(end, (angle, sine, cosine), strict=True):
            if isinstance(place, sympy.Symbol):
                atoms[place] = value

    with np.errstate(all="ignore"):
        if arc.x_end is not None and arc.x is not None:
            (threshold,) = compiled((arc.x,), names)(*values)
            sine = np.clip((threshold - mean) / X_, -1, 1)
            alpha = np.arcsin(sine)
            enter(arc.x_end, alpha, sine, np.sqrt((1 - sine) * (1 + sine)))
        if arc.v_end is not None and arc.v is not None:
            (threshold,) = compiled((arc.v,), names)(*values)
            cosine = np.clip(threshold / (omega * X_), -1, 1)
            beta = np.arccos(cosine)
            enter(arc.v_end, beta, np.sqrt((1 - cosine) * (1 + cosine)), cosine)


def close(form: NormalForm, mean: sympy.Expr) -> ClosedPart | None:
    """Find the closed form of all pieces of a law; None where one addend has none.

    Parameters
    ----------
    form
        Normal form of the law.
    mean
        X0, or zero for a law known to move about zero.
    """
    parts: dict[Arc, list[Triple]] = {}
    levels = [s.threshold for s in form.switches if s.threshold is not None]
    if any(e.has(sympy.Piecewise) for e in (*levels, *(piece.term for piece in form.pieces))):
        # thresholds that are cases of parameters make formulas too long to read, and slowly
        return None
    length = 0
    for piece in form.pieces:
        places: dict[str, sympy.Expr] = {}
        for switch in piece.switches:
            if switch.variable is None or switch.threshold is None:
                return None
            places[switch.variable] = switch.threshold
        arc = make_arc(places.get("x"), places.get("v"), mean == 0)
        if arc is None:
            return None
        length += _length(piece.term, arc)
        if length > MAX_TERMS:
            return None
        for addend in sympy.Add.make_args(piece.term):
            triple = _triple(addend, arc, mean)
            if triple is None:
                return None
            parts.setdefault(arc, []).append(triple)
    summed = (tuple(sympy.Add(*column) for column in zip(*own, strict=True)) for own in parts.values())
    return ClosedPart(tuple(zip(parts, summed, strict=True)), mean)


def _length(term: sympy.Expr, arc: Arc) -> int:
    """Count the terms of the formula of a piece, before they are sorted by angles and roots."""
    moving = {
        end for end in (arc.x_end, arc.v_end) if end is not None and isinstance(end.angle, sympy.Symbol)
    }
    length = 0
    for addend in sympy.Add.make_args(term):
        degrees = [addend.as_coeff_exponent(state)[1] for state in (STATE_X, STATE_V)]
        m, n = (int(degree) if degree.is_Integer and degree > 0 else 0 for degree in degrees)
        length += (1 + m) * (1 + n) if moving else 1
    return length


def _triple(addend: sympy.Expr, arc: Arc, mean: sympy.Expr) -> Triple | None:
    read = read_addend(addend)
    if read is None:
        return None
    sine, cosine, constant = (read.integral(arc, mean, i, j) for i, j in ((1, 0), (0, 1), (0, 0)))
    if sine is None or cosine is None or constant is None:
        return None
    weights = (1 / (sympy.pi * X), 1 / (sympy.pi * OMEGA * X), 1 / (2 * sympy.pi))
    parts = zip(weights, (sine, cosine, constant), strict=True)
    return tuple(sympy.expand_mul(weight * part) for weight, part in parts)
