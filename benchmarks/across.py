"""Identify a joint across two sensors many times under noise, and write reports/across.md.

Run by ``make bench``. Two structures of two masses whose exact motions are known; force, response and the
other sensor have complex Gaussian noise relative to their fundamentals, on every harmonic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import rsgen
from rsgen.common.output import write_atomic
from rsgen.data.surface.response_surface import ResponseSurface
from tests.identification.test_across import (
    ELEMENTS,
    GAUGE,
    MASS,
    SENSORS,
    TRUE,
    driven_by_a_sine,
    seen_by,
    two_masses,
)

REPORT = Path(__file__).parent.parent / "reports" / "across.md"
SEEDS = 20
NOISE = (0.003, 0.01, 0.03)
STRUCTURES: tuple[Callable[[], ResponseSurface], ...] = (two_masses, driven_by_a_sine)


def noisy(exact: ResponseSurface, noise: float, seed: int, sensors: str) -> ResponseSurface:
    """Add noise to force, response and the other sensor: one of the motion across, or the far one."""
    random, own = np.random.default_rng(seed), sensors == GAUGE
    other = exact.across if own else exact.harmonics - exact.across
    force, near, other = (
        values + noise * np.abs(values[:, 1:2]) * (draws[0] + 1j * draws[1]) / np.sqrt(2)
        for values in (exact.force_harmonics, exact.harmonics, other)
        for draws in [random.standard_normal((2, *values.shape))]
    )
    across = other if own else near - other
    return replace(exact, force=force[:, 1], force_harmonics=None, harmonics=near, across=across)


def row(structure: Callable[[], ResponseSurface], noise: float, sensors: str, mass: float | None) -> str:
    """One row of the table: the error of k3, the share of intervals that hold the truth, and verdicts."""
    exact, true = structure(), TRUE | {"m": MASS}
    error, inside, far, states = [], [], 0, Counter[str]()
    for seed in range(SEEDS):
        found = rsgen.identify(noisy(exact, noise, seed, sensors), seen_by(sensors, *ELEMENTS), mass=mass)
        states[found.verdict.state] += 1
        error.append(found["k3"].value / TRUE["k3"] - 1)
        free = [each for each in found if each.name != "m" or mass is None]
        inside += [each.interval[0] <= true[each.name] <= each.interval[1] for each in free]
        off = [abs(each.value - true[each.name]) > 4 * each.standard_error for each in free]
        far += found.verdict.state == "identified" and any(off)
    verdicts = ", ".join(f"{count} {state}" for state, count in states.items())
    return (
        f"| {structure.__name__.replace('_', ' ')} | {sensors} | {100 * noise:g} % | "
        f"{'given' if mass else 'free'} | {100 * np.sqrt(np.mean(np.square(error))):.2f} % | "
        f"{100 * np.mean(inside):.0f} % | {verdicts} | {far} |"
    )


def report() -> str:
    lines = [
        "# A joint across two sensors",
        "",
        f"{SEEDS} tests a row. `{GAUGE}` measures the motion across by itself, `{SENSORS}` is a difference.",
        "The last column counts tests that are identified with a value more than four standard errors off.",
        "",
        "| structure | across | noise | mass | rms error of k3 | in the interval | verdicts | wrong |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for structure in STRUCTURES:
        for sensors in (GAUGE, SENSORS):
            for noise in NOISE:
                for mass in (None, MASS):
                    lines.append(row(structure, noise, sensors, mass))
                    print(lines[-1], flush=True)
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    write_atomic(REPORT, report())
