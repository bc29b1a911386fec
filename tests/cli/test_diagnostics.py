"""Neither a warning of a library nor a traceback reaches the terminal unasked."""

import logging
import os
from pathlib import Path

import pytest

from tests.programs import python

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
def test_a_warning_of_a_library_stays_off_the_terminal():
    run = python("-c", PROGRAM.format(act="print('done')"))
    assert (run.returncode, run.stdout, run.stderr) == (0, "done\n", "")


def test_a_fault_of_the_program_is_one_sentence():
    run = python("-c", PROGRAM.format(act="raise ZeroDivisionError('of\\nthe program')"))
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("rsgen: ZeroDivisionError: of the program; this is a fault of rsgen")
    assert run.stderr.count("\n") == 1


@pytest.mark.slow
def test_who_asks_sees_both():
    program = PROGRAM.format(act="raise ZeroDivisionError('of the program')")
    run = python("-c", program, env={**os.environ, "RSGEN_DEBUG": "1"})
    assert "raw text of a library" in run.stderr
    assert "Traceback" in run.stderr
    assert "in odd" in run.stderr


@pytest.fixture
def _log_as_it_was():
    yield
    logging.captureWarnings(False)


@pytest.mark.usefixtures("_log_as_it_was")
def test_check_names_the_case_of_a_fault_of_the_program_and_goes_on(run_cli, monkeypatch):
    def odd(case: object) -> list[str]:
        if case.name == "cubic":
            raise ZeroDivisionError("odd")
        return []

    monkeypatch.setattr("rsgen.app.cli.check_command.law_faults", odd)
    cases = Path(__file__).parents[2] / "cases"
    checked = run_cli("check", cases / "cubic.toml", cases / "quintic.toml")
    assert checked.code == 2
    assert checked.out.startswith("quintic: ")
    said = f"{cases / 'cubic.toml'}: ZeroDivisionError: odd; this is a fault of rsgen"
    assert checked.err.startswith(said)
    assert checked.err.count("\n") == 1
