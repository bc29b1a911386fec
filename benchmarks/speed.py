"""Measure steady states a second, side by side with peers, and write reports/benchmark.md.

Run by ``make bench``; ``make bench BEFORE=COMMIT`` measures an earlier version beside this one. Every
figure is from this run on this machine; ratios travel better than seconds.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks import hysteresis, peers, stages
from benchmarks.peers import JOBS, Job
from rsgen.common.output import write_atomic
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.simulation import simulate
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.dynamics.virtual_test import SimulatedTest
from tests.oracles import events

ROOT = Path(__file__).parent.parent
LEVELS, FREQUENCIES = 40, 200
RUNS = 5
SMOOTH_SAMPLE, SWITCHING_SAMPLE, SCIPY_SAMPLE, REFERENCE_SAMPLE = 1600, 400, 3, 10


def grid(count: int = LEVELS * FREQUENCIES) -> SimulatedTest:
    levels = max(count // FREQUENCIES, 1)
    return SimulatedTest(np.linspace(1, 12, levels), np.linspace(7, 13, FREQUENCIES))


def seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def on_cores(count: int, work: Callable[[], object]) -> float:
    os.environ["RSGEN_THREADS"] = str(count)
    return seconds(work)


def references(job: Job, surface: ResponseSurface, rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """|X1| by DOP853 with events, where the surface is: the reference goes on until it repeats by itself."""
    o = job.oscillator
    structure, found = events.switched(o.mass, job.reference), []
    near = solve_steady_states(o, surface.force[rows], surface.frequency[rows], accuracy=1e-9)
    for i, row in enumerate(rows):
        F, omega = surface.force[row], surface.omega[row]
        mode = job.reference.mode_at(near.state[i], F.real)
        found.append(abs(events.settle(structure, F, omega, start=near.state[i], mode=mode)[0]))
    return np.array(found)


def measure(job: Job) -> list[str]:
    """One row of the table."""
    o, test, points = job.oscillator, grid(), LEVELS * FREQUENCIES
    surface = simulate(o, test)
    sample = SWITCHING_SAMPLE if job.switches else SMOOTH_SAMPLE
    rows = np.sort(np.random.default_rng(3).permutation(points)[:sample])
    peer: Callable[[], NDArray[np.complex128]] | None
    try:
        peer = peers.heyoka_amplitudes(job, surface.level[rows], surface.frequency[rows])
        peer()
    except ImportError:
        peer = None
    one, two, other = [], [], []
    for _ in range(RUNS):
        one.append(on_cores(1, lambda: simulate(o, test)))
        two.append(on_cores(2, lambda: simulate(o, test)))
        if peer is not None:
            other.append(seconds(peer) * points / sample)
    amplitude = surface.amplitude
    checked = rows[:: max(len(rows) // REFERENCE_SAMPLE, 1)][:REFERENCE_SAMPLE]
    exact = references(job, surface, checked)
    error = np.max(np.abs(amplitude[checked] / exact - 1))
    text = [job.name, f"{median(one):.3f}", f"{median(one) / median(two):.2f}", f"{error:.0e}"]
    if peer is None:
        text += ["not installed", "", ""]
    else:
        theirs = np.abs(peer())[np.searchsorted(rows, checked)]
        their_error = np.max(np.abs(theirs / exact - 1))
        ratio = median(other) / median(one)
        text += [
            f"{median(other):.2f}",
            f"{their_error:.0e}",
            f"**{ratio:.0f}** (aim {job.against_heyoka:g})",
        ]
    if job.against_scipy:
        some = checked[:SCIPY_SAMPLE]
        slow = seconds(
            lambda: [peers.scipy_amplitude(job, surface.level[i], surface.frequency[i]) for i in some]
        )
        ratio = slow * points / len(some) / median(one)
        text += [f"**{ratio:,.0f}** (aim {job.against_scipy:,.0f})"]
    else:
        text += ["chatters"]
    return text


PRODUCT = """
import time
import numpy as np
n = 1500
a = np.random.default_rng(1).random((n, n))
took = []
for _ in range(6):
    begin = time.perf_counter()
    a @ a
    took.append(time.perf_counter() - begin)
print(2 * n**3 / min(took))
"""


def arithmetic() -> tuple[float, float]:
    """What a product of matrices reaches on one core, and what the Duffing kernel does, in Gflop/s."""
    # as many threads as the variable says, which is read when numpy is imported
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    out = subprocess.run(
        [sys.executable, "-c", PRODUCT], env=alone, capture_output=True, text=True, check=True
    )
    peak = float(out.stdout) / 1e9
    o = JOBS[0].oscillator
    kernel = compile_kernel(o.force)
    values = np.array([o.values[name] for name in kernel.parameters])
    n, periods, steps = 6400, 64, 32
    omega = 2 * np.pi * np.linspace(7, 13, n)
    os.environ["RSGEN_THREADS"] = "1"

    def work() -> None:
        kernel.integrate(
            np.arange(n), np.zeros((2, n)), np.tile([1.0, 0.0], (n, 1)), omega, o.mass, values,
            steps=steps, periods=periods,
        )  # fmt: skip

    work()
    # a step: four evaluations of 8 operations (the law) and 5 (its place), three forces of 3, 15 to sum up
    operations = n * periods * steps * (4 * 13 + 9 + 15)
    return peak, operations / min(seconds(work) for _ in range(5)) / 1e9


def scaling() -> tuple[list[str], float]:
    """Seconds for more and more points, and the exponent."""
    o = JOBS[0].oscillator
    counts, took = [1000, 10_000, 100_000, 1_000_000], []
    for count in counts:
        runs = 5 if count < 100_000 else 1
        took.append(min(on_cores(1, lambda count=count: simulate(o, grid(count))) for _ in range(runs)))
    exponent = np.polyfit(np.log(counts), np.log(took), 1)[0]
    return [f"{count:,}: {s:.3f} s" for count, s in zip(counts, took, strict=True)], float(exponent)


def processes() -> dict[str, float]:
    """Whole processes: first compile, from the cache, the command line."""
    program = (
        "import time; from rsgen.formula.reading import parse; "
        "from rsgen.dynamics.kernel import compile_kernel; "
        "import numba, sympy; law = parse({law!r}); t = time.perf_counter(); compile_kernel(law); "
        "print(time.perf_counter() - t)"
    )
    took = {}
    with tempfile.TemporaryDirectory() as folder:
        surroundings = os.environ | {"RSGEN_CACHE": folder}
        for job in (JOBS[0], JOBS[2], JOBS[3]):
            for when in ("compiled first", "from the cache"):
                command = [sys.executable, "-c", program.format(law=job.law)]
                out = subprocess.run(command, env=surroundings, capture_output=True, text=True, check=True)
                took[f"{job.name}, {when}"] = float(out.stdout)
        case = str(ROOT / "cases" / "cubic.toml")
        tool = str(Path(sys.executable).parent / "rsgen")
        for name, arguments in (
            ("`rsgen identify cases/cubic.toml`", ["identify", case]),
            ("`rsgen --help`", ["--help"]),
        ):
            runs = []
            for _ in range(3):
                begin = time.perf_counter()
                done = subprocess.run([tool, *arguments], capture_output=True, cwd=folder)
                if done.returncode == 0:
                    runs.append(time.perf_counter() - begin)
            if runs:
                took[name] = min(runs)
    return took


def report() -> str:
    rows = []
    load = os.getloadavg()[0]
    for job in JOBS:
        print(f"{job.name} ...", flush=True)
        rows.append(measure(job))
    peak, reached = arithmetic()
    sizes, exponent = scaling()
    lines = [
        "# Speed",
        "",
        f"{LEVELS} levels x {FREQUENCIES} frequencies = {LEVELS * FREQUENCIES} steady states from rest, "
        f"accuracy 1e-4, 10 Hz, 2 % damping. Medians of {RUNS} alternating runs of `rsgen.simulate`, kernels",
        f"compiled before. Peers carry {peers.TRANSIENT} periods of transient and measure {peers.MEASURED}: "
        f"heyoka (batch mode, tolerance 1e-6, one core,",
        f"no stick) on {SMOOTH_SAMPLE} points of smooth laws and {SWITCHING_SAMPLE} of others, scipy (RK45, "
        f"rtol 1e-6) on {SCIPY_SAMPLE} points, both extrapolated to",
        f"all of them. Errors of |X1| on {REFERENCE_SAMPLE} points against DOP853 (rtol 1e-11) with events. "
        f"Load of the machine at the start: {load:.1f}.",
        "",
        "| law | one core [s] | two cores | error | heyoka [s] | its error | times faster | than scipy |",
        "|---|---|---|---|---|---|---|---|",
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
        *hysteresis.table(),
        f"Arithmetic of one core: {peak:.0f} Gflop/s in a product of two large matrices; the Duffing kernel",
        f"does {reached:.0f} Gflop/s, {100 * reached / peak:.0f} % of it.",
        "",
        f"Cost against points (Duffing, one core): {'; '.join(sizes)}. Exponent {exponent:.2f}.",
        "",
        *(f"* {name}: {took:.2f} s" for name, took in processes().items()),
        "",
        *stages.table(os.environ.get("BEFORE") or None),
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    text = report()
    write_atomic(ROOT / "reports" / "benchmark.md", text)
    print(text)
