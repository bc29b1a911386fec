"""Streams that are closed, full or poor in letters: a sentence and the right code, and the work goes on."""

import errno
import io
import os
import subprocess
import sys
from collections.abc import Callable

import pytest

from rsgen.app.cli import terminal as streams
from rsgen.common.errors import program_fault

posix = pytest.mark.skipif(os.name != "posix", reason="the full device is POSIX")


class Broken(io.StringIO):
    """A stream that takes nothing."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number
        self.silenced = False

    def write(self, text: str) -> int:
        if not self.silenced:
            raise OSError(self.number, os.strerror(self.number))
        return len(text)

    def flush(self) -> None:
        self.write("")


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, str], Broken]:
    def put(number: int, name: str) -> Broken:
        stream = Broken(number)
        monkeypatch.setattr(sys, name, stream)
        monkeypatch.setattr(streams, "_silence", lambda which: setattr(which, "silenced", True))
        return stream

    streams.open_streams()
    return put


def test_a_reader_that_left_is_no_fault(broken):
    stream = broken(errno.EPIPE, "stdout")
    streams.write_output("a line", flush=True)
    streams.write_output("another", flush=True)
    assert stream.silenced
    assert streams.output_fault() is None


def test_a_full_output_is_said_once_at_the_end(broken):
    broken(errno.ENOSPC, "stdout")
    streams.write_output("a line", flush=True)
    streams.write_output("another", flush=True)
    assert streams.output_fault() == "standard output: cannot be written: No space left on device"
    streams.open_streams()
    assert streams.output_fault() is None


def test_errors_that_nobody_reads_stop_nothing(broken):
    assert not broken(errno.ENOSPC, "stderr").silenced
    streams.write_error("a fault")
    assert sys.stderr.silenced


def _shell(redirections: str, words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    line = f"{sys.executable} -c 'from rsgen.app.cli import main; main()' {words} {redirections}"
    return subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={**os.environ, **variables},
    )


@pytest.mark.slow
@posix
@pytest.mark.parametrize(
    ("redirections", "words", "code", "error"),
    [
        ("> /dev/full", "laws", 2, "standard output: cannot be written: No space left on device\n"),
        ("> /dev/full", "--help", 2, "rsgen: the system refuses what this needs: No space left on device\n"),
        ("2> /dev/full", "run absent.toml", 2, ""),
        ("> /dev/full 2> /dev/full", "laws", 2, ""),
        (">&-", "laws", 0, ""),
        ("<&- >&- 2>&-", "run absent.toml", 2, ""),
    ],
)
def test_a_command_ends_well_whatever_its_streams_are(redirections, words, code, error):
    done = _shell(redirections, words)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", error)


@pytest.mark.slow
@posix
def test_a_reader_that_left_does_not_change_the_code():
    done = _shell("| true; exit ${PIPESTATUS[0]}", "laws")
    assert (done.returncode, done.stderr) == (0, "")


def test_letters_that_an_output_does_not_have_are_escaped():
    program = "from rsgen.app.cli import terminal as t; t.open_streams(); t.write_output('10 \u03a9')"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert (done.stdout, done.stderr) == ("10 \\u03a9\n", "")


@posix
def test_a_limit_that_would_end_the_process_is_refused():
    limited = subprocess.run(
        ["bash", "-c", f"ulimit -v 300000; {sys.executable} -m rsgen laws"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (limited.returncode, limited.stdout) == (2, "")
    assert limited.stderr.startswith("ulimit -v: memory is limited to 292 MB; at least 400 MB are needed")


def test_what_the_system_refuses_is_no_fault_of_the_program():
    refused = program_fault(PermissionError(errno.EACCES, "Permission denied", "/here"), "small.toml")
    assert refused == "small.toml: the system refuses what this needs: Permission denied: /here"
    assert "too little memory" in program_fault(MemoryError(), "small.toml")
    assert "cannot be loaded" in program_fault(ImportError("failed to map segment"), "small.toml")
    assert "this is a fault of rsgen" in program_fault(ZeroDivisionError("odd"), "small.toml")
