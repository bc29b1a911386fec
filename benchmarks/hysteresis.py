"""Laws with memory side by side with heyoka: steady states a second of a joint, many sliders and Bouc-Wen.

Each peer carries 128 periods of transient and measures 8, as in ``benchmarks.peers``. Its sliders and
branches switch at terminal events.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers import MEASURED, SAMPLES, TRANSIENT
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.law.element import make_element
from tests.oracles import events

__all__ = ["table"]

Array = NDArray[np.float64]
Runner = Callable[[], NDArray[np.complex128]]

AWAY = 1e-9
"""m, m/s: a start on an event surface would find the same event for ever."""

INSIDE = 1e-7
"""Share by which a slipping force stays below its limit: on the limit itself its event would be missed."""

SLIDERS = 20
LEVELS, FREQUENCIES, RUNS = 40, 200, 3
PEER_SAMPLE, REFERENCE_SAMPLE = 48, 4
"""Points that heyoka and DOP853 are given: they take seconds for what rsgen does in a millisecond."""

ACCURACY = 1e-6


@dataclass(frozen=True)
class Job:
    """One law, where it is tried, heyoka's runner and tolerance, and how many times faster rsgen shall be."""

    name: str
    oscillator: Oscillator
    levels: tuple[float, float]
    frequencies: tuple[float, float]
    peer: Callable[[Array, Array, float], Runner]
    tolerance: float
    aim: float
    reference: events.Structure


def _waves(integrator: Any, omega: Array) -> NDArray[np.complex128]:
    """Fundamental of each lane after the transient."""
    period = 2 * np.pi / omega
    integrator.propagate_until(TRANSIENT * period)
    times = (TRANSIENT + np.arange(MEASURED * SAMPLES)[:, None] / SAMPLES) * period
    grid = integrator.propagate_grid(times)
    waves = (grid[-1] if isinstance(grid, tuple) else grid)[:, 0, :]
    return np.asarray(2 * np.mean(waves * np.exp(-1j * omega * times), axis=0))


def _batches(
    width: int, level: Array, frequency: Array, one: Callable[[Array, Array], NDArray[np.complex128]]
) -> Runner:
    def run() -> NDArray[np.complex128]:
        parts = [
            one(level[low : low + width], 2 * np.pi * frequency[low : low + width])
            for low in range(0, len(level) - width + 1, width)
        ]
        return np.concatenate(parts)

    return run


def bouc_wen_peer(level: Array, frequency: Array, tolerance: float) -> Runner:
    """The hysteretic benchmark; the signs of v and z are parameters that events change."""
    import heyoka as hy

    hy.set_logger_level_critical()
    width, p = hy.recommended_simd_size(), BOUC_WEN.values
    x, v, z = hy.make_vars("x", "v", "z")
    drive = hy.par[0] * hy.cos(hy.par[1] * hy.time)
    force = p["c"] * v + p["k"] * x + z
    rate = p["alpha"] * v - p["bg"] * hy.par[2] * v * z - p["bd"] * v * hy.par[3] * z

    def turn(row: int) -> Callable[[Any, int, int], bool]:
        def act(integrator: Any, direction: int, lane: int) -> bool:
            integrator.pars[row, lane] = 1.0 if direction > 0 else -1.0
            return True

        return act

    events = [hy.t_event_batch(v, callback=turn(2)), hy.t_event_batch(z, callback=turn(3))]
    integrator = hy.taylor_adaptive_batch(
        [(x, v), (v, (drive - force) / BOUC_WEN.mass), (z, rate)], np.zeros((3, width)),
        tol=tolerance, pars=np.zeros((4, width)), t_events=events,
    )  # fmt: skip

    def one(force: Array, omega: Array) -> NDArray[np.complex128]:
        integrator.set_time(0.0)
        integrator.state[:2], integrator.state[2] = AWAY, p["alpha"] * AWAY
        integrator.pars[0], integrator.pars[1], integrator.pars[2:] = force, omega, 1.0
        return _waves(integrator, omega)

    return _batches(width, level, frequency, one)


def _slider_peer(
    oscillator: Oscillator, stiffness: Array, limit: Array
) -> Callable[[Array, Array, float], Runner]:
    """Parallel Jenkins elements: a state each, whose rate a parameter turns off while it slips."""

    def peer(level: Array, frequency: Array, tolerance: float) -> Runner:
        import heyoka as hy

        hy.set_logger_level_critical()
        width, p, count = hy.recommended_simd_size(), oscillator.values, len(stiffness)
        x, v = hy.make_vars("x", "v")
        forces = [hy.make_vars(f"z{i}") for i in range(count)]
        drive = hy.par[0] * hy.cos(hy.par[1] * hy.time)
        force = p["c"] * v + p["k"] * x + hy.sum(forces)
        rates = [(z, stiffness[i] * v * hy.par[2 + i]) for i, z in enumerate(forces)]

        def turned(integrator: Any, direction: int, lane: int) -> bool:
            integrator.pars[2:, lane] = 1.0
            return True

        def slips(i: int) -> Callable[[Any, int, int], bool]:
            def act(integrator: Any, direction: int, lane: int) -> bool:
                integrator.pars[2 + i, lane] = 0.0
                integrator.state[2 + i, lane] = direction * limit[i] * (1 - INSIDE)
                return True

            return act

        events = [hy.t_event_batch(v, callback=turned)]
        for i, z in enumerate(forces):
            for side, way in ((1.0, hy.event_direction.positive), (-1.0, hy.event_direction.negative)):
                events.append(hy.t_event_batch(z - side * limit[i], callback=slips(i), direction=way))
        integrator = hy.taylor_adaptive_batch(
            [(x, v), (v, (drive - force) / oscillator.mass), *rates], np.zeros((2 + count, width)),
            tol=tolerance, pars=np.zeros((2 + count, width)), t_events=events,
        )  # fmt: skip

        def one(force: Array, omega: Array) -> NDArray[np.complex128]:
            integrator.set_time(0.0)
            integrator.state[:2], integrator.state[2:] = AWAY, 0.0
            integrator.pars[0], integrator.pars[1], integrator.pars[2:] = force, omega, 1.0
            return _waves(integrator, omega)

        return _batches(width, level, frequency, one)

    return peer


def _sliders(stiffness: Array, limit: Array) -> Oscillator:
    terms = " + ".join(f"Min({k:.17g}*x, {f:.17g})" for k, f in zip(stiffness, limit, strict=True))
    return Oscillator(1.5, make_element("joint", f"k*x + c*v + masing({terms})"), {"k": 5000.0, "c": 3.0})


BOUC_WEN = Oscillator(
    2.0,
    make_element("joint", "k*x + c*v + z", {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}),
    {"k": 5e4, "c": 10.0, "alpha": 5e4, "bg": 800.0, "bd": -1100.0},
)
_ONE = np.array([1500.0]), np.array([4.0])
_MANY = np.full(SLIDERS, 75.0), 75.0 * 0.02 * (np.arange(SLIDERS) + 0.5) / SLIDERS

JOBS = (
    Job(
        "jenkins", _sliders(*_ONE), (1, 12), (7, 13), _slider_peer(_sliders(*_ONE), *_ONE), 1e-6, 30,
        events.sliders(1.5, lambda x, v: 5000 * x + 3 * v, *_ONE),
    ),
    Job(
        f"iwan4 of {SLIDERS} sliders", _sliders(*_MANY), (1, 12), (7, 13),
        _slider_peer(_sliders(*_MANY), *_MANY), 1e-6, 10,
        events.sliders(1.5, lambda x, v: 5000 * x + 3 * v, *_MANY),
    ),
    Job(
        "bouc-wen", BOUC_WEN, (5, 60), (26, 50), bouc_wen_peer, 1e-6, 30,
        events.bouc_wen(2.0, **BOUC_WEN.values),
    ),
)  # fmt: skip


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def _measured(job: Job) -> list[str]:
    """One row: seconds and error of rsgen and of heyoka, and their ratio."""
    level = np.repeat(np.linspace(*job.levels, LEVELS), FREQUENCIES)
    frequency = np.tile(np.linspace(*job.frequencies, FREQUENCIES), LEVELS)
    points = len(level)

    def own() -> NDArray[np.complex128]:
        return solve_steady_states(job.oscillator, level, frequency, accuracy=ACCURACY).harmonics[:, 1]

    found = own()
    rows = np.sort(np.random.default_rng(3).permutation(points)[:PEER_SAMPLE])
    checked = rows[:: PEER_SAMPLE // REFERENCE_SAMPLE]
    exact = np.array([events.settle(job.reference, level[i], 2 * np.pi * frequency[i])[0] for i in checked])
    text = [job.name, f"{np.max(np.abs(found[checked] / exact - 1)):.0e}"]
    os.environ["RSGEN_THREADS"] = "1"
    try:
        peer = job.peer(level[rows], frequency[rows], job.tolerance)
        theirs = peer()
    except ImportError:
        return [job.name, f"{min(_seconds(own) for _ in range(RUNS)):.3f}", text[1], "not installed", "", ""]
    pairs = [(_seconds(own), _seconds(peer) * points / PEER_SAMPLE) for _ in range(RUNS)]
    mine, other = (median(each) for each in zip(*pairs, strict=True))
    error = np.max(np.abs(theirs[np.searchsorted(rows, checked)] / exact - 1))
    return [
        job.name, f"{mine:.3f}", text[1], f"{other:.1f}", f"{error:.0e}",
        f"**{other / mine:.0f}** (aim {job.aim:g})",
    ]  # fmt: skip


def table() -> list[str]:
    """Lines of the table of laws with memory."""
    rows = [_measured(job) for job in JOBS]
    return [
        f"## Laws with memory: {LEVELS * FREQUENCIES} steady states from rest",
        "",
        f"Accuracy {ACCURACY:g}, one core. heyoka (batch mode, tolerance 1e-6) on {PEER_SAMPLE} points,",
        f"extrapolated; errors of X1 on {REFERENCE_SAMPLE} points against DOP853 (rtol 1e-11) with events,",
        "from rest.",
        "",
        "| law | one core [s] | error | heyoka [s] | its error | times faster |",
        "|---|---|---|---|---|---|",
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
    ]


if __name__ == "__main__":
    print("\n".join(table()))
