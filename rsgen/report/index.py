"""index.html and table1.md: every case of a folder, true against identified."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

import rsgen
from rsgen.common.finding import STATES
from rsgen.common.output import write_atomic
from rsgen.formula.units.quantities import quantity_text
from rsgen.law.element import FORCE_KEYS
from rsgen.report.page import THUMBNAIL
from rsgen.report.provenance import page_environment, plain_text
from rsgen.report.result_json import Entry, read_results
from rsgen.report.wording.page_sentences import MARKED, error_text

__all__ = ["table_of_results", "write_index"]

_MOST_PICTURE = 500_000
"""Bytes of a picture in the index; those that runs write have a tenth of it."""
_MARKDOWN = str.maketrans({c: f"\\{c}" for c in "\\`*_{}[]<>#|$&~!"})


def _picture(entry: Entry) -> Markup | None:
    """Give the picture of a result as an address; None where a result without a surface has none.

    It is shown as an image, in which nothing acts or loads anything, whatever is in the file.
    """
    path = entry.folder / THUMBNAIL
    try:
        if not path.is_file() or path.stat().st_size > _MOST_PICTURE:
            return None
        coded = base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError:
        return None
    return Markup(f"data:image/svg+xml;base64,{coded}")  # noqa: S704 - letters and digits, whatever was read


def _quantity(value: Any, unit: Any) -> str:
    return "–" if value is None else quantity_text(float(value), str(unit), 6)


def _context(entry: Entry) -> dict[str, Any]:
    points, verdict = entry.result["surface"], entry.verdict
    return {
        "name": entry.folder.name,
        "title": entry.result["title"],
        "link": f"{quote(entry.folder.name)}/report.html",
        "state": verdict["state"],
        "headline": verdict["headline"],
        "reasons": [entry["code"].replace("-", " ") for entry in verdict["decided_by"]],
        "points": points["points"],
        "origin": points["origin"],
        "thumbnail": _picture(entry),
        "warnings": len(entry.result.get("warnings", [])),
        "disagreeing": [f["what"] for f in entry.result.get("printed", []) if not f["agrees"]],
        "rows": [
            {
                "name": FORCE_KEYS.get(row["name"], row["name"]),
                "true": _quantity(row["true"], row["unit"]),
                "refined": _quantity((row["refined"] or {"value": None})["value"], row["unit"]),
                "paper": error_text(row.get("paper_error")),
                "first_order": error_text(row.get("first_order_error")),
                "error": error_text(row["relative_error"]),
                "passed": row["passed"] if row["tolerance"] is not None else None,
            }
            for row in entry.rows
        ],
    }


def _rounded(error: float | None, least: float) -> str:
    """Print an error so that it is the same on every machine: one digit, and nothing below ``least``."""
    if error is None or not math.isfinite(error):
        return "–"
    return f"< {least:.0e}".replace("e-0", "e-") if error < least else f"{error:.0e}".replace("e-0", "e-")


def table_of_results(entries: list[Entry]) -> str:
    """Give Table 1 as markdown; errors relative, to one digit, so that a change in git is a change indeed."""
    lines = [
        "# Table 1: true against identified",
        "",
        "Relative errors of the three estimates, to one digit; written by `make reports`.",
        "",
        "| system | parameter | true | paper | first order | refined | tolerance | verdict |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for entry in entries:
        name, state = plain_text(entry.folder.name, 80).translate(_MARKDOWN), entry.verdict["state"]
        for row in entry.rows:
            known = row["tolerance"] is not None
            tolerance = float(row["tolerance"]) if known else None
            verdict = "–" if not known else "within" if row["passed"] else "**outside**"
            if state in MARKED:
                # what a value is within says nothing where the result as a whole is doubted
                verdict = f"**{state}**" if not known else f"{verdict}, result **{state}**"
            parameter = plain_text(FORCE_KEYS.get(row["name"], row["name"]), 80).translate(_MARKDOWN)
            cells = (
                name,
                parameter,
                _quantity(row["true"], row["unit"]).replace("\u202f", " "),
                _rounded(row.get("paper_error"), 1e-4),
                _rounded(row.get("first_order_error"), 1e-4),
                _rounded(row["relative_error"], 1e-5),
                "–" if tolerance is None else f"{tolerance:g}",
                verdict,
            )
            lines.append(f"| {' | '.join(cells)} |")
    sources = [
        f"* {plain_text(entry.folder.name, 80).translate(_MARKDOWN)}: {source.translate(_MARKDOWN)}"
        for entry in entries
        if (source := plain_text(str(entry.result.get("source") or ""), 300))
    ]
    lines += ["", "Sources:", "", *sources] if sources else []
    return "\n".join(lines) + "\n"


def write_index(folder: Path | str) -> None:
    """Write index.html and table1.md over every result in a folder.

    Parameters
    ----------
    folder
        Where the results lie, one folder a case; folders without a readable result.json are left out.

    Raises
    ------
    RsgenError
        A file cannot be written.
    """
    place = Path(folder)
    entries = read_results(place)
    contexts = list(map(_context, entries))
    page = page_environment().get_template("index/index.html")
    counts = {state: sum(case["state"] == state for case in contexts) for state in STATES}
    counts = {state: count for state, count in counts.items() if count}
    context = {"cases": contexts, "counts": counts, "marked": MARKED, "version": rsgen.__version__}
    write_atomic(place / "index.html", page.render(context))
    write_atomic(place / "table1.md", table_of_results(entries))
