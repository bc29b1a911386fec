"""Files beside a data file whose names differ from its own in one number: other levels of a test, perhaps."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["siblings_of"]

_NUMBER = re.compile(r"\d+(?:[.,]\d+)?")
_FORCE_BEHIND = re.compile(r"[ _-]?(?:[munk]?N|lbf)(?![A-Za-z])")
_LEVEL_BEFORE = re.compile(r"(?:level|stufe|force|kraft|amp|lvl|F)[ _-]?\Z", re.IGNORECASE)
_MOST = 200
"""Files of one case, at most; of more nobody would want one."""
_LOOKED_AT = 5_000
"""Names in a folder that are looked at."""
_NAMED = 3
"""Of the others in the comment."""


def _places(name: str) -> list[re.Match[str]]:
    """Give the numbers in a name, those that may be a level first."""

    def rank(found: re.Match[str]) -> tuple[bool, bool, int]:
        behind = _FORCE_BEHIND.match(name, found.end())
        return not behind, not _LEVEL_BEFORE.search(name[: found.start()]), -found.start()

    return sorted(_NUMBER.finditer(name), key=rank)


def siblings_of(file: Path) -> str:
    """Say which files beside a file differ from it in one number, and how a case reads all; else ""."""
    stem = file.stem
    try:
        names = [other.name for _, other in zip(range(_LOOKED_AT), file.parent.iterdir(), strict=False)]
    except OSError:
        return ""
    for found in _places(stem):
        before, after = stem[: found.start()], stem[found.end() :] + file.suffix
        alike = re.compile(f"{re.escape(before)}{_NUMBER.pattern}{re.escape(after)}")
        others = sorted(name for name in names if alike.fullmatch(name) and name != file.name)
        if others and len(others) < _MOST:
            shown = ", ".join(others[:_NAMED]) + ", ..." * (len(others) > _NAMED)
            unit = "" if _FORCE_BEHIND.match(stem, found.end()) else ', unit = "label"'
            return (
                f"also here: {shown}; levels of one test are read together by file = [...] and "
                f'[test.level] name = "{before}{{level}}{after}"{unit}'
            )
    return ""
