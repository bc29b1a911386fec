"""A result.json as it is read: small enough, and with all that index, difference and pages take from it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsgen.common.verdict import StatedVerdict
from rsgen.report.result_json import SCHEMA
from rsgen.report.stated_verdict import read_verdict

__all__ = ["Entry", "read_result", "read_results"]

_MOST_BYTES = 50_000_000
_LONGEST_TEXT = 100_000
"""Characters of a name, a unit, a title, which may be a law of thousands; a longer one is none of ours."""
_ERRORS = ("paper_error", "first_order_error", "relative_error")


@dataclass(frozen=True, slots=True)
class Entry:
    """A finished case: its folder and its result.json; forces count where the case judges them."""

    folder: Path
    result: dict[str, Any]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What is judged, or may be: all parameters, and forces with a tolerance."""
        judged = [row for row in self.result.get("forces", []) if row.get("tolerance") is not None]
        return [*self.result["parameters"], *judged]

    @property
    def verdict(self) -> StatedVerdict:
        """What the result is worth; of an older result what its findings and rows say."""
        return read_verdict(self.result)


def read_result(path: Path) -> Entry | None:
    """Read one result.json of this schema; None where there is none, or none as a run writes it."""
    try:
        # a pipe would never end, nor would a device
        if not path.is_file() or path.stat().st_size > _MOST_BYTES:
            return None
        result = json.loads(path.read_text(encoding="utf-8"))
        entry = Entry(path.parent, result)
        if result["schema"] == SCHEMA and _is_whole(result) and entry.verdict and entry.rows:
            return entry
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError):
        pass
    return None


def read_results(folder: Path) -> list[Entry]:
    """Read every ``<folder>/<case>/result.json`` of this schema, sorted by case; others are left out."""
    paths = [path for path in sorted(folder.glob("*/result.json")) if not path.parent.name.startswith(".")]
    return [entry for path in paths if (entry := read_result(path)) is not None]


def _is_whole(result: Mapping[str, Any]) -> bool:
    """Whether whatever a reader takes from a result is there, and of its kind."""
    surface = result["surface"]
    rows = [*result["parameters"], *result.get("forces", [])]
    printed = result.get("printed", [])
    return (
        _are_texts([result["title"], result["case"], surface["origin"]])
        and isinstance(result["passed"], bool)
        and isinstance(surface["points"], int)
        and isinstance(result.get("warnings", []), list)
        and all(map(_is_row, rows))
        and _are_texts(formula["what"] for formula in printed)
        and all(isinstance(formula["agrees"], bool) for formula in printed)
    )


def _is_row(row: Mapping[str, Any]) -> bool:
    refined = row["refined"]
    estimated = (refined["value"], refined.get("standard_error")) if refined is not None else ()
    numbers = (row["true"], row["relative_error"], row["tolerance"], *map(row.get, _ERRORS), *estimated)
    return (
        _are_texts([row["name"], row["unit"]])
        and isinstance(row["passed"], bool | None)
        and all(map(_is_number_or_none, numbers))
    )


def _are_texts(values: Iterable[Any]) -> bool:
    return all(isinstance(value, str) and len(value) <= _LONGEST_TEXT for value in values)


def _is_number_or_none(value: Any) -> bool:
    # JSON has whole numbers without end, and Python's has NaN
    return value is None or (isinstance(value, int | float) and math.isfinite(float(value)))
