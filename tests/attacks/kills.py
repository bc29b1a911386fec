"""Runs, or a worker of one, ended at random moments: what they leave, and what the next run makes of it."""

import os
import random
import shutil
import signal
import time
from collections import Counter
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from pathlib import Path

from tests.attacks import program
from tests.attacks.program import Row

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
_NEXT_MOMENT = 1.15  # of the time of an undisturbed run, up to which moments are drawn: past its end, too

FIGURES = (
    "results that lie", "earlier results lost", "orphans", "leftovers after the next run",
    "tracebacks, hangs, wrong exit codes",
)  # fmt: skip


def _signal(leader: int, number: signal.Signals, whom: str, out: Path) -> bool:
    """Send a signal to a run, to all its processes as a terminal does, or to a worker; False if over."""
    # a hidden folder names the process that fills it
    workers = (int(folder.name.split(".")[2]) for folder in out.glob(".*.part"))
    target = next(workers, None) if whom == "a worker" else leader
    with suppress(ProcessLookupError):
        if target is not None:
            (os.killpg if whom == "all" else os.kill)(target, number)
            return True
    return False


def _codes(number: signal.Signals, whom: str) -> tuple[int, ...]:
    """Exit codes that a run may have: 0 came too late, the signal's own before Python listens.

    A worker that is killed costs its own case one more try, the others nothing.
    """
    if whom == "a worker":
        return (0,)
    return (0, -number) if number == signal.SIGKILL else (0, 130, -number)


def kill_once(seed: int, place: Path, seconds: float, earlier: Path, tried: Counter[str]) -> list[list[str]]:
    """Begin a run, of two cases where it is pooled, end it at a random moment, look, run again, look again.

    Half of the runs begin where earlier results lie, which must not be lost; a fifth compile their kernels.
    Return what was found, by figure.
    """
    chance = random.Random(seed)
    number, jobs = chance.choice(SIGNALS), chance.choice(("1", "2"))
    whom = chance.choice(("the run", "all", "a worker")[: 1 + int(jobs)])
    again, cold = chance.random() < 0.5, chance.random() < 0.2
    around, out = program.environment(place), place / "out"
    if again:
        shutil.copytree(earlier / "out", out)
    shutil.copytree(earlier / "cache", place / "cache", dirs_exist_ok=True)
    if cold:
        shutil.rmtree(place / "cache")
    before = program.verified(out)
    cases = [earlier / "cases" / f"{name}.toml" for name in ("one", "two")[: int(jobs)]]
    words = ("run", *cases, "--out", out, "--jobs", jobs)
    process = program.start((*words, "--force") if again else words, env=around)
    time.sleep(chance.uniform(0.0, _NEXT_MOMENT) * seconds)
    reached = process.poll() is None and _signal(process.pid, number, whom, out)
    ended = program.end(process)
    what = f"seed {seed}, {number.name}, {whom}, --jobs {jobs}"
    tried[f"{number.name} {'pooled' if jobs == '2' else 'alone'}"] += 1
    tried["reached the run before its end"] += reached and (ended.code != 0 or whom == "a worker")
    lying = [f"{what}: {name}" for name in program.lies(out)]
    # orphans are counted on their own
    fault = replace(ended, orphans=0).fault(*_codes(number, whom))
    talk = [f"{what}: {fault}"] * bool(fault)
    # a result that had been moved aside comes back before anything is computed
    following = program.rsgen("run", *cases, "--out", out, "--jobs", "1", env=around)
    fault = following.fault(0)
    talk += [f"{what}, next run: {fault}"] * bool(fault)
    lying += [f"{what}, next run: {name}" for name in program.lies(out)]
    kept = [case for case in cases if case.stem in before]
    lost = following.out.count("unchanged") < len(kept) or len(program.verified(out)) < len(before)
    left = [f"{what}: {name}" for name in program.leftovers(out, place / "tmp", place / "cache")]
    return [lying, [what] * lost, [what] * bool(ended.orphans), left, talk]


def _undisturbed(place: Path) -> float:
    """Run two cases, then one of them, compiled before; return the seconds of the latter."""
    cases, words = place / "cases", ("--out", place / "out", "--jobs", "1", "--force")
    cases.mkdir()
    for name, k in (("one", 5920.0), ("two", 6100.0)):
        program.write_case(cases, name, k=k)
    for which in (cases, cases / "one.toml"):
        ended = program.rsgen("run", which, *words, env=program.environment(place))
        if ended.fault(0):
            raise RuntimeError(f"an undisturbed run failed: {ended.fault(0)}")
    return ended.seconds


def run(count: int, seed: int) -> list[Row]:
    tried, found = Counter[str](), []
    with program.temporary() as earlier:
        seconds = _undisturbed(earlier)
        for number in range(count):
            with program.temporary() as place:
                found.append(kill_once(1_000_000 * seed + number, place, seconds, earlier, tried))
    kinds = "; " + ", ".join(f"{times} {kind}" for kind, times in sorted(tried.items()))
    return [
        program.failures(
            f"kills of whole runs at random moments, {count}: {figure}", [*chain(*which)],
            f" of {count}{kinds if figure == FIGURES[0] else ''}",
        )
        for figure, *which in zip(FIGURES, *found, strict=True)
    ]  # fmt: skip
