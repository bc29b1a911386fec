"""How often does a ranking find the law? Noisy tests of all cases, of laws in no case, of what no law fits.

Run by ``make bench``: the table becomes a section of ``reports/accuracy.md``. With ``[runs] [noise,...]
[names ...]`` the rows are only printed. Every run has noise of its own; the ranking sees the surface and laws
without values. Time is processor time of one core.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path

os.environ.setdefault("RSGEN_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import rsgen
from benchmarks.sections import write_section
from rsgen.common.errors import RsgenError
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model, Oscillator
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.virtual_test import MultisineTest, SimulatedTest, add_noise
from rsgen.identification.ranking import rank
from rsgen.law.element import make_element
from rsgen.law.memory import with_equations

ROOT = Path(__file__).parent.parent
CASES = ROOT / "cases"
RUNS = 100
NOISE = 0.01
LEVELS, FREQUENCIES = 8, 40
BASE = "k*x + c*v"

# law, values, mass, levels [N], frequencies [Hz]; none of them is a case
OTHERS: dict[str, tuple[str, dict[str, float], float, tuple[float, float], tuple[float, float]]] = {
    "softening x*abs(x), quadratic damper": (
        "k*x - kq*x*abs(x) + c*v + cq*v*abs(v)",
        {"k": 7.2e5, "kq": 1.2e9, "c": 320.0, "cq": 8e4}, 6.2, (1.0, 12.0), (45.0, 58.0),
    ),
    "dead zone": (
        "k*x + kg*(Max(0, x - b) + Min(0, x + b)) + c*v",
        {"k": 2000.0, "kg": 1500.0, "b": 0.01, "c": 2.0}, 0.8, (0.5, 6.0), (6.5, 11.0),
    ),
    "saturation": (
        "k*x + Max(-Fm, Min(ks*x, Fm)) + c*v", {"k": 4000.0, "ks": 2000.0, "Fm": 20.0, "c": 6.0}, 2.5,
        (1.0, 12.0), (6.0, 9.0),
    ),
    "tanh friction": (
        "k*x + c*v + Ff*tanh(v/vs)", {"k": 5920.0, "c": 3.0, "Ff": 1.0, "vs": 0.15}, 1.5,
        (1.5, 12.0), (8.0, 12.0),
    ),
    "cubic spring, Coulomb friction": (
        "k*x + k3*x**3 + c*v + Ff*sign(v)", {"k": 5920.0, "k3": 3e5, "c": 3.0, "Ff": 0.6}, 1.5,
        (1.5, 12.0), (8.0, 13.0),
    ),
    "quadratic spring (asymmetric)": (
        "k*x + k2*x**2 + c*v", {"k": 9000.0, "k2": 4e4, "c": 5.0}, 3.0, (1.0, 12.0), (7.0, 10.0),
    ),
    "linear": (BASE, {"k": 5920.0, "c": 4.0}, 1.5, (1.0, 12.0), (8.0, 12.0)),
}  # fmt: skip


# the same in periodic multisines: term, values, levels [N]
MULTISINES: dict[str, tuple[str, dict[str, float], tuple[float, ...]]] = {
    "multisine: hardening": ("k3*x**3", {"k3": 4e6, "c": 4.0}, (4, 6, 9)),
    "multisine: friction": ("Ff*sign(v)", {"Ff": 0.6, "c": 15.0}, (8, 12, 20)),
    "multisine: gap": ("kg*(Max(0, x - b) + Min(0, x + b))", {"kg": 8e3, "b": 2e-3, "c": 15.0}, (4, 6, 9)),
}

HYSTERETIC = "none fits: hysteresis (Bouc-Wen)"
TWO_MODES = "none fits: two masses"
NO_LAW = (HYSTERETIC, TWO_MODES)

HEAD = """## Which law?

Noisy virtual tests ({levels} levels x {frequencies} frequencies, all harmonics noisy; multisines: 3 levels,
8 periods): in how many of the runs the true law came first, or tied for first (BIC within 6), and in how
many some law fits. The true law is a candidate under names of its own. Of structures that no law describes
none should fit.

| truth | noise | runs | first | tied | some law fits | seconds a ranking | first instead |
| --- | --- | --- | --- | --- | --- | --- | --- |"""

# the same law in other words
SAME = {"saturation": "dead-zone"}


@dataclass(frozen=True)
class Tally:
    """Over all runs of one truth: where it came out, what else came first, how long a ranking took."""

    name: str
    runs: int
    first: int
    tied: int
    fits: int
    instead: Counter[str]
    seconds: float


Tests = Iterator[ResponseSurface | MultisineSpectra]


def noisy(surface: ResponseSurface, noise: float) -> Tests:
    """Copies of a surface, each with noise of its own."""
    return (add_noise(surface, noise, seed) for seed in count(1))


def multisines(name: str, noise: float) -> tuple[Tests, Model]:
    """Multisines with random phases, without those for which no periodic response is found."""
    term, values, levels = MULTISINES[name]
    elements = (make_element("law", f"{BASE} + {term}"),)
    oscillator = Oscillator(1.5, elements, {"k": 5000.0, **values})

    def tests() -> Tests:
        for seed in count(1):
            test = MultisineTest(levels, (2.5, 20), 2.0, periods=8, noise_relative=noise, seed=seed)
            with suppress(RsgenError):
                yield rsgen.simulate(oscillator, test)

    return tests(), Model(elements)


def of_case(name: str) -> tuple[ResponseSurface, Model]:
    """A smaller grid of a case, without noise, and its laws without values."""
    case = rsgen.load_case(CASES / f"{name}.toml")
    assert isinstance(case.test, SimulatedTest)
    assert case.oscillator is not None
    level = case.test.level[np.linspace(0, len(case.test.level) - 1, LEVELS).round().astype(int)]
    low, high = case.test.frequency[[0, -1]]
    test = replace(
        case.test, level=np.unique(level), frequency=np.linspace(low, high, FREQUENCIES), noise_relative=0.0
    )
    return rsgen.simulate(case.oscillator, test), Model(case.model.elements)


def of_law(name: str) -> tuple[ResponseSurface, Model]:
    """The same for a law that is in no case."""
    law, values, mass, level, frequency = OTHERS[name]
    elements = (make_element("law", law),)
    test = SimulatedTest(
        np.linspace(*level, LEVELS), np.linspace(*frequency, FREQUENCIES), harmonics=9, accuracy=1e-6
    )
    return rsgen.simulate(Oscillator(mass, elements, values), test), Model(elements)


def tally(name: str, tests: Tests, model: Model, runs: int) -> Tally:
    """Rank tests; the truth is the candidate whose force is the model's."""
    first = tied = fits = 0
    instead: Counter[str] = Counter()
    seconds = 0.0
    for test in islice(tests, runs):
        started = time.process_time()
        ranking = rank(test, model)
        seconds += time.process_time() - started
        place = [
            # by the text of the force: memories are written behind it
            with_equations(model.force) == c.force or c.name == SAME.get(name)
            for c in ranking.candidates
        ]
        fits += ranking.fits
        if place[0]:
            first += 1
        else:
            instead[ranking.candidates[0].name] += 1
        tied += any(here and c.tied for here, c in zip(place, ranking.candidates, strict=True))
    return Tally(name, runs, first, tied, fits, instead, seconds / runs)


def row(entry: Tally, noise: float) -> str:
    """One line of the table."""
    other = "; ".join(f"{name} ({count})" for name, count in entry.instead.most_common(3))
    return (
        f"| {entry.name} | {noise:.0%} | {entry.runs} | {entry.first} | {entry.tied} | {entry.fits} "
        f"| {entry.seconds:.1f} | {other} |"
    )


def no_law(name: str) -> tuple[ResponseSurface, Model]:
    """A test of a structure that no law of the library describes."""
    from tests.oracles.memory import bouc_wen, two_masses

    surface = bouc_wen() if name == HYSTERETIC else two_masses()
    return surface, Model((make_element("spring", "k*x"), make_element("damper", "c*v")))


def rows(runs: int, noises: Sequence[float], wanted: Sequence[str] = ()) -> Iterator[str]:
    """Give the rows of the table one by one: the names wanted, or all."""
    cases = sorted(path.stem for path in CASES.glob("*.toml"))
    for noise in noises:
        for name in (*cases, *OTHERS, *NO_LAW, *MULTISINES):
            if wanted and name not in wanted:
                continue
            if name in MULTISINES:
                tests, model = multisines(name, noise)
            else:
                surface, model = (of_law if name in OTHERS else no_law if name in NO_LAW else of_case)(name)
                tests = noisy(surface, noise)
            yield row(tally(name, tests, model, runs if noise else 1), noise)


def main() -> None:
    """Print rows as they come; a whole run is written."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    noises = [float(text) for text in sys.argv[2].split(",")] if len(sys.argv) > 2 else [0.0, NOISE]
    lines = []
    for line in rows(runs, noises, sys.argv[3:]):
        print(line, flush=True)
        lines.append(line)
    if len(sys.argv) == 1:
        write_section("\n".join([HEAD.format(levels=LEVELS, frequencies=FREQUENCIES), *lines]))


if __name__ == "__main__":
    main()
