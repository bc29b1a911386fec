"""Ways to make rsgen delete or overwrite what the user has: whole commands, every file compared.

``python -m tests.attacks output``
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

from rsgen.app.study import read_manifest
from tests.attacks.program import (
    ORPHAN_SECONDS,
    Ended,
    Row,
    end,
    environment,
    row,
    rsgen,
    start,
    temporary,
    write_case,
)

NO_PROCESS = 4_194_303
"""A number of a process that hardly is one: of a run that seems to have been killed."""

WAYS: list[Callable[[Path], None]] = []
"""Each lays something of the user where a run writes, in a folder with a case and an earlier result."""


def way(attack: Callable[[Path], None]) -> Callable[[Path], None]:
    """Enter an attack in the list."""
    WAYS.append(attack)
    return attack


def _mine(path: Path, text: str = "three years of work") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@way
def folder_of_the_user(place: Path) -> None:
    """A folder of the user has the name of the case."""
    shutil.rmtree(place / "out" / "small")
    _mine(place / "out" / "small" / "thesis.tex")


@way
def file_of_the_user(place: Path) -> None:
    """A file of the user has the name of the case."""
    shutil.rmtree(place / "out" / "small")
    _mine(place / "out" / "small")


@way
def file_inside_a_result(place: Path) -> None:
    """The user keeps remarks beside the report."""
    _mine(place / "out" / "small" / "remarks.txt")


@way
def hidden_file_inside_a_result(place: Path) -> None:
    """The user keeps a repository in the result."""
    _mine(place / "out" / "small" / ".git" / "HEAD")


@way
def changed_report(place: Path) -> None:
    """The user has written into the report."""
    report = place / "out" / "small" / "report.html"
    _mine(report, report.read_text(encoding="utf-8") + "<!-- my remarks -->")


@way
def changed_notebook(place: Path) -> None:
    """The user has gone on in the notebook."""
    _mine(place / "out" / "small" / "notebook.ipynb")


@way
def forged_manifest(place: Path) -> None:
    """A manifest of the user lists other files of the user."""
    shutil.rmtree(place / "out" / "small")
    _mine(place / "out" / "small" / "thesis.tex")
    _mine(place / "out" / "small" / "manifest.json", '{"schema": 1, "files": {"../thesis.tex": "0"}}')


@way
def link_for_a_result(place: Path) -> None:
    """A link to a folder of the user has the name of the case."""
    shutil.rmtree(place / "out" / "small")
    _mine(place / "elsewhere" / "thesis.tex")
    (place / "out" / "small").symlink_to(place / "elsewhere")


@way
def link_inside_a_result(place: Path) -> None:
    """A file of the result is a link to the user's."""
    _mine(place / "thesis.tex")
    (place / "out" / "small" / "report.html").unlink()
    (place / "out" / "small" / "report.html").symlink_to(place / "thesis.tex")


@way
def index_of_the_user(place: Path) -> None:
    """The user's home page has the name of the index."""
    _mine(place / "out" / "index.html", "<html>my home page</html>")


@way
def link_for_the_index(place: Path) -> None:
    """The index is a link to a file of the user."""
    _mine(place / "home.html")
    (place / "out" / "index.html").unlink()
    (place / "out" / "index.html").symlink_to(place / "home.html")


@way
def notebook_of_a_failed_run(place: Path) -> None:
    """A notebook of the user has the name of one that failed."""
    _mine(place / "out" / "small-failed.ipynb", '{"metadata": {}, "cells": []}')


@way
def folder_named_as_an_unfinished_one(place: Path) -> None:
    """A hidden folder of the user is named as those of killed runs."""
    _mine(place / "out" / f".small.{NO_PROCESS}.part" / "thesis.tex")


@way
def folder_named_as_one_moved_aside(place: Path) -> None:
    """A hidden folder of the user is named as a result that a killed run moved aside."""
    _mine(place / "out" / f".small.{NO_PROCESS}.old" / "thesis.tex")


@way
def remarks_in_a_result_moved_aside(place: Path) -> None:
    """A run was killed between its two renames; in the earlier result are remarks of the user."""
    _mine(place / "out" / "small" / "remarks.txt")
    aside = place / "out" / f".small.{NO_PROCESS}.old"
    shutil.copytree(place / "out" / "small", aside)


def _belongings(place: Path) -> dict[str, str]:
    """Give every file of the user below a folder with what is in it; links are not followed."""
    found = {}
    for path in sorted(place.rglob("*")):
        if path.is_symlink():
            found[str(path)] = str(path.readlink())
        elif path.is_file():
            text = path.read_bytes().decode("utf-8", "replace")
            if "my " in text[-4000:] or "three years" in text or "small-failed" in path.name:
                found[str(path)] = text
    return found


def _missing(before: dict[str, str], place: Path) -> list[str]:
    """List what the user had and has no more, under any name."""
    after = _belongings(place)
    return [path for path, text in before.items() if after.get(path) != text and text not in after.values()]


def attack_once(attack: Callable[[Path], None], finished: Path) -> tuple[list[str], Ended]:
    """Lay the user's files, run with ``--force``; give what is lost, and how the run ended."""
    with temporary() as place:
        for name in ("cases", "out", "cache"):
            shutil.copytree(finished / name, place / name)
        attack(place)
        before = _belongings(place)
        if not before:
            raise RuntimeError(f"{attack.__name__} laid nothing")
        words = ("run", place / "cases" / "small.toml", "--force", "--out", place / "out")
        ended = rsgen(*words, env=environment(place))
        return _missing(before, place), ended


def file_during_a_run(finished: Path) -> tuple[list[str], Ended]:
    """The user saves a file into the earlier result while the next one is computed."""
    with temporary() as place:
        for name in ("cases", "out", "cache"):
            shutil.copytree(finished / name, place / name)
        words = ("run", place / "cases" / "small.toml", "--force", "--out", place / "out")
        process = start(words, env=environment(place))
        until = time.monotonic() + 20 * ORPHAN_SECONDS
        while not list((place / "out").glob(".small.*.part")) and time.monotonic() < until:
            time.sleep(0.01)
        _mine(place / "out" / "small" / "thesis.tex")
        before = _belongings(place)
        ended = end(process)
        return _missing(before, place), ended


def prepare(finished: Path) -> None:
    """Leave a case with its result."""
    (finished / "cases").mkdir()
    write_case(finished / "cases")
    words = ("run", finished / "cases", "--out", finished / "out")
    ended = rsgen(*words, env=environment(finished))
    if ended.fault(0) or read_manifest(finished / "out" / "small") is None:
        raise RuntimeError(f"an undisturbed run failed: {ended.fault(0)}")


def run(count: int, seed: int) -> list[Row]:
    """Try the first ``count`` ways; nothing here is left to chance."""
    lost, talk, tried = [], [], 0
    with temporary() as finished:
        prepare(finished)
        for attack in WAYS[:count]:
            gone, ended = attack_once(attack, finished)
            tried += 1
            lost += [f"{attack.__name__}: {Path(path).name}" for path in gone]
            fault = ended.fault(0, 2)
            talk += [f"{attack.__name__}: {fault}"] * bool(fault)
        if count > len(WAYS):
            gone, ended = file_during_a_run(finished)
            tried += 1
            lost += [f"file during a run: {Path(path).name}" for path in gone]
            talk += [ended.fault(2)] * bool(ended.fault(2))
    shown = {
        name: f" ({'; '.join(which[:5])})" if which else "" for name, which in (("l", lost), ("t", talk))
    }
    figure = f"files of the user where a run with --force writes, {tried} ways"
    return [
        row(f"{figure}: deleted or changed", "0", f"{len(lost)}{shown['l']}"),
        row(f"{figure}: tracebacks, hangs, wrong exit codes", "0", f"{len(talk)}{shown['t']}"),
    ]
