"""How often does a ranking find a known law beside a background? A section of reports/accuracy.md.

Run by ``make bench``; with ``[runs]`` for a quick look. Runs go through all rows in turn and the section is
written after each, so that a benchmark that is ended leaves what it has. The ranking sees the surface and the
library, nothing else. Time is processor time of one core.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import rsgen
from benchmarks.background import MASS, OTHERS
from benchmarks.cramer_rao import Background
from benchmarks.sections import write_section
from rsgen.data.oscillator import Observation, Oscillator
from rsgen.dynamics.virtual_test import SimulatedTest, add_noise
from rsgen.law.element import make_element

RUNS = 50
NOISES = (0.003, 0.01)
LEVELS, FREQUENCIES = np.linspace(2, 12, 6), np.linspace(8.5, 12.5, 33)
ASKED = 0.95

# the law, its values, and what it adds to a linear spring and damper in the names of the library
LAWS: dict[str, tuple[str, dict[str, float], str]] = {
    "cubic, hardening": ("k*x + k3*x**3 + c*v", {"k": 5920.0, "k3": 3e5, "c": 3.8}, "cubic-spring"),
    "cubic, softening": ("k*x + k3*x**3 + c*v", {"k": 5920.0, "k3": -2.2e5, "c": 3.8}, "cubic-spring"),
    "quintic": ("k*x + k5*x**5 + c*v", {"k": 5920.0, "k5": 4e8, "c": 3.8}, "quintic-spring"),
    "Coulomb": ("k*x + c*v + Ff*sign(v)", {"k": 5920.0, "c": 3.8, "Ff": 0.8}, "coulomb"),
    "quadratic damping": ("k*x + c*v + cq*v*abs(v)", {"k": 5920.0, "c": 2.0, "cq": 1.5}, "quadratic-damper"),
    "piecewise": (
        "k*x + kd*(Max(0, x - b) + Min(0, x + b)) + c*v",
        {"k": 5920.0, "kd": 1080.0, "b": 0.01, "c": 3.8}, "dead-zone",
    ),
    "bilinear": ("k*x + kb*Max(0, x) + c*v", {"k": 5000.0, "kb": 2000.0, "c": 3.8}, "bilinear-spring"),
    "cubic, quadratic damping": (
        "k*x + k3*x**3 + c*v + cq*v*abs(v)", {"k": 5920.0, "k3": 3e5, "c": 2.0, "cq": 1.2},
        "cubic-spring + quadratic-damper",
    ),
    "cubic, Coulomb": (
        "k*x + k3*x**3 + c*v + Ff*sign(v)", {"k": 5920.0, "k3": 3e5, "c": 3.8, "Ff": 0.6},
        "cubic-spring + coulomb",
    ),
}  # fmt: skip

KINDS: dict[str, Background] = {
    "residuals": OTHERS,
    "constant": replace(OTHERS, inertia=0j),
    "phase": replace(OTHERS, flexibility=0j, inertia=0j),
    "none": Background(0.0, 0j, 0j),
}

HEAD = """## Which law, with a background?

Noisy virtual tests of known laws ({levels} levels x {frequencies} frequencies), seen with a phase error of
{psi:g} rad ("phase"), a constant receptance ("constant") and residual terms of modes below and above
("residuals") of up to a third of the receptance of the mode. Fundamentals only; of the bilinear spring,
whose fundamental is that of a linear one, mean and harmonics, too. The ranking has the library and no values.
Asked: in {asked:.0%} of the runs the law is first or tied, and fits. Here {found} of {runs} ({share:.1%});
{doubted} were called doubtful or rejected. {turns} runs a row are asked; rows with fewer, or missing, are
those of a benchmark that was ended early. Seconds are those of a core.

| law | background | noise | runs | first or tied, and fits | doubted | seconds a ranking | first instead |
| --- | --- | --- | --- | --- | --- | --- | --- |"""


@dataclass
class Tally:
    """Over the runs of one row: how many there were, found the law, were doubted; what came first instead."""

    runs: int = 0
    found: int = 0
    doubted: int = 0
    seconds: float = 0.0
    instead: Counter[str] = field(default_factory=Counter)


def seen(law: str, kind: str) -> rsgen.ResponseSurface:
    """What the sensors see of a law without noise."""
    formula, values, _ = LAWS[law]
    odd = law != "bilinear"
    test = SimulatedTest(LEVELS, FREQUENCIES, harmonics=1 if odd else 5, accuracy=1e-7)
    mode = rsgen.simulate(Oscillator(MASS, (make_element("law", formula),), values), test)
    background = KINDS[kind]
    harmonics = np.array(mode.harmonics)
    harmonics[:, 1] += background.receptance(mode.omega) * mode.force
    peak = mode.peak if kind in ("none", "phase") else np.full_like(mode.peak, np.nan)
    return replace(mode, harmonics=harmonics, force=mode.force * np.exp(-1j * background.psi), peak=peak)


def run(tally: Tally, law: str, kind: Any, noise: float, seed: int) -> None:
    """Rank one noisy test."""
    surface = add_noise(seen(law, kind), noise, seed)
    started = time.process_time()
    ranking = rsgen.rank(surface, None, Observation(background=kind))
    tally.seconds += time.process_time() - started
    wanted = set(LAWS[law][2].split(" + "))
    best = [candidate.name for candidate in ranking if candidate.tied]
    tally.runs += 1
    tally.found += ranking.fits and any(set(name.split(" + ")) == wanted for name in best)
    tally.doubted += ranking.verdict.state != "identified"
    if set(ranking.candidates[0].name.split(" + ")) != wanted:
        tally.instead[ranking.candidates[0].name] += 1


def section(tallies: dict[tuple[str, str, float], Tally]) -> str:
    """The section of the report."""
    runs, found, doubted = (
        sum(getattr(tally, name) for tally in tallies.values()) for name in ("runs", "found", "doubted")
    )
    head = HEAD.format(
        levels=len(LEVELS), frequencies=len(FREQUENCIES), psi=OTHERS.psi, asked=ASKED, runs=runs, found=found,
        share=found / runs, doubted=doubted, turns=RUNS,
    )  # fmt: skip
    rows = [
        f"| {law} | {kind} | {noise:.1%} | {tally.runs} | {tally.found} | {tally.doubted} "
        f"| {tally.seconds / tally.runs:.1f} "
        f"| {'; '.join(f'{name} ({count})' for name, count in tally.instead.most_common(3))} |"
        for (law, kind, noise), tally in tallies.items()
    ]
    return "\n".join([head, *rows])


def main() -> None:
    """Write the section after each run."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    tallies = {(law, kind, noise): Tally() for law in LAWS for kind in KINDS for noise in NOISES}
    for turn in range(1, runs + 1):
        for row, ((law, kind, noise), tally) in enumerate(tallies.items()):
            # rows of one noise would be unlucky together
            run(tally, law, kind, noise, turn * len(tallies) + row)
            print(turn, law, kind, noise, tally, flush=True)
            write_section(section({row: each for row, each in tallies.items() if each.runs}))


if __name__ == "__main__":
    main()
