"""What a user would run otherwise: scipy's RK45 on a lambdified law, and heyoka in batch mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rsgen.data.oscillator import Oscillator
from rsgen.law.element import make_element
from tests.oracles import events

TRANSIENT, MEASURED, SAMPLES = 128, 8, 16
AWAY = 1e-7  # m and m/s: where heyoka starts laws with events
M, F0, ZETA = 1.5, 10.0, 0.02
K = M * (2 * np.pi * F0) ** 2
C = 2 * ZETA * M * 2 * np.pi * F0


@dataclass(frozen=True)
class Job:
    """One law: for rsgen, for the reference, and for heyoka as (force from symbols and modes, switches)."""

    name: str
    law: str
    values: dict[str, float]
    reference: events.Law
    heyoka: Callable[..., Any]
    switches: tuple[Callable[..., Any], ...] = ()
    against_heyoka: float = 0.0
    against_scipy: float = 0.0

    @property
    def oscillator(self) -> Oscillator:
        return Oscillator(M, (make_element("all", self.law),), self.values)


def _piecewise(k5: float, b: float) -> events.Law:
    def n(x: float, v: float, modes: tuple[bool, ...]) -> float:
        if modes[0]:
            return C * v + k5 * x + (K - k5) * b
        return C * v + (K * x if modes[1] else k5 * x - (K - k5) * b)

    return events.Law(n, (lambda x, v: x - b, lambda x, v: x + b))


SOFT, FIFTH, B = -0.03 * K / 0.02**2, 0.1 * K / 0.02**4, 5e-3

JOBS = (
    Job(
        "Duffing",
        "c*v + k*x + kn*x**3",
        {"c": C, "k": K, "kn": SOFT},
        events.Law(lambda x, v, _: C * v + K * x + SOFT * x**3),
        # x**3 starts with nan at x = 0 there
        lambda x, v: C * v + K * x + SOFT * x * x * x,
        (),
        30,
        5e4,
    ),
    Job(
        "quintic",
        "c*v + k*x + kn*x**5",
        {"c": C, "k": K, "kn": FIFTH},
        events.Law(lambda x, v, _: C * v + K * x + FIFTH * x**5),
        lambda x, v: C * v + K * x + FIFTH * x * x * x * x * x,
        (),
        30,
        5e4,
    ),
    Job(
        "Coulomb",
        "c*v + k*x + Ff*sign(v)",
        {"c": C, "k": K, "Ff": 0.5},
        events.Law(lambda x, v, m: C * v + K * x + (0.5 if m[0] else -0.5), (lambda x, v: v,), 0),
        lambda x, v, above: C * v + K * x + 0.5 * (2.0 * above - 1.0),
        (lambda x, v: v,),
        75,
    ),
    Job(
        "piecewise",
        "c*v + Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
        {"c": C, "k4": K, "k5": 1.4 * K, "b": B},
        _piecewise(1.4 * K, B),
        lambda x, v, out, on: C * v + K * x + 0.4 * K * (out * (x - B) + (1.0 - on) * (x + B)),
        (lambda x, v: x - B, lambda x, v: x + B),
        10,
        1e4,
    ),
    Job(
        "bilinear",
        "c*v + Piecewise((k6*x, x > 0), (k7*x, True))",
        {"c": C, "k6": K, "k7": 1.4 * K},
        events.Law(lambda x, v, m: C * v + (K if m[0] else 1.4 * K) * x, (lambda x, v: x,)),
        lambda x, v, above: C * v + (1.4 * K - 0.4 * K * above) * x,
        (lambda x, v: x,),
        10,
        1e4,
    ),
    Job(
        "quadratic damping + cubic",
        "c*v + cn*v*abs(v) + k*x + kn*x**3",
        {"c": C, "cn": 1.0, "k": K, "kn": 0.1 * K / 0.02**2},
        events.Law(lambda x, v, _: C * v + v * abs(v) + K * x + 0.1 * K / 0.02**2 * x**3, (lambda x, v: v,)),
        lambda x, v, above: C * v + v * v * (2.0 * above - 1.0) + K * x + 0.1 * K / 0.02**2 * x * x * x,
        (lambda x, v: v,),
        60,
        2e4,
    ),
)


def heyoka_amplitudes(
    job: Job, level: NDArray[np.float64], frequency: NDArray[np.float64]
) -> Callable[[], NDArray[np.complex128]]:
    """A runner of heyoka on these points, compiled; modes switch at terminal events, there is no stick."""
    import heyoka as hy

    hy.set_logger_level_critical()
    width = hy.recommended_simd_size()
    x, v = hy.make_vars("x", "v")
    modes = [hy.par[2 + i] for i in range(len(job.switches))]
    acceleration = (hy.par[0] * hy.cos(hy.par[1] * hy.time) - job.heyoka(x, v, *modes)) / M

    def switch(which: int) -> Any:
        def act(integrator: Any, direction: int, lane: int) -> bool:
            integrator.pars[2 + which, lane] = 1.0 if direction > 0 else 0.0
            return True

        return hy.t_event_batch(job.switches[which](x, v), callback=act)

    options: dict[str, Any] = {"tol": 1e-6, "pars": np.zeros((2 + len(modes), width))}
    if modes:
        options["t_events"] = [switch(i) for i in range(len(modes))]
    integrator = hy.taylor_adaptive_batch([(x, v), (v, acceleration)], np.zeros((2, width)), **options)

    def run() -> NDArray[np.complex128]:
        found = np.empty(len(level), dtype=np.complex128)
        for low in range(0, len(level) - width + 1, width):
            omega = 2 * np.pi * frequency[low : low + width]
            period = 2 * np.pi / omega
            integrator.set_time(0.0)
            # on the very event surface it would find the same event for ever
            integrator.state[:] = AWAY if job.switches else 0.0
            integrator.pars[0], integrator.pars[1] = level[low : low + width], omega
            # the modes in which a mass at rest starts under a positive force
            integrator.pars[2:] = 1.0
            for i, function in enumerate(job.switches):
                integrator.pars[2 + i] = 1.0 if function(1e-12, 1e-12) > 0 else 0.0
            integrator.propagate_until(TRANSIENT * period)
            times = (TRANSIENT + np.arange(MEASURED * SAMPLES)[:, None] / SAMPLES) * period
            grid = integrator.propagate_grid(times)
            waves = (grid[-1] if isinstance(grid, tuple) else grid)[:, 0, :]
            found[low : low + width] = 2 * np.mean(waves * np.exp(-1j * omega * times), axis=0)
        return found

    return run


def scipy_amplitude(job: Job, level: float, frequency: float) -> complex:
    """One point as a user of SymPy and scipy computes it."""
    x, v = sympy.symbols("x v", real=True)
    o = job.oscillator
    symbols = {symbol: symbol.name for symbol in o.force.free_symbols}
    law = o.force.subs({s: o.values[name] for s, name in symbols.items() if name in o.values})
    n = sympy.lambdify((x, v), law.subs({s: {"x": x, "v": v}[s.name] for s in law.free_symbols}), "numpy")
    omega = 2 * np.pi * frequency

    def rate(t: float, y: NDArray[np.float64]) -> list[float]:
        return [y[1], (level * np.cos(omega * t) - n(y[0], y[1])) / M]

    period = 2 * np.pi / omega
    times = (TRANSIENT + np.arange(MEASURED * SAMPLES) / SAMPLES) * period
    end = (TRANSIENT + MEASURED) * period
    solution = solve_ivp(rate, (0, end), [0.0, 0.0], "RK45", rtol=1e-6, atol=1e-12, t_eval=times)
    return complex(2 * np.mean(solution.y[0] * np.exp(-1j * omega * times)))
