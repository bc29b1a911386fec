"""Tests with one thing wrong, with nothing wrong, pairs of results, random laws: reports/verdicts.md.

Run by ``make bench``; with names of tests, or ``--part``, a part of it is only printed. Measured tests take
part where RSGEN_DATA names their folder. Everything is seeded: the same runs give the same table.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("RSGEN_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import rsgen
from benchmarks import campaign, laboratory
from benchmarks import tampered_measurements as measured
from benchmarks.cramer_rao import Background
from benchmarks.laboratory import Outcome
from benchmarks.tampering import MATTERING, OTHER_WRONG, TAMPERINGS, UNSEEN, UNSEEN_OF, Tampering
from rsgen.common.output import write_atomic
from rsgen.data.oscillator import BACKGROUNDS, Model, Observation
from rsgen.dynamics.virtual_test import add_noise
from rsgen.law.element import as_elements
from tests.oracles.memory import bouc_wen, two_masses

ROOT = Path(__file__).parent.parent
PARTS = ("tampered", "untampered", "pairs", "random")
NOISES = (0.0, 0.001, 0.01, 0.03)
SEEDS = 20
FOUND, FALSE = 0.95, 0.02
"""What is asked: share of the tampered tests found, of the untampered ones doubted at most."""

MORE = ("x**3", "x**5", "v*abs(v)", "v**3")
"""Terms that laws get beside their own."""

GROWN = 1.5
"""Times by which a misfit has grown that decided before, where it says what is wrong: sound data have one if
their law is not quite right."""

UNSEEN_IN = "cubic"
"""The case that shows what no test can show; others would only repeat it."""

KINDS = {
    "as simulated": "levels of the case, every third of its frequencies, the mean and 15 harmonics",
    "as measured": "the same points, fundamentals only, through a file as a laboratory has it",
}


@dataclass(frozen=True)
class Row:
    """One tampered test and what became of it."""

    test: str
    tampering: Tampering
    outcome: Outcome
    plain: dict[str, float]  # what decided on the test without the tampering: codes, and how large
    seconds: float

    @property
    def right(self) -> bool:
        """Whether a right finding decided that had not decided before, or by what is far less."""
        refused = bool(self.tampering.refusal) and self.tampering.refusal in self.outcome.refusal
        return refused or any(
            code not in self.plain or size > GROWN * self.plain[code] > 0
            for code, size in deciding_sizes(self.outcome).items()
            if code in self.tampering.right
        )

    @property
    def corrected(self) -> bool:
        """Whether the mistake was mended and said."""
        code = self.tampering.corrected
        return bool(code) and any(finding.code == code for finding in self.outcome.findings)

    @property
    def found(self) -> bool:
        """Whether nobody would take the mistake for good, for the right reason."""
        return (self.outcome.doubted and self.right) or self.corrected

    def line(self) -> str:
        """A row of the table."""
        decided = ", ".join(self.outcome.deciding) or self.outcome.refusal[:90].replace("|", "/") or "--"
        right = "yes" if self.right else "mended, and said" if self.corrected else "**no**"
        right = "cannot be seen" if self.tampering.unseen and not self.found else right
        return f"| {self.test} | {self.tampering.name} | {self.outcome.state} | {decided} | {right} |"


def judge(write: Callable[[Path], Path]) -> Outcome:
    """Judge a test from files in a folder of its own; what is no refusal in a sentence is a crash."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            outcome = laboratory.judge(write(Path(folder)))
            return replace(outcome, refusal=outcome.refusal.replace(f"{folder}/", ""))
        except Exception as fault:
            return Outcome(None, refusal=f"CRASH {type(fault).__name__}: {fault}", crashed=True)


def deciding_sizes(outcome: Outcome) -> dict[str, float]:
    """Codes that decided, with the largest misfit or difference [1] that they are about; 0 of others."""
    sizes: dict[str, float] = {}
    for finding in outcome.verdict.decided_by if outcome.verdict is not None else ():
        own = [quantity.value for name, quantity in finding.numbers.items() if name in ("misfit", "size")]
        sizes[finding.code] = max([sizes.get(finding.code, 0.0), *own])
    return sizes


@cache
def plain(name: str) -> Outcome:
    """The verdict on the untampered test."""
    if name in measured.NAMES:
        return judge(lambda folder: measured.CASES / f"{name}.toml")
    return judge(laboratory.stepped(name).write)


def tamperings(name: str) -> tuple[Tampering, ...]:
    """All that is done to the test of this name."""
    if name in measured.NAMES:
        return measured.OF_CASE[name]
    entries = (*TAMPERINGS, *UNSEEN) if name == UNSEEN_IN else TAMPERINGS
    return tuple(replace(entry, unseen=UNSEEN_OF.get((name, entry.name), entry.unseen)) for entry in entries)


def tampered(job: tuple[str, int]) -> tuple[str, int, Outcome, dict[str, float], float]:
    """One tampered test; functions do not cross to another process, places in the list do."""
    name, place = job
    begin = time.perf_counter()
    outcome = judge(tamperings(name)[place].make(name).write)
    return name, place, outcome, deciding_sizes(plain(name)), time.perf_counter() - begin


def untampered(job: tuple[str, str, float, int]) -> tuple[str, ...]:
    """Codes that cast doubt on one untampered virtual test; empty where none does."""
    name, kind, noise, seed = job
    if kind == "as measured":
        outcome = judge(laboratory.stepped(name, noise, seed).write)
    else:
        surface = laboratory.simulated(name)
        grid = np.unique(surface.frequency)[:: laboratory.EVERY]
        surface = add_noise(surface.select(np.isin(surface.frequency, grid)), noise, seed)
        outcome = Outcome(rsgen.identify(surface, laboratory.load(name).model).verdict)
    return outcome.deciding or (("refused",) if outcome.doubted else ())


@dataclass(frozen=True)
class Structure:
    """A test and a law for it; the truth or not."""

    name: str
    load: Callable[[], tuple[rsgen.ResponseSurface, object]]


def _virtual(name: str, laws: tuple[str, ...] | None) -> Callable[[], tuple[rsgen.ResponseSurface, object]]:
    def load() -> tuple[rsgen.ResponseSurface, object]:
        test = laboratory.stepped(name)
        with tempfile.TemporaryDirectory() as folder:
            case = rsgen.load_case(replace(test, laws=laws or test.laws).write(Path(folder)))
            return rsgen.read(case), case.model

    return load


def _measured(name: str) -> Callable[[], tuple[rsgen.ResponseSurface, object]]:
    def load() -> tuple[rsgen.ResponseSurface, object]:
        case = rsgen.load_case(measured.CASES / f"{name}.toml", measured.folder())
        model = replace(case.model, observation=replace(case.model.observation, hold_out=()))
        return rsgen.read(case), model

    return load


def _oracle(make: Callable[[], rsgen.ResponseSurface], law: str) -> Callable[[], tuple[object, object]]:
    return lambda: (add_noise(make(), laboratory.NOISE, 1), Model(law))


def _with_other_modes(
    quintic: float, flexibility: float, kind: str
) -> Callable[[], tuple[rsgen.ResponseSurface, object]]:
    """A cubic spring with a small quintic [N/m^5] and other modes [m/N], at 1 % noise."""

    def load() -> tuple[rsgen.ResponseSurface, object]:
        values = {"k": 5920.0, "k3": 3e5, "c": 4.0, "k5": quintic}
        structure = rsgen.Oscillator(1.5, f"{CUBIC} + k5*x**5", values)
        test = rsgen.SimulatedTest(np.linspace(2, 12, 6), np.linspace(8.5, 12.5, 41), harmonics=1)
        modes = Background(psi=0.01, flexibility=flexibility * (1 - 0.1j), inertia=2e3 * flexibility)
        surface = add_noise(modes.seen(rsgen.simulate(structure, test)), 0.01, 1)
        return surface, Model(CUBIC, observation=Observation(background=kind))

    return load


CUBIC = "k*x + k3*x**3 + c*v"
POLYNOMIAL = "k*x + k2*x*abs(x) + k3*x**3 + c*v + c2*v*abs(v)"

STRUCTURES = (
    Structure("joint, true law", _virtual("joint", None)),
    Structure("coulomb, true law", _virtual("coulomb", None)),
    Structure("piecewise, true law", _virtual("piecewise", None)),
    Structure("combined, true law", _virtual("combined", None)),
    Structure("joint, cubic spring and quadratic damper", _virtual("joint", OTHER_WRONG["joint"])),
    Structure("coulomb, quadratic damper", _virtual("coulomb", OTHER_WRONG["coulomb"])),
    Structure("piecewise, cubic spring", _virtual("piecewise", ("k*x + k3*x**3", "c*v"))),
    Structure("quintic, linear", _virtual("quintic", MATTERING["quintic"])),
    Structure("hysteresis (Bouc-Wen), polynomial", _oracle(bouc_wen, POLYNOMIAL)),
    Structure("two coupled masses, cubic spring", _oracle(two_masses, CUBIC)),
    *(
        Structure(
            f"quintic {quintic:g} N/m^5, other modes {flexibility:g} m/N, {kind}",
            _with_other_modes(quintic, flexibility, kind),
        )
        for quintic in (0.0, 4e6, 2e7)
        for flexibility in (3e-6, 1e-5, 3e-5)
        for kind in ("none", "residuals")
    ),
    *(Structure(f"{name}, measured", _measured(name)) for name in (*measured.TABLES, "f16")),
)


def halves(surface: rsgen.ResponseSurface) -> Iterator[tuple[str, np.ndarray]]:
    """Cut a test in two by its levels, and at the largest response of each level."""
    rank, below = np.searchsorted(surface.levels, surface.level), np.zeros(len(surface), dtype=bool)
    for level in surface.levels:
        rows = np.flatnonzero(surface.level == level)
        below[rows] = surface.frequency[rows] < surface.frequency[rows[surface.amplitude[rows].argmax()]]
    cuts = {"alternate": rank % 2 == 0, "lower": rank < len(surface.levels) // 2, "below": below}
    return ((f"{side}{name}", rows == (not side)) for name, rows in cuts.items() for side in ("", "not "))


def variants(
    surface: rsgen.ResponseSurface, model: Model
) -> Iterator[tuple[str, rsgen.ResponseSurface, Model]]:
    """One structure with other backgrounds, laws with one more term, and halves of its test."""
    yield "as it is", surface, model
    if not model.sensors:
        for kind in BACKGROUNDS[:-1] if surface.phase_known else ():
            yield kind, surface, replace(model, observation=replace(model.observation, background=kind))
        for term in MORE:
            law = as_elements((*model.elements, f"more*{term}"))
            yield term, surface, replace(model, elements=law)
    for name, rows in halves(surface):
        yield name, surface.select(rows), model


def pairs(place: int) -> str:
    """Identify a structure in all ways, and compare all pairs that are identified; a row of the table."""
    structure, found = STRUCTURES[place], {}
    for name, table, model in variants(*structure.load()):
        with suppress(rsgen.RsgenError):
            found[name] = rsgen.identify(table, model)
    usable = {name: one for name, one in found.items() if one.verdict.usable}
    compared = {
        f"{one}/{other}": rsgen.compare_fits([usable[one], usable[other]]).findings
        for one, other in combinations(usable, 2)
    }
    apart = [names for names, findings in compared.items() if findings]
    said = ", ".join(apart) or "--"
    return f"| {structure.name} | {len(found)} | {len(usable)} | {len(compared)} | {len(apart)} | {said} |"


def tampered_section(rows: Sequence[Row]) -> list[str]:
    """The table of tampered tests with its summary."""
    found, accepted = sum(row.found for row in rows), sum(row.outcome.state == "accepted" for row in rows)
    other = sum(row.outcome.doubted and not row.found for row in rows)
    mended = sum(row.corrected and not (row.outcome.doubted and row.right) for row in rows)
    calm = sum(not (row.outcome.doubted or row.corrected) for row in rows)
    unseen = [row for row in rows if row.tampering.unseen and not row.found]
    reasons = dict.fromkeys(f"- {row.test}, {row.tampering.name}: {row.tampering.unseen}." for row in unseen)
    return [
        "## One thing wrong",
        "",
        f"Found: **{found} of {len(rows)}** ({found / len(rows):.1%}; asked {FOUND:.0%}): doubtful, rejected "
        "or refused, for the right reason: a finding that did not decide before the tampering, or whose "
        f"misfit is {GROWN:g} times as large. "
        f"Accepted: {accepted}. Mended, and said: {mended}. Doubted for another reason: {other}.",
        f"Neither doubted nor mended: {calm}"
        + (f", of these {len(unseen)} that cannot be seen:" if unseen else "."),
        "",
        *reasons,
        "",
        "| test | tampering | verdict | deciding findings | right finding |",
        "|---|---|---|---|---|",
        *(row.line() for row in rows),
    ]


def false_alarm_section(doubts: dict[tuple[str, str, float], list[tuple[str, ...]]]) -> list[str]:
    """The tables of untampered tests."""
    lines = ["## Nothing wrong", ""]
    for kind, words in KINDS.items():
        runs = {key: value for key, value in doubts.items() if key[1] == kind}
        alarms = sum(bool(codes) for value in runs.values() for codes in value)
        total = sum(map(len, runs.values()))
        heads = " | ".join(f"noise {100 * noise:g} %" for noise in NOISES)
        lines += [
            f"Virtual tests {kind} ({words}): doubtful or rejected **{alarms} of {total}** "
            f"({alarms / total:.1%}; asked at most {FALSE:.0%}). One run a case without noise.",
            "",
            f"| case | {heads} | findings |",
            "|---|" + "---|" * (len(NOISES) + 1),
        ]
        for name in dict.fromkeys(key[0] for key in runs):
            cells = [f"{sum(map(bool, runs[name, kind, n]))} of {len(runs[name, kind, n])}" for n in NOISES]
            codes = sorted({code for n in NOISES for found in runs[name, kind, n] for code in found})
            lines.append(f"| {name} | {' | '.join(cells)} | {', '.join(codes) or '--'} |")
        lines.append("")
    return lines


def measured_section(names: Iterable[str]) -> list[str]:
    """The table of untampered measured tests."""
    lines = ["| measured test | verdict | deciding findings |", "|---|---|---|"]
    for name in names:
        outcome = plain(name)
        lines.append(
            f"| {name} | {outcome.state} | {', '.join(outcome.deciding) or outcome.refusal or '--'} |"
        )
    return lines


def main() -> None:
    """Judge all, or a part."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--part", choices=PARTS)
    reader.add_argument("--seeds", type=int, default=SEEDS)
    reader.add_argument("--processes", type=int, default=os.cpu_count())
    reader.add_argument("test", nargs="*")
    asked = reader.parse_args()
    there = measured.NAMES if measured.folder() else ()
    names = [name for name in (*laboratory.NAMES, *there) if not asked.test or name in asked.test]
    parts = [asked.part] if asked.part else PARTS
    text = ["# Verdicts", "", HEAD if there else f"{HEAD}\n\n{LEFT_OUT}", ""]
    with get_context("spawn").Pool(asked.processes) as pool:
        if "tampered" in parts:
            rows = []
            jobs = [(name, place) for name in names for place in range(len(tamperings(name)))]
            for name, place, *result in pool.imap(tampered, jobs):
                rows.append(Row(name, tamperings(name)[place], *result))
                print(f"{rows[-1].line()} {rows[-1].seconds:.1f} s", file=sys.stderr, flush=True)
            text += [*tampered_section(rows), ""]
        if "untampered" in parts:
            virtual = [name for name in names if name in laboratory.NAMES]
            keys = [(name, kind, noise) for kind in KINDS for name in virtual for noise in NOISES]
            jobs = [(*key, seed) for key in keys for seed in range(1, (asked.seeds if key[2] else 1) + 1)]
            doubts: dict[tuple[str, str, float], list[tuple[str, ...]]] = {key: [] for key in keys}
            for job, codes in zip(jobs, pool.imap(untampered, jobs, chunksize=4), strict=True):
                doubts[job[:3]].append(codes)
                if codes:
                    print(*job, codes, file=sys.stderr, flush=True)
            text += false_alarm_section(doubts) if virtual else []
            text += [*measured_section(name for name in names if name in there), ""]
        if "pairs" in parts:
            places = [i for i, one in enumerate(STRUCTURES) if there or "measured" not in one.name]
            text += [*PAIRS, *pool.map(pairs, places, chunksize=1), ""]
        if "random" in parts:
            seeds = range(campaign.SEED, campaign.SEED + campaign.TESTS)
            jobs = [(kind, seed) for kind in campaign.KINDS for seed in seeds]
            text += [*campaign.section(pool.starmap(campaign.run, jobs, chunksize=4)), ""]
    report = "\n".join(text)
    if not asked.part and not asked.test and asked.seeds == SEEDS:
        write_atomic(ROOT / "reports" / "verdicts.md", report)
    print(report)


HEAD = f"""What a result is called when the test or the law has one thing wrong, and when nothing is wrong.
The virtual tests are those of `cases/` as a laboratory has them: a table of forces and of the fundamental of
the acceleration with {100 * laboratory.NOISE:g} % noise, phases recorded, read through a case file without
truth; histories come from an independent integrator. The measured tests are those of `tests/cases`. A right
finding names the mistake, or, where it shows only in what it does to the fit, says that law, levels or points
disagree. `make bench` renews this file."""

LEFT_OUT = "The measured tests were left out: RSGEN_DATA names no folder."

PAIRS = [
    "## Pairs of results of one structure",
    "",
    "Each structure with every background, with one more term in its law, and from halves of its test: pairs",
    "that are both identified, and those of them with disjoint intervals of a parameter (asked: none).",
    "",
    "| structure and law | results | identified | pairs | disjoint | which |",
    "|---|---|---|---|---|---|",
]


if __name__ == "__main__":
    main()
