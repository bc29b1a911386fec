"""Simulate one spring in six wordings and print how much slower the slowest is than the fastest.

Run by ``make bench``: how a user writes a law must not decide how long a test takes. Asked: at most 1.3.
"""

from __future__ import annotations

import os
import time
from statistics import median

os.environ["RSGEN_THREADS"] = "1"

import numpy as np

from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.simulation import simulate
from rsgen.dynamics.virtual_test import SimulatedTest
from rsgen.law.element import make_element

WORDINGS = {
    "two branches": "Piecewise((k*x, abs(x) <= b), ((k + kd)*x - kd*b*sign(x), True))",
    "three branches": "k*x + Piecewise((kd*(x - b), x > b), (kd*(x + b), x < -b), (0, True))",
    "abs": "(k + kd)*x + kd/2*(abs(x - b) - abs(x + b))",
    "Max and Min": "k*x + kd*(Max(0, x - b) + Min(0, x + b))",
    "Heaviside": "k*x + kd*((x - b)*Heaviside(x - b) + (x + b)*Heaviside(-x - b))",
    "sign": "k*x + kd*(x - b*sign(x))*Heaviside(abs(x) - b)",
}
VALUES = {"k": 5920.0, "kd": 980.0, "b": 0.02, "c": 3.8}
MASS = 1.5
LEVELS, FREQUENCIES = 40, 200
RUNS = 5
ASKED = 1.3


def measure(levels: int = LEVELS, runs: int = RUNS) -> dict[str, tuple[float, float]]:
    """Median seconds of each wording, and how far its amplitudes are from those of the first."""
    test = SimulatedTest(np.linspace(1, 12, levels), np.linspace(7, 13, FREQUENCIES))
    oscillators = {
        name: Oscillator(MASS, (make_element("spring", f"{law} + c*v"),), VALUES)
        for name, law in WORDINGS.items()
    }
    # the first simulation of each compiles its kernel
    amplitudes = {name: simulate(oscillator, test).amplitude for name, oscillator in oscillators.items()}
    first = amplitudes["two branches"]
    took: dict[str, list[float]] = {name: [] for name in WORDINGS}
    for _ in range(runs):
        for name, oscillator in oscillators.items():
            begin = time.perf_counter()
            simulate(oscillator, test)
            took[name].append(time.perf_counter() - begin)
    return {
        name: (median(took[name]), float(np.max(np.abs(amplitudes[name] / first - 1)))) for name in WORDINGS
    }


def main() -> None:
    """Print the table."""
    measured = measure()
    print(f"{LEVELS * FREQUENCIES} steady states, one core, median of {RUNS} runs")
    for name, (seconds, difference) in measured.items():
        print(f"{name:15} {1e3 * seconds:6.0f} ms   amplitudes differ by {difference:.0e}")
    seconds = [entry[0] for entry in measured.values()]
    print(f"slowest / fastest: {max(seconds) / min(seconds):.2f} (asked: at most {ASKED})")


if __name__ == "__main__":
    main()
