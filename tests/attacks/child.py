"""Attempts in a child process: what each came to, its processor time and its peak memory."""

import gc
import multiprocessing
import os
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from rsgen.common.errors import RsgenError

WALL_SECONDS = 180.0  # an attempt without an answer for so long hangs, whatever it does meanwhile
RENEWED = 400  # attempts after which a child is replaced, so that growing caches do not hide what one takes
_LOOP = 2_000_000  # steps of a loop that shows the speed of a machine at the moment
_LOOP_SECONDS = 0.115  # what it took on the machine on which the seconds of the promises were measured


@dataclass(frozen=True)
class Outcome:
    """One attempt: its number and name, what it came to, seconds of work, MB above the start."""

    number: int
    name: str
    said: str  # begins with "result", "refused", "crash" or "hang"
    seconds: float = 0.0
    megabytes: float = 0.0


def _peak(key: str) -> float:
    """Return a figure of this process in MB; 0 where the system does not say."""
    with suppress(OSError):
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key))
    return 0.0


def said_of(attempt: Callable[[], object], longest: int = 10_000) -> str:
    """Say what an attempt comes to: a result, or a refusal, which is a sentence; warnings are errors.

    A refusal may quote a formula of 2000 characters several times.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            attempt()
        except RsgenError as fault:
            text = str(fault)
            plain = 0 < len(text) <= longest and text.replace("\n", " ").isprintable()
            return f"refused: {text}" if plain else f"crash: a refusal that is no sentence: {text[:80]!r}"
    return "result"


def measured(number: int, name: str, attempt: Callable[[], str]) -> Outcome:
    """Make an attempt here; any exception that it lets through is a crash."""
    import resource  # which Windows lacks

    gc.collect()
    with suppress(OSError):
        # the highest mark of this process begins anew
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    base, children, begun = _peak("VmRSS"), resource.getrusage(resource.RUSAGE_CHILDREN), time.process_time()
    try:
        said = attempt()
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        said = f"crash {type(error).__name__} at {place}: {' '.join(str(error).split())[:160]}"
    worked, now = time.process_time() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    worked += now.ru_utime + now.ru_stime - children.ru_utime - children.ru_stime
    # children that read files are gone by now; their peak counts where it is a new one
    grown = now.ru_maxrss / 1024 if now.ru_maxrss > children.ru_maxrss else 0.0
    taken = max(0.0, _peak("VmHWM") - base) + grown
    return Outcome(number, name, said, round(worked, 3), round(taken, 1))


def _begin(module: str) -> None:
    """Make this child a group of its own, which prints for nobody."""
    os.setsid()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    import_module(f"tests.attacks.{module}")
    # what is loaded now stays: the collection before each attempt need not look at it
    gc.freeze()


def attempts(module: str, seed: int, count: int) -> Iterator[Outcome]:
    """Make each attempt in a child; one that hangs or ends is replaced, with the processes that it began."""
    attack, done = import_module(f"tests.attacks.{module}").attack, 0
    while done < count:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=context, initializer=_begin, initargs=(module,)) as pool:
            group = pool.submit(os.getpid).result()
            try:
                for number in range(done, min(count, done + RENEWED)):
                    done = number + 1
                    yield pool.submit(attack, number, seed).result(WALL_SECONDS)
            except TimeoutError:
                yield Outcome(number, "", f"hang: no answer after {WALL_SECONDS:g} s", WALL_SECONDS)
            except BrokenExecutor:
                yield Outcome(number, "", "crash of the process")
            finally:
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(group, signal.SIGKILL)


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


def kind_of(outcome: Outcome) -> str:
    return outcome.said.split()[0].rstrip(":")


def attacked(module: str, count: int, seed: int, figure: str, kind: Callable[[Outcome], str] = kind_of):
    """Make attacks of a module in children; return the row of what got through, and how many of each kind."""
    found, slowest, largest = Counter[str](), 0.0, 0.0
    for outcome in attempts(module, seed, count):
        if kind_of(outcome) not in ("result", "refused"):
            print(f"{outcome.number}: {outcome.name}: {outcome.said}", file=sys.stderr, flush=True)
        found[kind(outcome)] += 1
        slowest, largest = max(slowest, outcome.seconds), max(largest, outcome.megabytes)
    kinds = ["crash", "hang", *(["outside"] if "outside" in figure else []), "memory"]
    text = f" ({found['refused']} refused, slowest {slowest:.1f} s, at most {largest:.0f} MB)"
    return (f"{count} {figure}", [found[name] for name in kinds], text), found
