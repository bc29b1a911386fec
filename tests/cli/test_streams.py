"""What commands write to streams: closed, full, in few letters; faults and warnings of libraries."""

import errno
import logging
import os
import shlex
from pathlib import Path

import pytest

from rsgen.app.cli.terminal import plain
from rsgen.common.errors import program_fault
from tests.programs import RSGEN, python, start

posix = pytest.mark.skipif(os.name != "posix", reason="the full device is POSIX")


@pytest.mark.slow
@posix
@pytest.mark.parametrize(("redirections", "words", "code", "error"), [
    ("> /dev/full", "laws", 2, "standard output: cannot be written: No space left on device\n"),
    ("> /dev/full", "--help", 2, "rsgen: the system refuses what this needs: No space left on device\n"),
    ("2> /dev/full", "run absent.toml", 2, ""), ("<&- >&- 2>&-", "run absent.toml", 2, ""),
    # a reader that left does not change the code
    ("| true; exit ${PIPESTATUS[0]}", "laws", 0, ""),
])  # fmt: skip
def test_a_command_ends_well_whatever_its_streams_are(redirections, words, code, error):
    done = start("bash", "-c", f"{shlex.join(RSGEN)} {words} {redirections}", timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", error)


def test_letters_that_an_output_does_not_have_are_escaped():
    program = "from rsgen.app.cli import terminal as t; t.open_streams(); t.write_output('10 \u03a9')"
    done = python("-c", program, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.stdout, done.stderr) == ("10 \\u03a9\n", "")


def test_what_the_system_refuses_is_no_fault_of_the_program():
    refused = program_fault(PermissionError(errno.EACCES, "Permission denied", "/here"), "small.toml")
    assert refused == "small.toml: the system refuses what this needs: Permission denied: /here"
    assert "too little memory" in program_fault(MemoryError(), "small.toml")
    assert "cannot be loaded" in program_fault(ImportError("failed to map segment"), "small.toml")
    assert "this is a fault of rsgen" in program_fault(ZeroDivisionError("odd"), "small.toml")


def test_spaces_are_blanks_and_control_characters_are_shown():
    assert plain("180\u202f000 \u00d7\u00a01") == "180 000 \u00d7 1"
    assert plain("a\x1b[31m\nb\u2028end\u202e") == "a\\x1b[31m\\nb\\u2028end\\u202e"


PROGRAM = """
import logging, sys, warnings
import rsgen.app.cli.laws_command as command
def odd():
    warnings.warn("raw text of a library", RuntimeWarning)
    logging.getLogger("matplotlib").warning("message of a library")
    {act}
    return 0
command.laws_command = odd
from rsgen.app.cli import main
main(["laws"])
"""


@pytest.mark.slow
def test_a_warning_of_a_library_stays_off_the_terminal_and_a_fault_of_the_program_is_one_sentence():
    run = python("-c", PROGRAM.format(act="print('done')"))
    assert (run.returncode, run.stdout, run.stderr) == (0, "done\n", "")
    faulty = PROGRAM.format(act="raise ZeroDivisionError('of\\nthe program')")
    run = python("-c", faulty)
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (2, "", 1)
    assert run.stderr.startswith("rsgen: ZeroDivisionError: of the program; this is a fault of rsgen")
    # who asks sees both
    run = python("-c", faulty, env={**os.environ, "RSGEN_DEBUG": "1"})
    assert all(part in run.stderr for part in ("raw text of a library", "Traceback", "in odd"))


def test_check_names_the_case_of_a_fault_of_the_program_and_goes_on(run_cli, monkeypatch, request):
    request.addfinalizer(lambda: logging.captureWarnings(False))

    def odd(case: object) -> list[str]:
        if case.name == "cubic":
            raise ZeroDivisionError("odd")
        return []

    monkeypatch.setattr("rsgen.app.cli.check_command.law_faults", odd)
    cases = Path(__file__).parents[2] / "cases"
    checked = run_cli("check", cases / "cubic.toml", cases / "quintic.toml")
    assert (checked.code, checked.out.startswith("quintic: "), checked.err.count("\n")) == (2, True, 1)
    said = f"{cases / 'cubic.toml'}: ZeroDivisionError: odd; this is a fault of rsgen"
    assert checked.err.startswith(said)
