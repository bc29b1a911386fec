"""Swept-sine tests of an oscillator by a separate Runge-Kutta integration, without the kernel."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numba
import numpy as np
import sympy

from rsgen.data.history import SweepLaw, TimeHistory
from rsgen.data.oscillator import Oscillator

STEPS = 512
"""Integration steps a period of the highest frequency: corners and friction are passed over, not located."""


def compiled(oscillator: Oscillator) -> Callable[[float, float], float]:
    return _compiled(oscillator.force, tuple(oscillator.values.items()))


@lru_cache(maxsize=64)
def _compiled(force: sympy.Expr, values: tuple[tuple[str, float], ...]) -> Callable[[float, float], float]:
    # never dropped: compiled functions that are dropped while others are compiled have crashed numba
    x, v = sympy.symbols("x v", real=True)
    known = dict(values)
    named = {free: {"x": x, "v": v}.get(free.name) or known[free.name] for free in force.free_symbols}
    return numba.njit(sympy.lambdify((x, v), force.subs(named), "math"))


@numba.njit
def _step(n: Any, m: float, x: float, v: float, begin: float, middle: float, end: float, h: float):
    """One step of Runge and Kutta; the force at its begin, middle and end."""
    a1 = (begin - n(x, v)) / m
    v2 = v + h / 2 * a1
    a2 = (middle - n(x + h / 2 * v, v2)) / m
    v3 = v + h / 2 * a2
    a3 = (middle - n(x + h / 2 * v2, v3)) / m
    v4 = v + h * a3
    a4 = (end - n(x + h * v3, v4)) / m
    return x + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


@numba.njit
def _integrate(n, m, F, f0, rate, logarithmic, h, keep, count) -> Any:
    out = np.empty((count, 2))
    x = v = 0.0

    def force(t: float) -> float:
        if logarithmic:
            g = np.log(2.0) * rate
            return F * np.cos(2 * np.pi * f0 / g * np.expm1(g * t))
        return F * np.cos(2 * np.pi * t * (f0 + 0.5 * rate * t))

    for i in range(count * keep):
        t = i * h
        begin = force(t)
        if i % keep == 0:
            out[i // keep, 0] = begin
            out[i // keep, 1] = x
        middle, end = force(t + h / 2), force(t + h)
        x, v = _step(n, m, x, v, begin, middle, end, h)
    return out


def sweep(oscillator: Oscillator, level: float, law: SweepLaw, stop: float, rate: float = 0.0) -> TimeHistory:
    """Sweep from law.frequency at t = 0 to ``stop`` [Hz]; ``rate`` is the sampling rate [Hz]."""
    highest = max(stop, law.frequency)
    rate = rate or 32 * highest
    keep = max(1, int(np.ceil(STEPS * highest / rate)))
    count = int(law.time_of(stop) * rate)
    table = _integrate(
        compiled(oscillator), oscillator.mass, level, law.frequency, law.rate, law.kind == "logarithmic",
        1 / (rate * keep), keep, count,
    )  # fmt: skip
    return TimeHistory(rate, table[:, 0].copy(), table[:, 1].copy(), level=level, label=f"{level:g} N")


@numba.njit
def _follow(n: Any, m: float, force: Any, h: float, fine: int) -> Any:
    out = np.zeros(len(force))
    x = v = 0.0
    for i in range(len(force) - 1):
        out[i] = x
        step = (force[i + 1] - force[i]) / fine
        for j in range(fine):
            begin, middle, end = force[i] + j * step, force[i] + (j + 0.5) * step, force[i] + (j + 1) * step
            x, v = _step(n, m, x, v, begin, middle, end, h)
    out[-1] = x
    return out


def driven(oscillator: Oscillator, force: np.ndarray, rate: float) -> np.ndarray:
    """Displacement under a force given by samples, straight lines between them."""
    fine = 8
    return _follow(compiled(oscillator), oscillator.mass, np.asarray(force), 1 / rate / fine, fine)
