"""Moments integral sin(phi)**m cos(phi)**n f(z sin(phi) + c) dphi of trigonometric and exponential laws.

They are Bessel functions (Jacobi-Anger expansion).

With J0(z) = 1/(2 pi) integral cos(z sin(phi)) dphi and I0(z) = 1/(2 pi) integral exp(z sin(phi)) dphi
(Abramowitz and Stegun, 9.1.18 and 9.6.16) every moment sin**m is a derivative in z, and derivatives of J0
and I0 are sums of J_k and I_k (9.1.31, 9.6.29).
"""

from __future__ import annotations

from dataclasses import dataclass

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
