"""Streams that are closed, full or poor in letters: a sentence and the right code, and the work goes on."""

import errno
import os
import shlex
import subprocess
import sys

import pytest

from rsgen.common.errors import program_fault
from tests.programs import RSGEN, python, start

posix = pytest.mark.skipif(os.name != "posix", reason="the full device is POSIX")


def redirected(words: str, redirections: str) -> subprocess.CompletedProcess[str]:
    return start("bash", "-c", f"{shlex.join(RSGEN)} {words} {redirections}", timeout=60)


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
    done = redirected(words, redirections)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", error)


@pytest.mark.slow
@posix
def test_a_reader_that_left_does_not_change_the_code():
    done = redirected("laws", "| true; exit ${PIPESTATUS[0]}")
    assert (done.returncode, done.stderr) == (0, "")


def test_letters_that_an_output_does_not_have_are_escaped():
    program = "from rsgen.app.cli import terminal as t; t.open_streams(); t.write_output('10 \u03a9')"
    done = python("-c", program, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.stdout, done.stderr) == ("10 \\u03a9\n", "")


@posix
def test_a_limit_that_would_end_the_process_is_refused():
    limited = start("bash", "-c", f"ulimit -v 300000; {sys.executable} -m rsgen laws")
    assert (limited.returncode, limited.stdout) == (2, "")
    assert limited.stderr.startswith("ulimit -v: memory is limited to 292 MB; at least 400 MB are needed")


def test_what_the_system_refuses_is_no_fault_of_the_program():
    refused = program_fault(PermissionError(errno.EACCES, "Permission denied", "/here"), "small.toml")
    assert refused == "small.toml: the system refuses what this needs: Permission denied: /here"
    assert "too little memory" in program_fault(MemoryError(), "small.toml")
    assert "cannot be loaded" in program_fault(ImportError("failed to map segment"), "small.toml")
    assert "this is a fault of rsgen" in program_fault(ZeroDivisionError("odd"), "small.toml")
