"""Which arrays of a file are of one test: those of a run that stands for several, or no other test's."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from rsgen.common.errors import listed
from rsgen.files.inspection import clues
from rsgen.files.nominal_levels import level_form
from rsgen.files.signals import star_pattern
from rsgen.files.tree import Contents, Entry, natural_order


@dataclass(frozen=True, slots=True)
class Runs:
    """The arrays of a test, and the runs of one file that are its levels.

    Parameters
    ----------
    arrays
        Those of the test; of several runs, of the one with the frequency.
    left_out
        What is not read, in sentences.
    run
        How the path of one of several runs begins, and the same with a *.
    names
        What the runs are called; () where the file has none.
    form
        Of the names, with {level} for a number; "" where they have none.
    """

    arrays: list[Entry]
    left_out: tuple[str, ...] = ()
    run: tuple[str, str] = ("", "")
    names: tuple[str, ...] = ()
    form: str = ""


def is_frequency(entry: Entry) -> bool:
    """Return True for a frequency by its name; "f_re_N" is a force."""
    return clues.FREQUENCY(entry) and not (
        clues.is_force(entry) or clues.motion_of(entry) or clues.QUOTIENT(entry)
    )


def choose_runs(contents: Contents, free: list[Entry], frequency: Entry) -> Runs:
    """Choose the arrays of the table of ``frequency``, and find runs that are like it.

    "runs/1/f" and "drive_1/f" are of several runs, if there is a "runs/2/f" or "drive_2/f", and so are sheets
    with the same titles. Such are levels, if they are not channels of one test or points of a structure, as
    in a universal file.
    """
    folders = [found.end() for found in re.finditer(r"(?<=\d)/", frequency.path)]
    for end in folders:
        begin, rest = frequency.path[:end], frequency.path[end:]
        stem = begin.rstrip("/").rstrip("0123456789")
        of_run = re.compile(re.escape(stem) + r"\d+/")
        runs = [
            e.path.removesuffix(f"/{rest}")
            for e in contents.entries
            if of_run.sub("", e.path, 1) == rest and of_run.match(e.path)
        ]
        if len(runs) < 2:
            continue
        members = [entry for entry in free if of_run.match(entry.path)]
        kinds: dict[str, set[bool]] = defaultdict(set)
        for entry in members:
            kinds[of_run.sub("", entry.path, 1)].add(clues.is_force(entry))
        if any(len(found) > 1 for found in kinds.values()):
            return Runs(free)
        chosen = [entry for entry in free if entry.path.startswith(begin)]
        others = _other_points([entry for entry in members if clues.motion_of(entry) and entry.title])
        return Runs(chosen, tuple(others)) if others else Runs(chosen, (), (begin, f"{stem}*/"), tuple(runs))
    # a / in the title of a text is no folder
    return Runs(free) if contents.format == "csv" else _by_folder(free, frequency)


def _other_points(motions: Sequence[Entry]) -> list[str]:
    """Say which points the runs of a file are of where they are no levels of one."""
    points = [entry for entry in motions if entry.remark != motions[0].remark]
    same = len(motions) - len(points) - 1
    again = f" and {same} more of this point" if same else ""
    names = listed(list(dict.fromkeys(map(clues.called, points))))
    return [f"left out: {names}{again}; a case reads one point, whose entries are levels"] if points else []


def _by_folder(free: list[Entry], frequency: Entry) -> Runs:
    """Keep the sheet of ``frequency``; others with all its titles are levels if numbers distinguish them."""
    titles: dict[str, set[str]] = defaultdict(set)
    for entry in free:
        titles[_folder(entry)].add(entry.path.rpartition("/")[2])
    own = _folder(frequency)
    with_own = {_folder(e) for e in free if clues.is_real(e) and e.size > 1 and is_frequency(e)} | {own}
    alike = sorted((name for name in with_own if titles[own] <= titles[name]), key=natural_order)
    form = level_form(alike, r"[^\W\d]*") or ""
    star = form.replace("{level}", "*")
    # another test of the file may be called alike
    if sorted(filter(star_pattern(star).fullmatch, titles), key=natural_order) != alike:
        alike, form, star = [], "", ""
    left = [entry.path for entry in free if _folder(entry) in with_own.difference(alike, [own])]
    said = f"left out: {listed(left)}, which have a frequency of their own"
    return Runs(
        [entry for entry in free if _folder(entry) not in with_own - {own}],
        (said,) if left else (),
        (f"{own}/", f"{star}/") if star else ("", ""),
        tuple(alike),
        form,
    )


def _folder(entry: Entry) -> str:
    return entry.path.rpartition("/")[0]
