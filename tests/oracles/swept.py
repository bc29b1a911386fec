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
def _integrate(n: Any, m: float, force: Any, h: float, keep: int) -> Any:
    """Runge and Kutta from rest: x at every ``keep``-th step, the force at ends and middles of steps."""
    steps = len(force) // 2
    out = np.empty(steps // keep + 1)
    x = v = 0.0
    for i in range(steps):
        if i % keep == 0:
            out[i // keep] = x
        begin, middle, end = force[2 * i], force[2 * i + 1], force[2 * i + 2]
        a1 = (begin - n(x, v)) / m
        v2 = v + h / 2 * a1
        a2 = (middle - n(x + h / 2 * v, v2)) / m
        v3 = v + h / 2 * a2
        a3 = (middle - n(x + h / 2 * v2, v3)) / m
        v4 = v + h * a3
        a4 = (end - n(x + h * v3, v4)) / m
        x, v = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    out[-1] = x
    return out


def sweep(oscillator: Oscillator, level: float, law: SweepLaw, stop: float, rate: float = 0.0) -> TimeHistory:
    """Sweep from law.frequency at t = 0 to ``stop`` [Hz]; ``rate`` is the sampling rate [Hz]."""
    highest = max(stop, law.frequency)
    rate = rate or 32 * highest
    keep = max(1, int(np.ceil(STEPS * highest / rate)))
    count = int(law.time_of(stop) * rate)
    t = np.arange(2 * count * keep + 1) / (2 * rate * keep)
    if law.kind == "logarithmic":
        g = np.log(2.0) * law.rate
        force = level * np.cos(2 * np.pi * law.frequency / g * np.expm1(g * t))
    else:
        force = level * np.cos(2 * np.pi * t * (law.frequency + 0.5 * law.rate * t))
    x = _integrate(compiled(oscillator), oscillator.mass, force, 1 / (rate * keep), keep)[:count]
    return TimeHistory(rate, force[: -1 : 2 * keep].copy(), x, level=level, label=f"{level:g} N")


def driven(oscillator: Oscillator, force: np.ndarray, rate: float) -> np.ndarray:
    """Displacement under a force given by samples, straight lines between them."""
    fine = 8
    places = np.arange(2 * fine * (len(force) - 1) + 1) / (2 * fine)
    between = np.interp(places, np.arange(len(force)), np.asarray(force))
    return _integrate(compiled(oscillator), oscillator.mass, between, 1 / rate / fine, fine)
