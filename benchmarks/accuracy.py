"""Identify every case many times under noise, and write reports/accuracy.md.

Run by ``make bench``; ``--runs N`` for a quick look, which is printed and not written. A case is simulated
once; a run only adds its own noise. Everything is seeded: the same runs give the same table.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

import rsgen
from benchmarks.cramer_rao import cramer_rao
from rsgen.cases.case import Case
from rsgen.common.finding import Finding
from rsgen.common.output import write_atomic
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.virtual_test import add_noise
from rsgen.law.memory import FORCE_KEYS, force_keys

ROOT = Path(__file__).parent.parent
RUNS = 500
NOISE = (0.001, 0.01, 0.05)
STUDIED = 0.01
FEWER = 10
"""Factor by which there are fewer runs at a noise that is compared, not judged."""

FREQUENCIES = 31
"""In a noisy run; the levels are those of the case, so that a run has a few hundred points."""

CENTRAL = 0.7
"""Share of the frequencies of the case that a noisy run covers: all resonances, and points within them."""

EXACT = 1e-7
KINDS = ("paper", "first_order", "refined")
COVERED = (0.92, 0.98)
SCORE = 2.0
SPREAD = 0.2


@dataclass(frozen=True)
class Runs:
    """Many identifications of one case at one noise: error and interval of every row and estimate."""

    names: tuple[str, ...]
    errors: NDArray[np.float64]  # (runs, 3, rows), relative to the truth
    intervals: NDArray[np.float64]  # (runs, parameters, 2), of the refined estimate, relative to the truth
    stated: NDArray[np.float64]  # (runs, parameters) its standard errors, relative to the truth
    identifiable: NDArray[np.bool_]  # (runs, parameters)
    points: NDArray[np.float64]  # (runs,) that took part
    seconds: NDArray[np.float64]  # (runs,)
    findings: tuple[Finding, ...]


@cache
def load(name: str) -> Case:
    return rsgen.load_case(ROOT / "cases" / f"{name}.toml")


@cache
def surface_of(name: str, frequencies: int | None) -> ResponseSurface:
    case = load(name)
    test = case.test
    if frequencies is not None:
        low, high = test.frequency[0], test.frequency[-1]
        reach = np.array([-1, 1]) * CENTRAL / 2 * (high - low) + (high + low) / 2
        test = replace(test, frequency=np.linspace(*reach, frequencies))
    return rsgen.simulate(case.oscillator, replace(test, accuracy=EXACT))


def identify_once(job: tuple[str, float, int]) -> tuple[tuple[str, ...], tuple[object, ...]]:
    """One run: names of the rows, and the columns of ``Runs``."""
    name, noise, seed = job
    case = load(name)
    table = add_noise(surface_of(name, FREQUENCIES if noise else None), noise, seed)
    begin = time.perf_counter()
    found = rsgen.identify(table, case.model)
    took = time.perf_counter() - begin
    comparison = rsgen.compare(found, case.truth, dict.fromkeys(force_keys(found.model.force), 1.0))
    rows = [row for row in comparison.rows if len(found.refined) > 6 or row.name not in FORCE_KEYS]
    true = np.array([case.truth[estimate.name] for estimate in found.refined])
    first = [row.paper_error for row in rows], [row.first_order_error for row in rows]
    signed = [
        row.refined.value / row.true - 1 if row.name in case.truth else row.relative_error for row in rows
    ]
    intervals = np.array([estimate.interval for estimate in found.refined]) / true[:, None]
    intervals.sort(axis=1)
    stated = np.array([estimate.standard_error for estimate in found.refined]) / np.abs(true)
    identifiable = np.array([estimate.identifiable for estimate in found.refined])
    return tuple(row.name for row in rows), (
        np.array([*first, signed]), intervals - 1, stated, identifiable, found.curve.used.sum(), took,
        found.findings,
    )  # fmt: skip


def study(pool: object, name: str, noise: float, runs: int) -> Runs:
    # noise of its own for every case and size: chance is not shared
    first = crc32(f"{name} {noise:g}".encode())
    jobs = [(name, noise, first + run) for run in range(runs)]
    done = list(pool.imap(identify_once, jobs, chunksize=2))
    names = done[0][0]
    columns = list(zip(*(values for _, values in done), strict=True))
    return Runs(
        names, *(np.array(column) for column in columns[:6]), tuple(f for run in columns[6] for f in run)
    )


def root_mean_square(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Over the runs in which there is a value."""
    known = np.isfinite(values)
    return np.sqrt(
        np.sum(np.where(known, values, 0.0) ** 2, axis=0)
        / np.where(known.any(axis=0), known.sum(axis=0), np.nan)
    )


def cell(value: float) -> str:
    return "--" if not np.isfinite(value) else f"{value:.0e}"


def errors_table(studied: dict[str, dict[float, Runs]]) -> list[str]:
    columns = [0.0, *NOISE]
    lines = [
        "| case | parameter | " + " | ".join(f"noise {100 * noise:g} %" for noise in columns) + " |",
        "|---|---|" + "---|" * len(columns),
    ]
    for name, at in studied.items():
        for i, parameter in enumerate(at[0.0].names):
            cells = []
            for noise in columns:
                parts = [cell(e) for e in root_mean_square(at[noise].errors[:, :, i])]
                cells.append(f"{parts[0]} / {parts[1]} / **{parts[2]}**")
            lines.append(f"| {name} | {parameter} | " + " | ".join(cells) + " |")
    return lines


def mark(text: str, good: bool) -> str:
    return text if good else f"**{text}**"


def words_table(
    studied: dict[str, dict[float, Runs]], bounds: dict[str, dict[str, float]]
) -> tuple[list[str], list[int]]:
    """What the intervals at 1 % are worth, and how many rows miss each of the three aims."""
    lines = [
        "| case | parameter | identifiable | in the interval | mean error / its standard error | "
        "spread / stated | spread / Cramer-Rao |",
        "|---|---|---|---|---|---|---|",
    ]
    missed = [0, 0, 0]
    for name, at in studied.items():
        runs = at[STUDIED]
        count = len(runs.errors)
        for i in range(runs.intervals.shape[1]):
            error = runs.errors[np.isfinite(runs.errors[:, 2, i]), 2, i]
            inside = float(np.mean((runs.intervals[:, i, 0] <= 0) & (runs.intervals[:, i, 1] >= 0)))
            spread = float(np.std(error, ddof=1))
            score = float(np.mean(error) / (spread / np.sqrt(count)))
            stated = float(np.sqrt(np.mean(runs.stated[:, i] ** 2)))
            ratio = spread / bounds[name][runs.names[i]]
            good = (COVERED[0] <= inside <= COVERED[1], abs(score) <= SCORE, abs(ratio - 1) <= SPREAD)
            missed = [m + (not g) for m, g in zip(missed, good, strict=True)]
            lines.append(
                f"| {name} | {runs.names[i]} | {100 * runs.identifiable[:, i].mean():.0f} % | "
                f"{mark(f'{100 * inside:.1f} %', good[0])} | {mark(f'{score:+.1f}', good[1])} | "
                f"{spread / stated:.2f} | {mark(f'{ratio:.2f}', good[2])} |"
            )
    return lines, missed


def exact_table(studied: dict[str, dict[float, Runs]]) -> list[str]:
    """Without noise: the largest error, and how many of its own standard errors it is."""
    lines = [
        "| case | points | largest error | of which | largest error in its standard errors | time [s] |",
        "|---|---|---|---|---|---|",
    ]
    for name, at in studied.items():
        runs = at[0.0]
        parameters = runs.stated.shape[1]
        error = np.abs(runs.errors[0, 2])
        worst = int(np.argmax(error[:parameters]))
        share = float(np.max(error[:parameters] / runs.stated[0]))
        lines.append(
            f"| {name} | {runs.points[0]:.0f} | {error[worst]:.1e} | {runs.names[worst]} | {share:.1f} | "
            f"{runs.seconds[0]:.1f} |"
        )
        for i in range(parameters, len(runs.names)):
            lines.append(f"| {name} | | {error[i]:.1e} | {runs.names[i]} | | |")
    return lines


def report(studied: dict[str, dict[float, Runs]], bounds: dict[str, dict[str, float]], runs: int) -> str:
    judged, missed = words_table(studied, bounds)
    count = len(judged) - 2
    points = np.concatenate([at[STUDIED].points for at in studied.values()])
    took = np.concatenate([at[STUDIED].seconds for at in studied.values()])
    fewer = max(runs // FEWER, 1)
    percent = f"{100 * STUDIED:g} %"
    low, high = (100 * share for share in COVERED)
    return f"""# Accuracy

Every case of `cases/`, mass identified too. Simulated once (accuracy 1e-7), then identified under complex
Gaussian noise on the force and on every harmonic, relative to |F| and |X1|. `make bench` renews this file.

## Intervals at {percent} noise, {runs} runs a case

{FREQUENCIES} frequencies at the levels of the case; {points.min():.0f} to {points.max():.0f} points.
Median time of a run {np.median(took):.2f} s on a loaded machine (load {os.getloadavg()[1]:.0f}).
Asked: the 95 % interval covers the truth in {low:.0f} to {high:.0f} % of the runs; the mean error lies within
{SCORE:g} of its standard errors, which chance alone lets one parameter in twenty miss; the spread is within
{100 * SPREAD:.0f} % of the Cramer-Rao bound. "Stated" is the standard error of the result.
What misses is bold: of {count} parameters {missed[0]} miss the coverage, {missed[1]} the mean, {missed[2]}
the spread.

{chr(10).join(judged)}

## Errors of the three estimates

Root mean square relative error: the paper's estimate / first order over all points / **refined**; forces of
the joint relative to their largest value over the tested range. {runs} runs at {percent}, {fewer} at the
others, one without noise (on the grid of the case).

{chr(10).join(errors_table(studied))}

## Without noise

Refined, on the grid of the case. Asked: 1e-6 for every parameter, 5e-4 for the forces of the joint.

{chr(10).join(exact_table(studied))}
"""


def main() -> None:
    reader = argparse.ArgumentParser()
    reader.add_argument("--runs", type=int, help=f"runs a case, {RUNS} where the report is written")
    reader.add_argument("--processes", type=int, default=os.cpu_count())
    reader.add_argument("case", nargs="*", default=sorted(p.stem for p in (ROOT / "cases").glob("*.toml")))
    asked = reader.parse_args()
    runs = asked.runs or RUNS
    # one thread a process: the processes fill the cores
    os.environ["RSGEN_THREADS"] = "1"
    studied, bounds = {}, {}
    with get_context("spawn").Pool(asked.processes) as pool:
        for name in asked.case:
            begin = time.perf_counter()
            table = surface_of(name, FREQUENCIES)
            seen = table.select(~table.held_out(load(name).observation.hold_out))
            true = {**load(name).truth}
            bounds[name] = {
                key: value / abs(true[key])
                for key, value in cramer_rao(load(name).oscillator, seen, STUDIED).items()
            }
            studied[name] = {0.0: study(pool, name, 0.0, 1)} | {
                noise: study(pool, name, noise, runs if noise == STUDIED else max(runs // FEWER, 1))
                for noise in NOISE
            }
            print(f"{name}: {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
            print("\n".join(words_table({name: studied[name]}, bounds)[0][2:]), file=sys.stderr, flush=True)
            kinds = Counter(finding.code for finding in studied[name][STUDIED].findings)
            for code, count in kinds.items():
                print(f"  {count / runs:.0%} {code}", file=sys.stderr)
    text = report(studied, bounds, runs)
    if asked.runs is None:
        write_atomic(ROOT / "reports" / "accuracy.md", text)
    print(text)


if __name__ == "__main__":
    main()
