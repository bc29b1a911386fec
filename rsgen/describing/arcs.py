"""Powers of sine and cosine over the part of a cycle on which a piece acts.

On x = X0 + X sin(phi), v = omega X cos(phi) a switch x - b is on for phi in (alpha, pi - alpha) with
alpha = asin(clip((b - X0)/X)), a switch v - w for phi in (-beta, beta) with beta = acos(clip(w/(omega X))).
Every piece integrates to a polynomial in the angle, sine and cosine of these ends. The ends stay symbols
("atoms") until it is known whether a number, a regime or a formula is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import sympy

__all__ = ["Arc", "End", "antiderivative", "integral_over", "make_arc"]


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

    ``x_end`` is the rising end of the x-switch, ``v_end`` the falling end of the v-switch. ``both`` holds the
    four ends of the (at most two) arcs on which two general switches are on together.
    """

    x: sympy.Expr | None
    v: sympy.Expr | None
    x_end: End | None
    v_end: End | None
    both: tuple[End, ...]
    spans: tuple[tuple[End, End], ...]


_TOP = End(sympy.pi / 2, sympy.S.One, sympy.S.Zero)
_CENTRE = End(sympy.S.Zero, sympy.S.Zero, sympy.S.One)


def _mirrored(end: End) -> End:
    """Give the falling end pi - alpha of an x-switch."""
    return End(sympy.pi - end.angle, end.sine, -end.cosine)


def _negated(end: End) -> End:
    """Give the rising end -beta of a v-switch."""
    return End(-end.angle, -end.sine, end.cosine)


@lru_cache(maxsize=1024)
def make_arc(x: sympy.Expr | None, v: sympy.Expr | None, centred: bool) -> Arc:
    """Find the arcs of a piece; ``centred`` says that the mean X0 is zero."""
    x_end = None if x is None else _CENTRE if centred and x.is_zero else _atoms(f"x[{x}]")
    v_end = None if v is None else _TOP if v.is_zero else _atoms(f"v[{v}]")
    both: tuple[End, ...] = ()
    spans: tuple[tuple[End, End], ...]
    if x_end is None and v_end is None:
        bottom = End(-sympy.pi / 2, -sympy.S.One, sympy.S.Zero)
        spans = ((bottom, End(3 * sympy.pi / 2, -sympy.S.One, sympy.S.Zero)),)
    elif v_end is None and x_end is not None:
        spans = ((x_end, _mirrored(x_end)),)
    elif x_end is None and v_end is not None:
        spans = ((_negated(v_end), v_end),)
    elif v_end is _TOP and x_end is not None:
        spans = ((x_end, _TOP),)
    else:
        both = tuple(_atoms(f"{place}[{x}, {v}]") for place in ("from1", "to1", "from2", "to2"))
        spans = ((both[0], both[1]), (both[2], both[3]))
    return Arc(x, v, x_end, v_end, both, spans)


_ANGLE, _SINE, _COSINE = sympy.symbols("angle sine cosine", real=True)


@lru_cache(maxsize=4096)
def antiderivative(m: int, n: int) -> sympy.Expr:
    """Integrate sin**m cos**n, as a polynomial in the angle, its sine and its cosine."""
    if n % 2:
        k = (n - 1) // 2
        return sympy.Add(
            *(
                sympy.binomial(k, r) * (-1) ** r * _SINE ** (m + 2 * r + 1) / (m + 2 * r + 1)
                for r in range(k + 1)
            )
        )
    if m % 2:
        k = (m - 1) // 2
        return -sympy.Add(
            *(
                sympy.binomial(k, r) * (-1) ** r * _COSINE ** (n + 2 * r + 1) / (n + 2 * r + 1)
                for r in range(k + 1)
            )
        )
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
