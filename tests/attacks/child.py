"""Attempts in a child process: what each came to, its processor time and its peak memory."""

import argparse
import gc
import multiprocessing
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path

WALL_SECONDS = 180.0
"""An attempt without an answer for so long hangs, whatever it does meanwhile."""
RENEWED = 400
"""Attempts after which a child is replaced: caches grow, and what one attempt takes must stay visible."""
_LOOP = 2_000_000
"""Steps of a loop that shows the speed of a machine at the moment."""
_LOOP_SECONDS = 0.115
"""What it took on the machine on which the seconds of the promises were measured."""
_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Outcome:
    """One attempt: its number and name, what it came to, seconds of work, MB above the start.

    ``said`` begins with "result", "refused", "crash" or "hang".
    """

    number: int
    name: str
    said: str
    seconds: float = 0.0
    megabytes: float = 0.0


def _peak(key: str) -> float:
    """Give a figure of this process in MB; 0 where the system does not say."""
    with suppress(OSError):
        for line in _STATUS.read_text(encoding="ascii").splitlines():
            if line.startswith(key):
                return int(line.split()[1]) / 1024
    return 0.0


def _worked() -> float:
    return time.process_time() + sum(os.times()[2:4])


def _children() -> float:
    try:
        import resource
    except ImportError:
        return 0.0
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def measured(number: int, name: str, attempt: Callable[[], str]) -> Outcome:
    """Make an attempt here; any exception that it lets through is a crash."""
    gc.collect()
    with suppress(OSError):
        # the highest mark of this process begins anew
        _CLEAR.write_text("5", encoding="ascii")
    base, children, begun = _peak("VmRSS"), _children(), _worked()
    try:
        said = attempt()
    except Exception as error:
        last = error.__traceback__
        while last is not None and last.tb_next is not None:
            last = last.tb_next
        place = f"{Path(last.tb_frame.f_code.co_filename).name}:{last.tb_lineno}" if last else ""
        said = f"crash {type(error).__name__} at {place}: {' '.join(str(error).split())[:160]}"
    worked = _worked() - begun
    # children that read files are gone by now; their peak counts where it is a new one
    grown = _children()
    taken = max(0.0, _peak("VmHWM") - base) + (grown if grown > children else 0.0)
    return Outcome(number, name, said, round(worked, 3), round(taken, 1))


def _serve(module: str, seed: int, pipe: Connection) -> None:
    """Answer numbers with outcomes, until the process is ended."""
    os.setsid()
    # what the attempts print is for nobody
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    attack = import_module(f"tests.attacks.{module}").attack
    # what is loaded now stays: the collection before each attempt need not look at it
    gc.freeze()
    while True:
        pipe.send(attack(pipe.recv(), seed))


class _Child:
    def __init__(self, module: str, seed: int) -> None:
        context, self.done = multiprocessing.get_context("spawn"), 0
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(module, seed, theirs))
        self.process.start()
        theirs.close()

    def ask(self, number: int) -> Outcome:
        self.done += 1
        try:
            self.pipe.send(number)
            if not self.pipe.poll(WALL_SECONDS):
                return Outcome(number, "", f"hang: no answer after {WALL_SECONDS:g} s", WALL_SECONDS)
            return self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            return Outcome(number, "", f"crash of the process: code {self.process.exitcode}")

    def end(self) -> None:
        """End the process, and those that it began."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.process.join()
        self.pipe.close()


def attempts(module: str, seed: int, numbers: Iterable[int]) -> Iterator[Outcome]:
    """Make attacks of a module in children, one after the other."""
    child: _Child | None = None
    try:
        for number in numbers:
            child = child or _Child(module, seed)
            outcome = child.ask(number)
            if not outcome.name or child.done >= RENEWED:
                child.end()
                child = None
            yield outcome
    finally:
        if child is not None:
            child.end()


def allowed(seconds: float) -> float:
    """Give the seconds here and now that are so many on the machine of the promise; no fewer on a faster one.

    On a machine shared with others the seconds of a processor grow as well; a loop shows by how much.
    """
    begun, total = time.process_time(), 0
    for step in range(_LOOP):
        total += step * step % 7
    return seconds * max(1.0, (time.process_time() - begun) / _LOOP_SECONDS)


def judged(outcome: Outcome, seconds: float, megabytes: float) -> Outcome:
    """Call what took longer a hang, on the machine of the promise, and too much memory by its name."""
    if outcome.seconds > seconds and outcome.seconds > allowed(seconds):
        return replace(outcome, said=f"hang: {outcome.seconds} s")
    if outcome.megabytes > megabytes:
        return replace(outcome, said="memory: over the bound")
    return outcome


@dataclass
class Tally:
    """How many outcomes there were of each kind, and the most that one took."""

    kinds: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    largest: float = 0.0

    @property
    def text(self) -> str:
        """What did no harm, and the most that one took."""
        refused = self.kinds["refused"]
        return f"({refused} refused, slowest {self.slowest:.1f} s, at most {self.largest:.0f} MB)"


def kind_of(outcome: Outcome) -> str:
    return outcome.said.split()[0].rstrip(":")


def tally(outcomes: Iterable[Outcome], kind: Callable[[Outcome], str] = kind_of) -> Tally:
    found = Tally()
    for outcome in outcomes:
        if kind_of(outcome) not in ("result", "refused"):
            print(f"{outcome.number}: {outcome.name}: {outcome.said}", file=sys.stderr, flush=True)
        found.kinds[kind(outcome)] += 1
        found.slowest = max(found.slowest, outcome.seconds)
        found.largest = max(found.largest, outcome.megabytes)
    return found


def attacked(module: str, count: int, seed: int, figure: str, kind: Callable[[Outcome], str] = kind_of):
    """Make attacks of a module in children; return the row of what got through, and the tally."""
    found = tally(attempts(module, seed, range(count)), kind)
    kinds = ["crash", "hang", *(["outside"] if "outside" in figure else []), "memory"]
    numbers = ", ".join(str(found.kinds[name]) for name in kinds)
    asked = ", ".join("0" for _ in kinds)
    return {"figure": f"{count} {figure}", "asked": asked, "measured": f"{numbers} {found.text}"}, found


def command(attack, content=lambda number, seed: "") -> None:
    """Make one attack again, and show what it consists of."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, required=True)
    chosen = parser.parse_args()
    print(content(chosen.only, chosen.seed), attack(chosen.only, chosen.seed))
