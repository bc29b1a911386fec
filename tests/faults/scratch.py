"""A copy of the checkout in which one file at a time is faulty, and tests run in it.

There this is a plugin of pytest: tests that fail are written to a file, which RSGEN_FAULTS_FAILED names;
those that take too long are left out, not failed.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import pytest

from tests.faults.table import Fault, find_place

LIMIT = 60
"""Seconds that a test may take; longer ones are no guards."""

_PARTS = ("rsgen", "tests", "cases", "docs", "templates", "benchmarks", "reports")
"""Folders that tests read."""


@dataclass(frozen=True, slots=True)
class Ran:
    """Tests that failed, and what kept pytest from running them ("" where nothing did)."""

    failed: tuple[str, ...]
    broken: str


@dataclass(frozen=True, slots=True)
class Scratch:
    """A copy of the checkout at ``root``; compiled kernels in folders beside it."""

    root: Path
    caches: Path
    _number: Iterator[int]

    @classmethod
    def of(cls, checkout: Path, folder: Path) -> Scratch:
        root = folder / "checkout"
        root.mkdir()
        for name in _PARTS:
            if (checkout / name).is_dir():
                shutil.copytree(checkout / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
        for path in checkout.iterdir():
            if path.is_file() and path.suffix in (".toml", ".md", ".cff", ".txt", ""):
                shutil.copy2(path, root)
        return cls(root, folder / "caches", count(1))

    @contextmanager
    def with_fault(self, fault: Fault) -> Iterator[None]:
        """Put a fault into the copy for a while.

        Compiled kernels are stored by the hash of their source, which a fault in a law or a template changes.
        """
        place = find_place(fault, self.root)
        file = self.root / place.file
        try:
            self._write(file, place.replaced(fault))
            yield
        finally:
            self._write(file, place.text)

    def _write(self, file: Path, text: str) -> None:
        """Write a file so that nobody takes the compiled one of before: its time differs by seconds."""
        file.write_text(text, encoding="utf-8")
        time = 1_000_000_000 + 10 * next(self._number)
        os.utime(file, (time, time))

    def run(self, tests: Sequence[str]) -> Ran:
        self.caches.mkdir(mode=0o700, exist_ok=True)
        failed = self.root.with_name("failed.txt")
        failed.write_text("", encoding="utf-8")
        environment = os.environ | {
            "PYTHONPATH": str(self.root), "RSGEN_CACHE": str(self.caches), "RSGEN_FAULTS_FAILED": str(failed),
        }  # fmt: skip
        command = [sys.executable, "-m", "pytest", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider"]
        command += ["-p", "tests.faults.scratch", *tests]
        done = subprocess.run(command, cwd=self.root, env=environment, capture_output=True, text=True)
        broken = "" if done.returncode in (0, 1, 5) else (done.stdout + done.stderr).strip()[-500:]
        return Ran(tuple(dict.fromkeys(failed.read_text(encoding="utf-8").splitlines())), broken)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    signal.signal(signal.SIGALRM, lambda *_: pytest.skip(f"longer than {LIMIT:g} s"))
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        with Path(os.environ["RSGEN_FAULTS_FAILED"]).open("a", encoding="utf-8") as file:
            file.write(f"{report.nodeid}\n")
