"""A run of six cases on two processes, one of which is killed: what the others come to.

``python -m tests.attacks pool=20``
"""

import os
import random
import signal
import time
from contextlib import suppress
from pathlib import Path

from tests.attacks import program
from tests.attacks.program import Row

CASES = 6

Killed = tuple[int, int, list[str]]
"""Cases finished, others than that of the worker among them, and what else went wrong."""

_LATEST = 2.5
"""Seconds after the beginning of a case until which its worker is killed: about what a case takes."""


def _begun(out: Path, name: str, seconds: float) -> int | None:
    """Wait until a case is worked on; give the number of its process, which its hidden folder names."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        for folder in out.glob(f".{name}.*.part"):
            return int(folder.name.split(".")[2])
        time.sleep(0.01)
    return None


def kill_a_worker(seed: int, place: Path, cache: Path) -> Killed:
    """Kill the worker of one case; give cases finished, others among them, and what else went wrong."""
    chance = random.Random(seed)
    folder, out = place / "cases", place / "out"
    folder.mkdir()
    names = [f"case{number}" for number in range(CASES)]
    for number, name in enumerate(names):
        program.write_case(folder, name, k=5920.0 + 50 * number)
    around = program.environment(place, RSGEN_CACHE=str(cache))
    process = program.start(("run", folder, "--out", out, "--jobs", "2"), env=around)
    victim = chance.choice(names)
    worker = _begun(out, victim, program.HANG_SECONDS)
    time.sleep(chance.uniform(0.0, _LATEST))
    if worker is not None and process.poll() is None:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
    ended = program.end(process)
    finished = program.verified(out)
    wrong = [ended.fault(0)] if ended.fault(0) else []
    wrong += program.lies(out) + program.leftovers(place / "tmp")
    if worker is None:
        wrong.append(f"{victim} was never begun")
    return len(finished), len(finished.keys() - {victim}), [f"seed {seed}: {text}" for text in wrong]


def run(count: int, seed: int) -> list[Row]:
    finished, others, wrong = [], [], []
    with program.temporary() as cache:
        for number in range(count):
            with program.temporary() as place:
                found = kill_a_worker(1_000_000 * seed + number, place, cache / "kernels")
            finished.append(found[0])
            others.append(found[1])
            wrong += found[2]
    held = sum(number == CASES - 1 for number in others)
    figure = f"one worker killed in a run of {CASES}, {count} times"
    whole = CASES * count
    return [
        program.row(f"{figure}: runs in which all others finished", f"{count}", f"{held} of {count}"),
        program.row(
            f"{figure}: cases finished, with that of the lost worker",
            f"{whole}",
            f"{sum(finished)} of {whole}",
        ),
        program.failures(f"{figure}: faults", wrong),
    ]
