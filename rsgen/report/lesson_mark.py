"""The mark of a notebook that rsgen wrote, by which one that a user has gone on with is told from it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

__all__ = ["is_lesson_as_written", "lesson_mark"]

_MOST_BYTES = 50_000_000
"""A notebook of a run is smaller."""


def lesson_mark(sources: Iterable[str]) -> dict[str, Any]:
    """Give the entry "rsgen" of a notebook's metadata: a digest of the texts of its cells, not of outputs."""
    digest = hashlib.sha256("\0".join(sources).encode()).hexdigest()
    return {"lesson": True, "sources": digest}


def is_lesson_as_written(place: Path) -> bool:
    """Whether a file is a notebook that rsgen wrote, its cells as they were; it may have been executed."""
    try:
        if place.is_symlink() or not place.is_file() or place.stat().st_size > _MOST_BYTES:
            return False
        content = json.loads(place.read_text(encoding="utf-8"))
        # a cell's text stands as one string or as its lines
        sources = ["".join(cell["source"]) for cell in content["cells"]]
        return bool(content["metadata"]["rsgen"] == lesson_mark(sources))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False
