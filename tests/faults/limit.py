"""A pytest plugin: tests that fail are written to a file; those that take too long are left out, not failed.

RSGEN_FAULTS_FAILED names the file, RSGEN_FAULTS_LIMIT the seconds that a test may take.
"""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

LIMIT = float(os.environ.get("RSGEN_FAULTS_LIMIT", "60"))


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
