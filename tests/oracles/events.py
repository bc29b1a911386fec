"""Structures with switches or memory, by DOP853 from event to event, with nothing of the kernel or the law.

A structure is a rate y' of y = (x, v, memories) in a mode, and guards of that mode: functions of force and y
whose fall through zero ends it, each with the mode that follows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-11
REPEATS = 1e-9
"""Change of the fundamental in a period, relative."""

Guard = tuple[Callable[[float, np.ndarray], float], Callable[[float, np.ndarray], Any]]


@dataclass(frozen=True)
class Structure:
    """``rate(force, y, mode)``, ``guards(mode)`` and the mode at rest under a positive force."""

    rate: Callable[[float, np.ndarray, Any], list[float]]
    guards: Callable[[Any], list[Guard]]
    mode: Any
    size: int


def bouc_wen(m: float, c: float, k: float, alpha: float, bg: float, bd: float) -> Structure:
    """z' = alpha v - bg |v| z - bd v |z|, with the signs of v and z as modes."""

    def rate(force: float, y: np.ndarray, mode: tuple[float, float]) -> list[float]:
        x, v, z = y
        return [v, (force - c * v - k * x - z) / m, alpha * v - bg * mode[0] * v * z - bd * v * mode[1] * z]

    def guards(mode: tuple[float, float]) -> list[Guard]:
        return [
            (lambda f, y: y[1] * mode[0], lambda f, y: (-mode[0], mode[1])),
            (lambda f, y: y[2] * mode[1], lambda f, y: (mode[0], -mode[1])),
        ]

    return Structure(rate, guards, (1.0, 1.0), 3)


def sliders(m: float, n: Callable[[float, float], float], stiffness: np.ndarray, limit: np.ndarray):
    """n(x, v) beside parallel elastic sliders; the mode is -1, 0 (sticks) or 1 for each."""

    def rate(force: float, y: np.ndarray, mode: tuple[int, ...]) -> list[float]:
        sticks = np.equal(mode, 0)
        return [y[1], (force - n(y[0], y[1]) - y[2:].sum()) / m, *(stiffness * y[1] * sticks)]

    def guards(mode: tuple[int, ...]) -> list[Guard]:
        def becomes(i: int, now: int) -> tuple[int, ...]:
            return (*mode[:i], now, *mode[i + 1 :])

        found: list[Guard] = []
        if any(mode):
            # all that slip stick again when the motion turns
            way = next(now for now in mode if now)
            found.append((lambda f, y: y[1] * way, lambda f, y: (0,) * len(mode)))
        for i, now in enumerate(mode):
            if now == 0:
                found.append((lambda f, y, i=i: limit[i] - y[2 + i], lambda f, y, i=i: becomes(i, 1)))
                found.append((lambda f, y, i=i: limit[i] + y[2 + i], lambda f, y, i=i: becomes(i, -1)))
        return found

    return Structure(rate, guards, (0,) * len(limit), 2 + len(limit))


@dataclass(frozen=True)
class Law:
    """n(x, v, modes); one mode a switch, a function of x and v; ``friction`` is the one that sticks."""

    n: Callable[[float, float, tuple[bool, ...]], float]
    switches: tuple[Callable[[float, float], float], ...] = ()
    friction: int | None = None

    def slides(self, x: float, modes: tuple[bool, ...], force: float) -> tuple[bool, tuple[bool, ...]]:
        """Return the mode that a force gives to a mass without speed: it sticks, or where it slides to."""
        low, high = (self.n(x, 0.0, self.turned(modes, self.friction, on)) for on in (False, True))
        return low <= force <= high, self.turned(modes, self.friction, force > high)

    def turned(self, modes: tuple[bool, ...], k: int, on: bool) -> tuple[bool, ...]:
        return (*modes[:k], on, *modes[k + 1 :])

    def mode_at(self, y: np.ndarray, force: float) -> tuple[bool, tuple[bool, ...]]:
        """Return whether the mass sticks in a state, and its modes."""
        modes = tuple(switch(*y) > 0 for switch in self.switches)
        return self.slides(y[0], modes, force) if self.friction is not None and y[1] == 0 else (False, modes)


def switched(m: float, law: Law) -> Structure:
    """A law without memory: the mode is whether the mass sticks, and which of the switches are on."""

    def rate(force: float, y: np.ndarray, mode: tuple[bool, tuple[bool, ...]]) -> list[float]:
        return [0.0, 0.0] if mode[0] else [y[1], (force - law.n(*y, mode[1])) / m]

    def guards(mode: tuple[bool, tuple[bool, ...]]) -> list[Guard]:
        sticks, modes = mode
        if sticks:
            off, on = (law.turned(modes, law.friction, way) for way in (False, True))
            return [
                (lambda f, y: law.n(y[0], 0.0, on) - f, lambda f, y: (False, on)),
                (lambda f, y: f - law.n(y[0], 0.0, off), lambda f, y: (False, off)),
            ]
        found: list[Guard] = []
        for k, switch in enumerate(law.switches):
            sign = 1.0 if modes[k] else -1.0
            if k == law.friction:
                after = lambda f, y: law.slides(y[0], modes, f)  # noqa: E731
            else:
                after = lambda f, y, k=k: (False, law.turned(modes, k, not modes[k]))  # noqa: E731
            found.append((lambda f, y, switch=switch, sign=sign: sign * switch(*y), after))
        return found

    return Structure(rate, guards, (False, ()), 2)


def _one_period(structure: Structure, F: complex, omega: float, y: np.ndarray, mode: Any, samples: int):
    period, t = 2 * np.pi / omega, 0.0

    def force(time: float) -> float:
        return float((F * np.exp(1j * omega * time)).real)

    times, wave = np.linspace(0, period, samples + 1), np.empty(samples + 1)
    while t < period * (1 - 1e-14):
        guards = structure.guards(mode)
        events = []
        for guard, _ in guards:

            def event(tau: float, y: np.ndarray, guard=guard) -> float:
                return guard(force(tau), y)

            event.terminal, event.direction = True, -1
            events.append(event)
        solution = solve_ivp(
            lambda tau, y, mode=mode: structure.rate(force(tau), y, mode), (t, period), y,
            "DOP853", rtol=RTOL, atol=1e-14, events=events, dense_output=True, max_step=period / 30,
        )  # fmt: skip
        here = (times >= t) & (times <= solution.t[-1] * (1 + 1e-15))
        wave[here] = solution.sol(np.minimum(times[here], solution.t[-1]))[0]
        t, y = solution.t[-1], solution.y[:, -1]
        if solution.status == 1:
            which = next(i for i, hits in enumerate(solution.t_events) if len(hits))
            mode = guards[which][1](force(t), y)
    return wave, y, mode


def settle(structure, F, omega, *, start=None, mode=None, samples=1024, periods=400):
    """Carry from rest, or from a state in its mode, until the fundamental repeats: X1, and the waveform."""
    y = np.zeros(structure.size) if start is None else np.array(start, dtype=float)
    mode = structure.mode if mode is None else mode
    last = complex(np.inf)
    for _ in range(periods):
        wave, y, mode = _one_period(structure, F, omega, y, mode, samples)
        X = complex(2 * np.mean(wave[:-1] * np.exp(-2j * np.pi * np.arange(samples) / samples)))
        if abs(X - last) <= REPEATS * abs(X):
            return X, wave
        last = X
    raise AssertionError("the reference does not repeat")


def lugre(m: float, c: float, k: float, s0: float, s1: float, Fc: float, Fs: float, vs: float) -> Structure:
    """Friction by bristles, z' = v - s0 |v| z / g(v), with the sign of v as mode: stiff."""

    def rate(force: float, y: np.ndarray, way: float) -> list[float]:
        x, v, z = y
        dz = v - s0 * way * v * z / (Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2)))
        return [v, (force - c * v - k * x - s0 * z - s1 * dz) / m, dz]

    return Structure(rate, lambda way: [(lambda f, y: y[1] * way, lambda f, y: -way)], 1.0, 3)
