"""Measure what a user waits for, side by side with an earlier version: commands, stages, points, memory.

``python -m benchmarks.stages`` prints the table; ``python -m benchmarks.stages COMMIT`` measures that
version, too, in turns with this one. Both run in processes of their own with the same libraries.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parent.parent
RUNS = 5
"""Of each command and version, in turns; the median is shown."""

EIGHT = ("cubic", "cubic-hardening", "quintic", "coulomb", "piecewise", "bilinear", "combined", "joint")
"""The cases without memory."""

FOUR_THOUSAND = ("cubic", "quintic", "coulomb", "combined", "piecewise", "bilinear")
POINTS = (1000, 10_000, 100_000)

IDENTIFY = """
import resource, sys, time
from dataclasses import replace
import numpy as np
import rsgen as rs
from rsgen import load_case
case, levels, count = load_case(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
low, high = (f(case.test.level) for f in (np.min, np.max))
first, last = (f(case.test.frequency) for f in (np.min, np.max))
test = replace(case.test, level=np.linspace(low, high, levels), frequency=np.linspace(first, last, count))
surface = rs.simulate(case.oscillator, test)
took = []
for _ in range(1 if len(surface) > 20_000 else 3):
    begin = time.perf_counter()
    rs.identify(surface, case.model)
    took.append(time.perf_counter() - begin)
print(min(took), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""

CORES = """
import os, sys, time
from dataclasses import replace
import numpy as np
import rsgen as rs
from rsgen import load_case
case = load_case(sys.argv[1])
low, high = (f(case.test.level) for f in (np.min, np.max))
first, last = (f(case.test.frequency) for f in (np.min, np.max))
test = replace(case.test, level=np.linspace(low, high, 40), frequency=np.linspace(first, last, 200))
took = {"1": [], "2": []}
rs.simulate(case.oscillator, test)
for _ in range(9):
    for cores, each in took.items():
        os.environ["RSGEN_THREADS"] = cores
        begin = time.perf_counter()
        rs.simulate(case.oscillator, test)
        each.append(time.perf_counter() - begin)
print(*(sorted(each)[4] for each in took.values()))
"""

COMPILE = """
import sys, time
import rsgen as rs
from rsgen import load_case
from rsgen.dynamics.kernel import compile_kernel
case = load_case(sys.argv[1])
import numba
begin = time.perf_counter()
compile_kernel(case.oscillator.force)
print(time.perf_counter() - begin)
"""


@dataclass(frozen=True)
class Version:
    """A version of rsgen: its name in the table and where its code lies."""

    name: str
    root: Path

    def python(self, arguments: Sequence[str], folder: Path, cache: Path | None = None) -> list[float]:
        """Run Python with this version; its printed numbers, then seconds and seconds of processor time."""
        own = {"PYTHONPATH": str(self.root), "RSGEN_CACHE": str(cache or folder / f"cache-{self.name}")}
        kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONDONTWRITEBYTECODE", "RSGEN_THREADS")}
        before, begin = os.times(), time.perf_counter()
        done = subprocess.run(
            [sys.executable, *arguments], env=kept | own, cwd=folder, capture_output=True, text=True
        )
        took, after = time.perf_counter() - begin, os.times()
        if done.returncode not in (0, 1):
            raise RuntimeError(f"{self.name}: {' '.join(arguments)[:200]}: {done.stderr[-500:]}")
        spent = after.children_user - before.children_user + after.children_system - before.children_system
        said = done.stdout.split() if arguments[0] == "-c" else []
        return [*map(float, said), took, spent]


def commands(folder: Path) -> dict[str, list[str]]:
    """Name and arguments of the commands that are timed."""
    cases = ROOT / "cases"
    cubic, eight = str(cases / "cubic.toml"), folder / "eight"
    eight.mkdir(exist_ok=True)
    for name in EIGHT:
        (eight / f"{name}.toml").write_bytes((cases / f"{name}.toml").read_bytes())
    table = next((cases / "formats").glob("*.csv"))
    return {
        "`rsgen run cases/cubic.toml --force`": ["run", cubic, "--force", "--out", str(folder / "out")],
        "`rsgen run`, eight cases, `--force`": ["run", str(eight), "--force", "--out", str(eight / "out")],
        '`rsgen derive "k*x + k3*x**3 + c*v"`': ["derive", "k*x + k3*x**3 + c*v"],
        "`rsgen check cases/cubic.toml`": ["check", cubic],
        f"`rsgen inspect {table.name}`": ["inspect", str(table)],
        "`rsgen identify cases/cubic.toml`": ["identify", cubic],
    }


def _row(name: str, unit: str, found: Mapping[str, Sequence[float]]) -> str:
    middle = [median(each) for each in found.values()]
    cells = [f"{value:.2f} {unit}" if unit != "MB" else f"{value:.0f} MB" for value in middle]
    ratio = f"{middle[0] / middle[-1]:.2f}" if len(middle) > 1 and unit == "s" else ""
    return "| " + " | ".join([name, *cells, ratio]) + " |"


def _whole_commands(versions: Sequence[Version], folder: Path) -> list[str]:
    rows = []
    for name, arguments in commands(folder).items():
        wall: dict[str, list[float]] = {version.name: [] for version in versions}
        work: dict[str, list[float]] = {version.name: [] for version in versions}
        for turn in range(1 + (RUNS if "eight" not in name else 3)):
            for version in versions:
                took, spent = version.python(["-m", "rsgen", *arguments], folder)
                # the first run compiles kernels and bytecode
                if turn:
                    wall[version.name].append(took)
                    work[version.name].append(spent)
        rows += [_row(name, "s", wall), _row("processor time of it", "s", work)]
        if "cubic.toml --force" in name:
            cold: dict[str, list[float]] = {version.name: [] for version in versions}
            for turn in range(3):
                for version in versions:
                    empty = folder / f"empty-{version.name}-{turn}"
                    cold[version.name].append(version.python(["-m", "rsgen", *arguments], folder, empty)[-2])
            rows.append(_row("the same, kernels not yet compiled", "s", cold))
    return rows


def _measured(
    versions: Sequence[Version], folder: Path, name: str, program: str, arguments: Sequence[str], turns: int
) -> dict[str, list[list[float]]]:
    case = str(ROOT / "cases" / f"{name}.toml")
    found: dict[str, list[list[float]]] = {version.name: [] for version in versions}
    for turn in range(turns):
        for version in versions:
            cache = folder / f"first-{version.name}-{name}-{turn}" if program is COMPILE else None
            found[version.name].append(version.python(["-c", program, case, *arguments], folder, cache)[:-2])
    return found


def _part(found: Mapping[str, Sequence[Sequence[float]]], place: int) -> dict[str, list[float]]:
    return {name: [each[place] for each in runs] for name, runs in found.items()}


def table(commit: str | None = None) -> list[str]:
    """Lines of the table: this version, and that of a commit where one is given."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rsgen-stages-")))
        versions = [Version("now", ROOT)]
        if commit is not None:
            earlier = folder / "earlier"
            earlier.mkdir()
            packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True)
            subprocess.run(["tar", "-x", "-C", str(earlier)], input=packed.stdout, check=True)
            versions.insert(0, Version(commit[:7], earlier))
        rows = _whole_commands(versions, folder)
        for name in FOUR_THOUSAND:
            found = _measured(versions, folder, name, IDENTIFY, ("40", "100"), 3)
            rows.append(_row(f"identification, {name}, 4000 points", "s", _part(found, 0)))
        for points in POINTS:
            found = _measured(versions, folder, "cubic", IDENTIFY, ("50", str(points // 50)), 1)
            rows.append(_row(f"identification, cubic, {points:,} points", "s", _part(found, 0)))
            rows.append(_row("peak memory of that process", "MB", _part(found, 1)))
        for name in ("cubic", "quintic"):
            found = _measured(versions, folder, name, CORES, (), 3)
            rows.append(_row(f"8000 steady states, {name}, one core", "s", _part(found, 0)))
            rows.append(_row("two cores", "s", _part(found, 1)))
        for name in ("cubic", "coulomb", "bilinear"):
            found = _measured(versions, folder, name, COMPILE, (), 2)
            rows.append(_row(f"first compile of the kernel, {name}", "s", _part(found, 0)))
        head = ["figure", *(version.name for version in versions), "times faster"]
        return [
            "## What a user waits for",
            "",
            f"Medians of {RUNS} runs in turns (1 to 3 of what takes longer), whole processes, kernels",
            "compiled before where nothing else is said; of identifications the best of three in a process.",
            f"Load of the machine at the end: {os.getloadavg()[0]:.1f}.",
            "",
            "| " + " | ".join(head) + " |",
            "|" + "---|" * len(head),
            *rows,
            "",
        ]


if __name__ == "__main__":
    print("\n".join(table(sys.argv[1] if len(sys.argv) > 1 else None)))
