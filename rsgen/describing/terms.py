"""Which terms have closed forms: reading one addend of a piece, and its integrals over the cycle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import sympy

from rsgen.describing.arcs import Arc, integral_over
from rsgen.describing.bessel import Wave, moment, product_of_waves, read_wave
from rsgen.describing.powers import over_quarters
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X

__all__ = ["HIGHEST_POWER", "Addend", "read_addend"]


HIGHEST_POWER = 40
"""Whole powers beyond are left to quadrature: their formulas would be pages long."""

MOST_WAVES = 6

Weighted = Callable[[int, int], sympy.Expr | None]


@dataclass(frozen=True, slots=True)
class Addend:
    """coefficient x**m |x|**p v**n |v|**q times waves in x and waves in v."""

    coefficient: sympy.Expr
    m: int
    p: sympy.Expr
    n: int
    q: sympy.Expr
    waves_x: tuple[Wave, ...]
    waves_v: tuple[Wave, ...]

    def integral(self, arc: Arc, mean: sympy.Expr, i: int, j: int) -> sympy.Expr | None:
        """Integrate the addend times sin**i cos**j over an arc; None without a closed form."""
        real_powers = not (self.p.is_zero and self.q.is_zero)
        if self.waves_x or self.waves_v:
            return None if real_powers else self._waves(arc, mean, i, j)
        weighted = self._quarters(arc, mean) if real_powers else self._powers(arc)
        return None if weighted is None else self._expanded(weighted, mean, i, j)

    def _expanded(self, weighted: Weighted, mean: sympy.Expr, i: int, j: int) -> sympy.Expr | None:
        """Sum over the binomial expansion of (X0 + X sin)**m."""
        total = sympy.S.Zero
        speed = (OMEGA * X) ** (self.n + self.q)
        for r in range(self.m + 1):
            if r < self.m and mean == 0:
                continue
            part = weighted(r + i, self.n + j)
            if part is None:
                return None
            total += sympy.binomial(self.m, r) * mean ** (self.m - r) * X ** (r + self.p) * part
        return self.coefficient * speed * total

    @staticmethod
    def _powers(arc: Arc) -> Weighted:
        return lambda i, j: integral_over(arc, i, j)

    def _quarters(self, arc: Arc, mean: sympy.Expr) -> Weighted | None:
        centred_switch = arc.x is None or (arc.x.is_zero and mean == 0)
        if not centred_switch or not (arc.v is None or arc.v.is_zero):
            return None
        if mean != 0 and not self.p.is_zero:
            return None
        return lambda i, j: over_quarters(i, self.p, j, self.q, arc.x is not None, arc.v is not None)

    def _waves(self, arc: Arc, mean: sympy.Expr, i: int, j: int) -> sympy.Expr | None:
        if self.waves_x and self.waves_v:
            return None
        in_x = bool(self.waves_x)
        fixed, halved = (arc.x, arc.v) if in_x else (arc.v, arc.x)
        if fixed is not None or not (halved is None or halved.is_zero):
            return None
        if not in_x and halved is not None and mean != 0:
            return None
        sums = product_of_waves(list(self.waves_x or self.waves_v))
        if sums is None:
            return None
        constant = Addend(self.coefficient, self.m, self.p, self.n, self.q, (), ())
        total = sympy.S.Zero
        for factor, wave in sums:
            if wave.rate == 0:
                rest = constant.integral(arc, mean, i, j)
                value = None if rest is None else rest * wave.kind(wave.shift)
            else:
                value = constant._expanded(_weighted(wave, in_x, mean, halved is not None), mean, i, j)
            if value is None:
                return None
            total += factor * value
        return total


def _weighted(wave: Wave, in_x: bool, mean: sympy.Expr, half: bool) -> Weighted:
    if in_x:
        return lambda i, j: moment(wave, X, mean, i, j, half)
    # v = omega X cos(phi): a quarter of a cycle later sine and cosine have changed places
    return lambda i, j: moment(wave, OMEGA * X, sympy.S.Zero, j, i, half)


def read_addend(addend: sympy.Expr) -> Addend | None:
    """Read one product of a piece; None where a factor is none of the known kinds."""
    coefficient, moving = addend.as_independent(STATE_X, STATE_V, as_Add=False)
    whole = {STATE_X: 0, STATE_V: 0}
    real = {STATE_X: sympy.S.Zero, STATE_V: sympy.S.Zero}
    waves: dict[sympy.Symbol, list[Wave]] = {STATE_X: [], STATE_V: []}
    for factor in sympy.Mul.make_args(moving):
        base, exponent = (factor, sympy.S.One) if factor.func is sympy.exp else factor.as_base_exp()
        if not _read_factor(base, exponent, whole, real, waves):
            return None
    for state, power in whole.items():
        if power < 0:
            whole[state] = power % 2
            real[state] += power - power % 2
    if max(whole.values()) > HIGHEST_POWER or max(map(len, waves.values())) > MOST_WAVES:
        return None
    return Addend(
        coefficient, whole[STATE_X], real[STATE_X], whole[STATE_V], real[STATE_V],
        tuple(waves[STATE_X]), tuple(waves[STATE_V]),
    )  # fmt: skip


def _read_factor(
    base: sympy.Expr,
    exponent: sympy.Expr,
    whole: dict[sympy.Symbol, int],
    real: dict[sympy.Symbol, sympy.Expr],
    waves: dict[sympy.Symbol, list[Wave]],
) -> bool:
    if base == 1:
        return True
    if base in whole and exponent.is_Integer:
        whole[base] += int(exponent)
        return True
    if isinstance(base, sympy.Abs) and base.args[0] in whole and not exponent.free_symbols & set(whole):
        real[base.args[0]] += exponent
        return True
    if not (exponent.is_Integer and 0 < exponent <= MOST_WAVES):
        return False
    for state, other in ((STATE_X, STATE_V), (STATE_V, STATE_X)):
        wave = read_wave(base, state, other)
        if wave is not None:
            waves[state] += [wave] * int(exponent)
            return True
    return False
