"""An independent answer to compare with: DOP853 from event to event, with a separate stick mode.

Nothing of the kernel or of the normal form is used: a law is given as a plain Python function of
x, v and the modes, with its switching functions beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-11
REPEATS = 1e-8  # of the amplitude; the light damping of the cases makes this 1e-6 of the answer or better


@dataclass(frozen=True)
class Law:
    """n(x, v, modes); one mode a switch, a function of x and v; ``friction`` is the one that sticks."""

    n: Callable[[float, float, tuple[bool, ...]], float]
    switches: tuple[Callable[[float, float], float], ...] = ()
    friction: int | None = None


def carry_one_period(law: Law, m: float, F: complex, omega: float, y: np.ndarray, samples: int) -> np.ndarray:
    """x and v at equally spaced times of one period from state y, both ends included: (samples + 1, 2)."""
    period = 2 * np.pi / omega
    times = np.linspace(0, period, samples + 1)
    out = np.empty((samples + 1, 2))
    out[0] = y

    def f(t: float) -> float:
        return (F * np.exp(1j * omega * t)).real

    def with_mode(modes: tuple[bool, ...], k: int, on: bool) -> tuple[bool, ...]:
        return (*modes[:k], on, *modes[k + 1 :])

    def stuck_now(t: float, x: float, modes: tuple[bool, ...]) -> bool:
        k = law.friction
        return law.n(x, 0.0, with_mode(modes, k, False)) <= f(t) <= law.n(x, 0.0, with_mode(modes, k, True))

    x, v = y
    t = 0.0
    modes = tuple(s(x, v) > 0 for s in law.switches)
    stuck = False
    if law.friction is not None and v == 0:
        stuck = stuck_now(t, x, modes)
        if not stuck:
            up = f(t) > law.n(x, 0.0, with_mode(modes, law.friction, True))
            modes = with_mode(modes, law.friction, up)
    for k, s in enumerate(law.switches):
        if k != law.friction and s(x, v) == 0:
            acceleration = f(t) - law.n(x, v, modes)
            modes = with_mode(modes, k, s(x + 1e-9 * v, v + 1e-9 * acceleration) > 0)
    while t < period:
        active = modes
        if stuck:
            high = law.n(x, 0.0, with_mode(active, law.friction, True))
            low = law.n(x, 0.0, with_mode(active, law.friction, False))
            grid = np.linspace(t, period, 20001)
            force = (F * np.exp(1j * omega * grid)).real
            # at the moment of sticking the force may be on the bound itself
            out_of = np.flatnonzero((force > high) | (force < low))
            out_of = out_of[out_of > 0]
            if not len(out_of):
                end, up = period, None
            else:
                i = int(out_of[0])
                up = force[i] > high
                bound = high if up else low
                a, b = grid[i - 1], grid[i]
                for _ in range(80):
                    c = 0.5 * (a + b)
                    a, b = (a, c) if (f(c) > bound) == up else (c, b)
                end = b
            inside = (times > t) & (times <= end * (1 + 1e-15))
            out[inside] = x, 0.0
            t = end
            if up is None:
                v = 0.0
                break
            stuck, v = False, 0.0
            modes = with_mode(active, law.friction, bool(up))
            continue

        def motion(tau: float, z: np.ndarray, active: tuple[bool, ...] = active) -> list[float]:
            return [z[1], (f(tau) - law.n(z[0], z[1], active)) / m]

        events = []
        for k, s in enumerate(law.switches):
            # signed so that an event is always a fall through zero
            sign = 1.0 if active[k] else -1.0

            def event(tau: float, z: np.ndarray, s=s, sign=sign) -> float:
                return sign * s(z[0], z[1])

            event.terminal, event.direction = True, -1
            events.append(event)
        z0 = np.array([x, v])
        solution = solve_ivp(
            motion, (t, period), z0, "DOP853", rtol=RTOL, atol=1e-17, events=events or None,
            dense_output=True, max_step=period / 60,
        )  # fmt: skip
        end = solution.t[-1]
        inside = (times > t) & (times <= end * (1 + 1e-15))
        out[inside] = solution.sol(np.minimum(times[inside], end)).T
        x, v = solution.y[:, -1]
        t = end
        if solution.status != 1:
            break
        k = next(i for i, hits in enumerate(solution.t_events) if len(hits))
        if k == law.friction:
            v = 0.0
            if stuck_now(t, x, modes):
                stuck = True
            else:
                modes = with_mode(modes, k, f(t) > law.n(x, 0.0, with_mode(modes, k, True)))
        else:
            modes = with_mode(modes, k, not modes[k])
    out[-1] = x, v
    return out


def settle(
    law: Law, m: float, F: complex, omega: float, y: np.ndarray, samples: int = 2048, periods: int = 12
) -> tuple[np.ndarray, np.ndarray]:
    """Go on from y until the motion repeats, helped by Aitken-like extrapolation: waveform and state."""
    orbits = []
    size = abs(F) / (m * omega**2) * 1e-3
    gap = np.inf
    for _ in range(periods):
        wave = carry_one_period(law, m, F, omega, y, samples)
        size = max(size, np.abs(wave[:, 0]).max())
        end = wave[-1]
        gap = np.hypot(end[0] - y[0], (end[1] - y[1]) / omega) / size
        if gap < REPEATS:
            return wave, end
        orbits.append(y)
        y = end
        if len(orbits) >= 3:
            # three steps of the map give its linear part: jump to the fixed point
            d = np.diff(np.array([*orbits[-3:], end]), axis=0).T
            if abs(np.linalg.det(d[:, :2])) > 1e-9 * np.linalg.norm(d[:, 0]) * np.linalg.norm(d[:, 1]):
                J = d[:, 1:] @ np.linalg.inv(d[:, :2])
                y = orbits[-1] + np.linalg.solve(np.eye(2) - J, end - orbits[-1])
                orbits = []
    raise AssertionError(f"the reference does not repeat: {gap}")


def harmonic(wave: np.ndarray, h: int) -> complex:
    """X_h of the waveform (samples + 1, 2)."""
    x = wave[:-1, 0]
    n = len(x)
    total = np.sum(x * np.exp(-2j * np.pi * h * np.arange(n) / n)) / n
    return complex(total if h == 0 else 2 * total)
