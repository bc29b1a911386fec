"""What the tests of several packages share: small surfaces, noise, the command line, measured data."""

import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import settings

from rsgen.common.process import single_thread

# before numpy is loaded, as the program does
single_thread()

from rsgen.app.cli import main  # noqa: E402
from rsgen.files import sandbox  # noqa: E402
from rsgen.identification.ranking.library_sums import library_terms  # noqa: E402

# examples of a property in `make test` and in `make test-all`, the same in every run
settings.register_profile("quick", max_examples=20, deadline=None, derandomize=True)
settings.register_profile("thorough", settings.get_profile("quick"), max_examples=1500)
settings.load_profile("quick")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked as thorough, and say so, but for a run with the profile of that name."""
    if config.getoption("--hypothesis-profile") != "thorough":
        for item in items:
            if item.get_closest_marker("thorough"):
                item.add_marker(pytest.mark.skip(reason="thorough: make test-all runs it"))


FEW = ("cubic-spring", "quintic-spring", "coulomb", "jenkins")
"""Enough of the library where nothing depends on how many laws compete."""


@pytest.fixture
def few_laws(monkeypatch):
    """The library shrinks to ``FEW``."""
    terms = tuple(term for term in library_terms() if term.name in FEW)
    assert len(terms) == len(FEW)
    monkeypatch.setattr("rsgen.identification.ranking.selection.library_terms", lambda: terms)


class _ReadingHere(sandbox._Process):
    """In place of the confined process: its program, in this process and without limits."""

    def __init__(self, file: Any, name: str, order: dict[str, Any], seconds: float) -> None:
        self.name, said = name, io.BytesIO()
        streams = {name: SimpleNamespace(buffer=of) for name, of in (("stdin", file), ("stdout", said))}
        with patch.multiple(sys, argv=["", json.dumps(order)], **streams), patch.object(sandbox, "confine"):
            sandbox.main()
        said.seek(0)
        self.process: Any = SimpleNamespace(stdout=said)

    def __exit__(self, *_: object) -> None:
        self.process.stdout.close()


@pytest.fixture
def read_here(monkeypatch):
    """Binary files are read in this process: for tests of what they hold, not of how it is read."""
    monkeypatch.setattr(sandbox, "_Process", _ReadingHere)


@pytest.fixture
def run_cli(capsys):
    """Run a command of rsgen in this process; it leaves its exit code and what it wrote to both outputs."""
    handler = signal.getsignal(signal.SIGTERM)

    def run(*words: str | Path) -> SimpleNamespace:
        capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main([str(word) for word in words])
        assert isinstance(caught.value.code, int)
        return SimpleNamespace(code=caught.value.code, **capsys.readouterr()._asdict())

    yield run
    signal.signal(signal.SIGTERM, handler)


@pytest.fixture(scope="session")
def dead():
    """The number of a process that is over."""
    return int(subprocess.check_output([sys.executable, "-c", "import os; print(os.getpid())"]))


@pytest.fixture(scope="session")
def measured_data():
    """The folder of this name in the one that RSGEN_DATA names; the test is skipped where it is not there."""

    def find(name: str) -> Path:
        folder = os.environ.get("RSGEN_DATA")
        if not folder:
            pytest.skip("RSGEN_DATA is not set; it names the folder of measured data")
        path = Path(folder, name)
        if not path.exists():
            pytest.skip(f"{path}: not there; RSGEN_DATA names the folder of measured data")
        return path

    return find


@pytest.fixture(scope="session")
def chromium():
    from tests.report.browser import find_browser

    found = find_browser()
    if found is None:
        pytest.skip("no chromium here: no page was looked at in a browser; make test-all installs one")
    return found
