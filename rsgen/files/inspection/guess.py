"""What is left of a file's arrays while a case is guessed, and what was taken from them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from rsgen.files.inspection.beside import name_beside, plain_unit, unit_beside, unit_within
from rsgen.files.inspection.clues import (
    SPREAD,
    USABLE,
    Clue,
    last_name,
    unit_in,
)
from rsgen.files.tree import TEXT, Contents, Entry

__all__ = ["Guess", "run_of"]


class Guess:
    """The entries that are left, and what was taken from them."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        readable = (e for e in contents.entries if e.dtype and not e.fault and e.size)
        texts = {e.path: e.remark for e in contents.entries if e.dtype == TEXT}
        usable = [_completed(e, texts) for e in readable]
        self.free = [e for e in usable if not SPREAD(e) and (e.size == 1 or USABLE(e))]
        self.levels: list[str] = []
        self.nameless = contents.format == "csv" and all(e.path.isdigit() and not e.remark for e in usable)
        self.unnamed = Clue(lambda _: self.nameless)
        self.run: tuple[str, str] | None = None
        self.tables: dict[str, dict[str, Any]] = {}
        self.doubts: dict[str, str] = {}

    def take(self, *clues: Clue) -> Entry | None:
        """Take the first entry for which the first clue that holds for any holds."""
        entry = next((entry for clue in clues for entry in self.free if clue(entry)), None)
        if entry is not None:
            self.free.remove(entry)
        return entry

    def address(self, entry: Entry) -> int | str:
        """Give an array's address in a case."""
        if self.run:
            run, star = self.run
            if entry.path.startswith(run):
                return star + entry.path.removeprefix(run)
        sides = [length for length in entry.shape if length > 1]
        if len(sides) > 1 and self.tables["test"].get("excitation"):
            return f"{entry.path}[1]"
        return int(entry.path) if self.contents.format == "csv" and entry.path.isdigit() else entry.path


def _completed(entry: Entry, texts: Mapping[str, str]) -> Entry:
    """Give an entry its unit, spelled as a case does, and its name from the texts beside it."""
    named = entry if entry.title else replace(entry, title=name_beside(entry.path, texts))
    name = last_name(named)
    unit = named.unit or unit_beside(entry.path, texts) or unit_in(name) or unit_within(name)
    return replace(named, unit=plain_unit(unit))


def run_of(entry: Entry, entries: Iterable[Entry]) -> tuple[str, str, int] | None:
    """Find whether an entry stands in one of several runs: how its path begins, the same with *, how many.

    "runs/1/f" and "drive_1/f" do, if there is a "runs/2/f" or "drive_2/f".
    """
    paths = {other.path for other in entries}
    parts = entry.path.split("/")
    for place, part in enumerate(parts[:-1]):
        stem = part.rstrip("0123456789")
        if stem == part:
            continue
        rest = "/".join(parts[place + 1 :])
        before = "/".join([*parts[:place], stem])
        alike = re.compile(re.escape(before) + r"\d+/" + re.escape(rest))
        count = sum(bool(alike.fullmatch(path)) for path in paths)
        if count > 1:
            return "/".join(parts[: place + 1]) + "/", before + "*/", count
    return None
