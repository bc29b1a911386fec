"""Many small cases in one run: the time and the memory of a case, from the first to the last.

``python -m tests.attacks many=500``
"""

import time
from itertools import pairwise
from pathlib import Path
from statistics import median

from tests.attacks import program
from tests.attacks.program import Row

WINDOW = 25
"""Cases whose median is compared: one case may be disturbed by other programs."""

FIRST = 50
"""The window that ends here is compared with the last one."""


def _seconds_of_work(process: int) -> float:
    """Processor seconds of a process, by the system's count of a hundredth each."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100


def _status(process: int, key: str) -> float:
    """A size in the status of a process [MB]."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith(f"{key}:"):
            return int(line.split()[1]) / 1024
    return 0.0


def watch(count: int, place: Path) -> tuple[list[tuple[float, float, int]], list[str]]:
    """Run cases in one process; give seconds of work, memory and open files after each, and faults."""
    (place / "cases").mkdir()
    for number in range(count):
        program.write_case(place / "cases", f"case{number:04d}", k=5000.0 + 2 * number)
    words = ("run", place / "cases", "--out", place / "out", "--jobs", "1")
    with (place / "errors").open("w") as errors:
        process = program.start(words, env=program.environment(place), stderr=errors, bufsize=1)
        seen = []
        for line in process.stdout or ():
            # a line a finished case
            if line.startswith("case") and program.session(process.pid):
                files = len(list(Path(f"/proc/{process.pid}/fd").iterdir()))
                seen.append((_seconds_of_work(process.pid), _status(process.pid, "VmRSS"), files))
        ended = program.end(process)
    wrong = [fault] if (fault := ended.fault(0)) else []
    if len(program.verified(place / "out")) != count:
        wrong.append(f"{len(program.verified(place / 'out'))} results of {count}")
    return seen, wrong


def run(count: int, seed: int) -> list[Row]:
    started = time.monotonic()
    with program.temporary() as place:
        seen, wrong = watch(count, place)
    first = min(FIRST, len(seen) // 2)
    window = min(WINDOW, first - 1)
    steps = [later[0] - before[0] for before, later in pairwise(seen)]
    early, late = median(steps[first - 1 - window : first - 1]), median(steps[-window:])
    (_, memory, files), (_, memory_late, files_late) = seen[first - 1], seen[-1]
    figure = f"{count} small cases in one process, from case {first} to {len(seen)}"
    took = f"({time.monotonic() - started:.0f} s in all)"
    return [
        program.row(f"{figure}: processor seconds a case", "flat", f"{early:.2f} s to {late:.2f} s {took}"),
        program.row(f"{figure}: memory", "flat", f"{memory:.0f} MB to {memory_late:.0f} MB"),
        program.row(f"{figure}: open files", "flat", f"{files} to {files_late}"),
        program.failures(f"{figure}: faults", wrong),
    ]
