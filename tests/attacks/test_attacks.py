"""A small part of the attacks; where other tests make the same attack, only what the table is made of."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

from tests.attacks import __main__ as table
from tests.attacks import around_files, cache, kills, many, output
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
from tests.attacks.surroundings import tried_here

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, limits and mounts are POSIX")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "attack",
    [around_files.reader_that_leaves, around_files.name_too_long, around_files.deleted_folder_relative],
    ids=lambda attack: attack.__name__,
)
def test_surroundings_that_end_a_command(attack: Callable[[Path], str], tmp_path: Path) -> None:
    assert attack(tmp_path) == ""


ATTACKS = {
    "kills": 10,
    "pool": 2,
    "cache": 6,
    "output": 30,
    "readers": 200,
    "expressions": 150,
    "loops": 40,
    "cases": 400,
    "surroundings": 12,
    "many": 12,
    "large": 10_000,
}


@pytest.mark.thorough
@pytest.mark.parametrize("module", table.COUNTS)
def test_a_few_attacks_of_each_kind(module: str) -> None:
    rows = import_module(f"tests.attacks.{module}").run(ATTACKS[module], seed=1)
    assert [row for row in rows if not reached(row)] == []


# ---------------------------------------------------------------- what the attacks are judged by


def test_what_is_wrong_with_an_end_is_seen() -> None:
    assert Ended(0, "done\n", "", 1.0, 0).fault(0) == ""
    assert "hung" in Ended(None, "", "", 9.0, 0).fault(0)
    assert "Traceback" in Ended(2, "", "Traceback (most recent call last):\n", 1.0, 0).fault(2)
    assert "exit code 1" in Ended(1, "", "", 1.0, 0).fault(0, 2)
    assert "processes left" in Ended(0, "", "", 1.0, 3).fault(0)


@pytest.mark.slow
def test_a_process_that_stays_is_an_orphan(tmp_path: Path) -> None:
    stays = 'import subprocess; subprocess.Popen(["sleep", "60"], stdout=-3, stderr=-3)'
    ended = rsgen(command=[table.sys.executable, "-c", stays], env=environment(tmp_path))
    assert (ended.code, ended.orphans) == (0, 1)


def test_half_a_result_lies_and_hidden_files_are_left(tmp_path: Path) -> None:
    out, temporary = tmp_path / "out", tmp_path / "tmp"
    for folder in (out / "case", out / ".case.1.part", temporary / "x"):
        folder.mkdir(parents=True)
    (out / "index.html").write_text("<html>half of")
    assert lies(out) == ["case", "index.html"]
    assert leftovers(out, temporary) == ["out/.case.1.part", "tmp/x"]
    assert verified(out) == {}


def test_what_is_missing_of_the_users_files_is_seen(tmp_path: Path) -> None:
    output.folder_named_as_an_unfinished_one(tmp_path)
    before = output._belongings(tmp_path)
    assert len(before) == 1
    assert output._missing(before, tmp_path) == []
    Path(next(iter(before))).unlink()
    assert output._missing(before, tmp_path) == list(before)


def test_every_attack_has_a_name_of_its_own_and_says_what_it_does() -> None:
    lists = (tried_here(), output.WAYS, [*cache.WAYS, *cache.WAYS_OF_ROOT])
    for attacks in lists:
        assert len({attack.__name__ for attack in attacks}) == len(attacks)
        assert all(attack.__doc__ for attack in attacks)
    assert [len(attacks) >= least for attacks, least in zip(lists, (20, 5, 4), strict=True)] == [True] * 3
    # twelve damaged the key beside the kernels, which is gone
    assert len(cache.DAMAGES) + len(cache.FURTHER) >= 21


def test_a_module_renews_its_own_rows_of_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "TABLE", tmp_path / "attacks.md")
    for module, measured in (("many", "0 of 3"), ("kills", "1 of 2"), ("many", "0 | of\n4")):
        rows = [row("figure", "0", measured)]
        found = {"many": many, "kills": kills}[module]
        monkeypatch.setattr(found, "run", lambda count, seed, rows=rows: rows)
        assert table.main([f"{module}=2"]) == (measured == "1 of 2")
    text = (tmp_path / "attacks.md").read_text(encoding="utf-8")
    assert "0 of 3" not in text
    assert "| figure | 0 | 0 / of 4 |" in text
    # the order of the modules, whichever came first
    assert text.index("## kills: ") < text.index("| figure | 0 | 1 of 2 |") < text.index("## many: ")
    assert table.main(["nonsense"]) == 2


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
def test_a_figure_is_reached_or_for_a_reader(asked: str, measured: str, wanted: bool) -> None:
    assert reached(row("", asked, measured)) is wanted
