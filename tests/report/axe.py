"""axe-core, the usual judge of accessibility, for the browser tests; ``make test-all`` fetches it."""

from __future__ import annotations

import sys
from pathlib import Path

SOURCE = Path(sys.prefix, "share", "axe-core", "package", "axe.min.js")


def find_axe() -> str | None:
    """The source of axe-core; None where the Makefile could not fetch it."""
    return SOURCE.read_text(encoding="utf-8") if SOURCE.is_file() else None
