"""Every fault of the table, in a copy of the package: does a test see it?  ``reports/faults.md``

``python -m tests.faults`` takes all faults with the tests that the table names for them;
``python -m tests.faults kernel uff-conjugate`` takes those whose name, group or function holds one of the
words, and writes no report. The checkout is not touched.
"""

import sys
import tempfile
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.faults.scratch import Ran, Scratch
from tests.faults.table import GROUPS, Fault, FaultError, load_faults

ROOT = Path(__file__).parents[2]
REPORT = ROOT / "reports" / "faults.md"

HEAD = """\
# Faults

Small errors that a refactoring might make, put one at a time into a copy of the package, and the test that
sees each. `make faults` renews this file; the faults stand in
[tests/faults/faults.toml](../tests/faults/faults.toml).

"""


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a fault: the tests that see it, and whether they are those of the table."""

    fault: Fault
    seen: tuple[str, ...]
    seconds: float
    said: str = ""

    @property
    def good(self) -> bool:
        """Whether every test that the table names sees it."""
        return set(self.seen) == set(self.fault.caught) and not self.said


def fails(test: str, failed: Collection[str]) -> bool:
    """Whether a test is among those that failed; without brackets with any of its parameters."""
    return any(other == test or other.startswith(f"{test}[") for other in failed)


def examine(scratch: Scratch, fault: Fault, blind: Collection[str]) -> Result:
    """Put a fault into the copy and run its tests; ``blind`` are tests that fail without any."""
    started = time.monotonic()
    try:
        with scratch.with_fault(fault):
            ran = scratch.run(fault.caught)
        seen = tuple(test for test in fault.caught if fails(test, ran.failed) and not fails(test, blind))
        said = ran.broken
    except FaultError as stale:
        seen, said = (), str(stale)
    return Result(fault, seen, time.monotonic() - started, said)


def report(results: Sequence[Result], minutes: float) -> str:
    seen = sum(bool(result.seen) for result in results)
    text = HEAD + f"{len(results)} faults, {seen} of them seen, in {minutes:.0f} minutes; "
    text += "with each stand the seconds that its test took, the start of a process among them.\n"
    for group in GROUPS:
        text += f"\n## {group[0].upper()}{group[1:]}\n\n"
        text += "| fault | what it means | seen by | s |\n| --- | --- | --- | --- |\n"
        for result in (one for one in results if one.fault.group == group):
            ids = (test.removeprefix("tests/").replace("|", "\\|") for test in result.seen)
            by = "<br>".join(f"`{test}`" for test in ids) or "**no test**"
            text += f"| `{result.fault.name}` | {result.fault.means} | {by} | {result.seconds:.0f} |\n"
    return text


def main(words: Sequence[str]) -> int:
    faults = load_faults()
    if words:
        named = ((fault, f"{fault.name} {fault.group} {fault.function}") for fault in faults)
        faults = tuple(fault for fault, text in named if any(word in text for word in words))
    guards = tuple(dict.fromkeys(test for fault in faults for test in fault.caught))
    started, results = time.monotonic(), list[Result]()
    with tempfile.TemporaryDirectory(prefix="rsgen-faults-") as folder:
        scratch = Scratch.of(ROOT, Path(folder))
        ran = scratch.run(guards) if guards else Ran((), "")
        for test in ran.failed:
            print(f"{test} fails without any fault", flush=True)
        if ran.broken:
            print(f"without any fault: {ran.broken}", flush=True)
        for fault in faults:
            results.append(result := examine(scratch, fault, ran.failed))
            verdict = ", ".join(result.seen) or "NOT SEEN"
            more = "" if result.good else f"; the table names {', '.join(fault.caught)}; {result.said}"
            print(f"{fault.name}: {verdict} ({result.seconds:.0f} s){more}", flush=True)
    minutes = (time.monotonic() - started) / 60
    print(f"{sum(bool(r.seen) for r in results)} of {len(results)} faults are seen; {minutes:.1f} minutes")
    if not words:
        REPORT.write_text(report(results, minutes), encoding="utf-8")
    return 0 if not ran.failed and not ran.broken and all(result.good for result in results) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
