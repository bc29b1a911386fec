"""Moments integral sin(phi)**m cos(phi)**n f(z sin(phi) + c) dphi of trigonometric and exponential laws.

They are Bessel functions (Jacobi-Anger expansion).
With J0(z) = 1/(2 pi) integral cos(z sin(phi)) dphi and I0(z) = 1/(2 pi) integral exp(z sin(phi)) dphi
(Abramowitz and Stegun, 9.1.18 and 9.6.16) every moment sin**m is a derivative in z, and derivatives of J0
and I0 are sums of J_k and I_k (9.1.31, 9.6.29). Over the half of a cycle with positive cosine an odd power
of cosine makes the moment an integral over s = sin(phi), which Legendre polynomials turn into Bessel
functions of half-integer order (10.1.14, 10.2.36); written so it keeps all digits for small amplitudes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product

import sympy

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


def product_of_waves(waves: list[Wave]) -> list[tuple[sympy.Expr, Wave]] | None:
    """Write a product of waves as a sum of single ones; None where circular and exponential ones meet."""
    if len(waves) == 1:
        return [(sympy.S.One, waves[0])]
    if all(wave.kind in _CIRCULAR for wave in waves):
        sums = [(sympy.S.One, waves[0])]
        for wave in waves[1:]:
            sums = [(a * b, single) for a, first in sums for b, single in _beat(first, wave)]
        return sums
    if any(wave.kind in _CIRCULAR for wave in waves):
        return None
    return [
        (
            sympy.Mul(*(factor for factor, _ in parts)),
            Wave(
                sympy.exp,
                sympy.Add(*(wave.rate for _, wave in parts)),
                sympy.Add(*(wave.shift for _, wave in parts)),
            ),
        )
        for parts in product(*map(_exponentials, waves))
    ]


def _exponentials(wave: Wave) -> list[tuple[sympy.Expr, Wave]]:
    if wave.kind is sympy.exp:
        return [(sympy.S.One, wave)]
    falling = sympy.S.Half if wave.kind is sympy.cosh else -sympy.S.Half
    return [
        (sympy.S.Half, Wave(sympy.exp, wave.rate, wave.shift)),
        (falling, Wave(sympy.exp, -wave.rate, -wave.shift)),
    ]


def _beat(left: Wave, right: Wave) -> list[tuple[sympy.Expr, Wave]]:
    """Write a product of sines and cosines as sum and difference."""
    plus = (left.rate + right.rate, left.shift + right.shift)
    minus = (left.rate - right.rate, left.shift - right.shift)
    if left.kind is right.kind:
        sign = 1 if left.kind is sympy.cos else -1
        return [(sympy.S.Half, Wave(sympy.cos, *minus)), (sign * sympy.S.Half, Wave(sympy.cos, *plus))]
    sign = 1 if left.kind is sympy.sin else -1
    return [(sympy.S.Half, Wave(sympy.sin, *plus)), (sign * sympy.S.Half, Wave(sympy.sin, *minus))]


def _split(kind: type, shift: sympy.Expr) -> list[tuple[sympy.Expr, type]]:
    """Take the shift out by the addition theorems: f(z s + shift) as a sum of waves in z s."""
    if shift == 0:
        return [(sympy.S.One, kind)]
    if kind is sympy.exp:
        return [(sympy.exp(shift), sympy.exp)]
    if kind is sympy.sin:
        return [(sympy.cos(shift), sympy.sin), (sympy.sin(shift), sympy.cos)]
    if kind is sympy.cos:
        return [(sympy.cos(shift), sympy.cos), (-sympy.sin(shift), sympy.sin)]
    if kind is sympy.sinh:
        return [(sympy.cosh(shift), sympy.sinh), (sympy.sinh(shift), sympy.cosh)]
    return [(sympy.cosh(shift), sympy.cosh), (sympy.sinh(shift), sympy.sinh)]


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


def _integrand_is_odd(kind: type, power: int) -> bool:
    """Decide whether s**power f(z s) is odd in s, so that its integral over both signs of s is zero."""
    return kind in ((sympy.cos, sympy.cosh) if power % 2 else (sympy.sin, sympy.sinh))


def _over_cycle(kind: type, m: int, z: sympy.Expr) -> sympy.Expr:
    """Integrate sin**m f(z sin(phi)) over a cycle."""
    odd = m % 2
    if _integrand_is_odd(kind, m):
        return sympy.S.Zero
    sign = (-1) ** ((m + odd) // 2) if kind in _CIRCULAR else 1
    return 2 * sympy.pi * sign * _derivative(kind, m, z)


def _over_side(kind: type, polynomial: sympy.Poly, z: sympy.Expr) -> sympy.Expr:
    """Integrate a polynomial in s times f(z s) over -1 < s < 1; z positive."""
    total, rest = sympy.S.Zero, polynomial
    while not rest.is_zero:
        degree = rest.degree()
        legendre = sympy.Poly(sympy.legendre(degree, rest.gen), rest.gen)
        factor = rest.LC() / legendre.LC()
        rest = rest - factor * legendre
        odd = degree % 2
        if _integrand_is_odd(kind, degree):
            continue
        if kind in _CIRCULAR:
            spherical = (-1) ** ((degree - odd) // 2) * sympy.besselj(degree + sympy.S.Half, z)
        else:
            spherical = sympy.besseli(degree + sympy.S.Half, z)
        total += factor * sympy.sqrt(2 * sympy.pi / z) * spherical
    return total


def elementary(formula: sympy.Expr) -> sympy.Expr:
    """Write Bessel functions of half-integer order with sin, cos, sinh, cosh.

    The recurrence f_(n+1) = (2 n + 1)/z f_n - f_(n-1), for besseli with the other sign, begins with sin(z)/z
    (Abramowitz and Stegun, 10.1.11, 10.2.13). For display only: small arguments lose digits in it.
    """

    def written(kind: type, order: sympy.Expr, z: sympy.Expr) -> sympy.Expr:
        if not (order - sympy.S.Half).is_Integer:
            return kind(order, z)
        sine, cosine, sign = (
            (sympy.sin, sympy.cos, 1) if kind is sympy.besselj else (sympy.sinh, sympy.cosh, -1)
        )
        previous, current = cosine(z) / z, sine(z) / z
        for n in range(int(order - sympy.S.Half)):
            previous, current = current, sympy.expand(sign * ((2 * n + 1) / z * current - previous))
        return sympy.sqrt(2 * z / sympy.pi) * current

    for kind in (sympy.besselj, sympy.besseli):
        formula = formula.replace(kind, partial(written, kind))
    return formula


def moment(wave: Wave, size: sympy.Expr, mean: sympy.Expr, m: int, n: int, half: bool) -> sympy.Expr | None:
    """Integrate sin**m cos**n f(rate (mean + size sin(phi)) + shift) over a cycle.

    ``half`` keeps the part of the cycle with positive cosine. None where the sign of ``rate`` must be known
    for a formula and is not.
    """
    z = wave.rate * size
    shift = sympy.expand_mul(wave.rate * mean + wave.shift)
    if z == 0:
        return None
    negative = z.could_extract_minus_sign()
    z = -z if negative else z
    s = sympy.Symbol("s")
    total = sympy.S.Zero
    for factor, kind in _split(wave.kind, shift):
        flip = -1 if negative and kind in (sympy.sin, sympy.sinh) else 1
        if n % 2 == 0:
            weight = sympy.Poly(s**m * (1 - s**2) ** (n // 2), s)
            for (power,), number in weight.terms():
                mirrored = (-1) ** power if negative and kind is sympy.exp else 1
                total += factor * flip * mirrored * number * _over_cycle(kind, power, z) / (2 if half else 1)
        elif half:
            if not z.is_positive:
                return None
            side = -s if negative and kind is sympy.exp else s
            weight = sympy.Poly((side**m * (1 - s**2) ** ((n - 1) // 2)), s)
            total += factor * flip * _over_side(kind, weight, z)
    return total
