"""A small part of the attacks; where other tests make the same attack, only what the table is made of."""

import os
from importlib import import_module
from pathlib import Path

import pytest

from tests.attacks import __main__ as table
from tests.attacks import output
from tests.attacks.program import (
    Ended,
    environment,
    leftovers,
    lies,
    reached,
    row,
    rsgen,
    verified,
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, limits and mounts are POSIX")


ATTACKS = {
    "kills": 10,
    "pool": 2,
    "cache": 6,
    "output": 30,
    "readers": 200,
    "expressions": 150,
    "loops": 40,
    "cases": 400,
    "surroundings": 24,
    "many": 12,
}


@pytest.mark.thorough
@pytest.mark.parametrize("module", table.COUNTS)
def test_a_few_attacks_of_each_kind(module):
    rows = import_module(f"tests.attacks.{module}").run(ATTACKS[module], seed=1)
    assert [row for row in rows if not reached(row)] == []


# ---------------------------------------------------------------- what the attacks are judged by


def test_what_is_wrong_with_an_end_is_seen():
    assert Ended(0, "done\n", "", 1.0, 0).fault(0) == ""
    assert "hung" in Ended(None, "", "", 9.0, 0).fault(0)
    assert "Traceback" in Ended(2, "", "Traceback (most recent call last):\n", 1.0, 0).fault(2)
    assert "exit code 1" in Ended(1, "", "", 1.0, 0).fault(0, 2)
    assert "processes left" in Ended(0, "", "", 1.0, 3).fault(0)


@pytest.mark.slow
def test_a_process_that_stays_is_an_orphan(tmp_path):
    stays = 'import subprocess; subprocess.Popen(["sleep", "60"], stdout=-3, stderr=-3)'
    ended = rsgen(command=[table.sys.executable, "-c", stays], env=environment(tmp_path))
    assert (ended.code, ended.orphans) == (0, 1)


def test_half_a_result_lies_and_hidden_files_are_left(tmp_path):
    out, temporary = tmp_path / "out", tmp_path / "tmp"
    for folder in (out / "case", out / ".case.1.part", temporary / "x"):
        folder.mkdir(parents=True)
    (out / "index.html").write_text("<html>half of")
    assert lies(out) == ["case", "index.html"]
    assert leftovers(out, temporary) == ["out/.case.1.part", "tmp/x"]
    assert verified(out) == {}


def test_what_is_missing_of_the_users_files_is_seen(tmp_path):
    output.WAYS["folder named as an unfinished one"](tmp_path, tmp_path / "small")
    before = output._belongings(tmp_path)
    assert len(before) == 1
    assert output._missing(before, tmp_path) == []
    Path(next(iter(before))).unlink()
    assert output._missing(before, tmp_path) == list(before)


@pytest.mark.parametrize(
    ("asked", "measured", "wanted"),
    [
        ("0", "0 of 9", True),
        ("0", "1 of 9", False),
        ("0, 0, 0", "0, 0, 0 (4 refused)", True),
        ("0, 0, 0", "0, 1, 0 (4 refused)", False),
        ("31 of 31", "30 of 31", False),
        ("2", "24 of 24", False),
        ("flat", "2 MB", True),
        ("8.3 s, 593 MB; 1.7 s", "9 s", True),
    ],
)
def test_a_figure_is_reached_or_for_a_reader(asked, measured, wanted):
    assert reached(row("", asked, measured)) is wanted
