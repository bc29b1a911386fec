"""Lists of case files, and cases that cannot be run into one folder."""

from __future__ import annotations

import os
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from rsgen.cases.case import Case
from rsgen.common.errors import CaseError, quote

__all__ = ["find_cases", "name_clashes"]


def find_cases(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """List the case files that paths name: files as they are, folders by their ``*.toml``, sorted.

    Raises
    ------
    CaseError
        A path does not exist, or a folder has no case.
    """
    found: list[Path] = []
    faults: list[str] = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = sorted(path.glob("*.toml"), key=lambda file: file.stem)
            if not inside:
                faults.append(f"{quote(path, 200)}: has no case file; a folder with *.toml is needed")
            found += inside
        elif path.exists():
            found.append(path)
        else:
            near = get_close_matches(path.name, [file.name for file in path.parent.glob("*.toml")], 1)
            hint = f"; did you mean {quote(path.with_name(near[0]), 200)}?" if near else ""
            faults.append(
                f"{quote(path, 200)}: does not exist; a case file or a folder of cases is needed{hint}"
            )
    if faults:
        raise CaseError(faults)
    return list(dict.fromkeys(found))


def name_clashes(cases: Iterable[Case]) -> dict[Path, str]:
    """Find cases that would share a folder of results, capitals ignored: a sentence for all but the first."""
    first: dict[str, Case] = {}
    clashes: dict[Path, str] = {}
    for case in cases:
        other = first.setdefault(case.name.casefold(), case)
        if other is not case:
            clashes[case.path] = (
                f"{case.path.name}: name: {quote(case.name)} is also the name of {other.path.name}; "
                "names must differ by more than capitals"
            )
    return clashes
