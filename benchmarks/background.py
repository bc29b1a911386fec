"""Identify a mode among others many times under noise: a section of reports/accuracy.md.

Run by ``make bench``; ``--runs N`` for a quick look, which is printed and not written. The test is as a
measured one: fundamentals only, a phase error, residual terms of modes below and above, complex Gaussian
noise on force and response.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

import rsgen
from benchmarks.cramer_rao import Background, cramer_rao
from benchmarks.sections import write_section
from rsgen.data.oscillator import Model, Observation, Oscillator
from rsgen.dynamics.virtual_test import SimulatedTest, add_noise
from rsgen.law.element import make_element

RUNS = 200
NOISE = 0.01
MASS = 1.5
OTHERS = Background(psi=0.2, flexibility=3e-4 - 4e-5j, inertia=0.9 + 0.1j)
"""Up to a third of the receptance of the mode off its resonance."""

LAWS: dict[str, tuple[str, dict[str, float]]] = {
    "cubic spring, quadratic damper": (
        "k*x + k3*x**3 + c*v + cq*v*abs(v)",
        {"k": 5920.0, "k3": 3e5, "c": 2.0, "cq": 1.2},
    ),
    "cubic spring, Coulomb friction": (
        "k*x + k3*x**3 + c*v + Ff*sign(v)",
        {"k": 5920.0, "k3": 3e5, "c": 3.8, "Ff": 0.6},
    ),
}
LEVELS = np.linspace(2, 12, 6)
FREQUENCIES = np.linspace(8.5, 12.5, 41)
COVERED = (0.92, 0.98)
SPREAD = 0.2


@dataclass(frozen=True)
class Runs:
    """Many identifications of one law: estimates, their standard errors and intervals."""

    names: tuple[str, ...]
    values: NDArray[np.float64]  # (runs, parameters)
    standard_errors: NDArray[np.float64]  # (runs, parameters)
    intervals: NDArray[np.float64]  # (runs, parameters, 2)
    seconds: NDArray[np.float64]  # (runs,)


def truth(name: str) -> Oscillator:
    """The structure that is tested."""
    law, values = LAWS[name]
    return Oscillator(MASS, (make_element("law", law),), values)


def measured(name: str) -> rsgen.ResponseSurface:
    """What the sensors see of it, without noise."""
    test = SimulatedTest(LEVELS, FREQUENCIES, harmonics=1, accuracy=1e-7)
    return OTHERS.seen(rsgen.simulate(truth(name), test))


def identify_once(job: tuple[str, rsgen.ResponseSurface, int]) -> tuple[object, ...]:
    """One run: names, values, standard errors, intervals, seconds."""
    name, surface, seed = job
    model = Model(truth(name).elements, observation=Observation(background="residuals"))
    begin = time.perf_counter()
    found = rsgen.identify(add_noise(surface, NOISE, seed), model).refined
    took = time.perf_counter() - begin
    return (
        tuple(e.name for e in found),
        [e.value for e in found],
        [e.standard_error for e in found],
        [e.interval for e in found],
        took,
    )


def study(pool: object, name: str, runs: int) -> Runs:
    """Identify under this number of different noises."""
    surface = measured(name)
    done = list(pool.imap(identify_once, [(name, surface, seed) for seed in range(1, runs + 1)]))
    names, *columns = zip(*done, strict=True)
    return Runs(names[0], *(np.array(column) for column in columns))


def rows(name: str, runs: Runs) -> list[tuple[str, bool]]:
    """One row a parameter, and whether it is as asked."""
    values = {**LAWS[name][1], "m": MASS}
    bounds = cramer_rao(truth(name), measured(name), NOISE, OTHERS)
    out = []
    for i, parameter in enumerate(runs.names):
        true, found = values[parameter], runs.values[:, i]
        inside = float(np.mean((runs.intervals[:, i, 0] <= true) & (true <= runs.intervals[:, i, 1])))
        spread = float(np.std(found, ddof=1))
        score = (np.mean(found) - true) / (spread / np.sqrt(len(found)))
        ratio, stated = spread / bounds[parameter], float(np.sqrt(np.mean(runs.standard_errors[:, i] ** 2)))
        good = COVERED[0] <= inside <= COVERED[1] and abs(ratio - 1) <= SPREAD
        cells = (f"{100 * inside:.1f} %", f"{score:+.1f}", f"{spread / stated:.2f}", f"{ratio:.2f}")
        out.append((f"| {name} | {parameter} | " + " | ".join(cells) + " |", good))
    return out


def section(studied: dict[str, Runs]) -> str:
    """The section of the report."""
    table = [row for name, runs in studied.items() for row in rows(name, runs)]
    runs = next(iter(studied.values()))
    outside = sum(not good for _, good in table)
    head = f"""## With a background, {100 * NOISE:g} % noise, {len(runs.seconds)} runs a law

A test as a measured one: {len(LEVELS)} levels x {len(FREQUENCIES)} frequencies, fundamentals only, a phase
error of {OTHERS.psi:g} rad, residual terms of modes below and above of up to a third of the receptance of
the mode. Law, mass and background are identified. Asked: the 95 % interval covers the truth in
{100 * COVERED[0]:.0f} to {100 * COVERED[1]:.0f} % of the runs, the spread lies within {100 * SPREAD:.0f} % of
the Cramer-Rao bound. {outside} of {len(table)} parameters miss.

| law | parameter | in the interval | mean error / its standard error | spread / stated \
| spread / Cramer-Rao |
|---|---|---|---|---|---|"""
    return "\n".join([head, *(row for row, _ in table)])


def main() -> None:
    """Run the study."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--runs", type=int, help=f"runs a law, {RUNS} where the report is written")
    reader.add_argument("--processes", type=int, default=os.cpu_count())
    asked = reader.parse_args()
    os.environ["RSGEN_THREADS"] = "1"
    with get_context("spawn").Pool(asked.processes) as pool:
        studied = {name: study(pool, name, asked.runs or RUNS) for name in LAWS}
    text = section(studied)
    if asked.runs is None:
        write_section(text)
    print(text)
    for name, runs in studied.items():
        print(f"{name}: median {np.median(runs.seconds):.2f} s a run")


if __name__ == "__main__":
    main()
