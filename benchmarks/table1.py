"""Table 1: true against identified, of every case with a result in reports/; written by `make reports`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rsgen.common.output import write_atomic
from rsgen.formula.units import quantity_text
from rsgen.law.memory import FORCE_KEYS
from rsgen.report.result_json import Entry, read_results
from rsgen.report.sentences import MARKED

REPORTS = Path(__file__).parents[1] / "reports"

_MARKDOWN = str.maketrans({c: f"\\{c}" for c in "\\`*_{}[]<>#|$&~!"})


def _rounded(error: float | None, least: float) -> str:
    """Print an error so that it is the same on every machine: one digit, and nothing below ``least``."""
    if error is None or not math.isfinite(error):
        return "–"
    return f"< {least:.0e}".replace("e-0", "e-") if error < least else f"{error:.0e}".replace("e-0", "e-")


def _true_value(row: dict[str, Any]) -> str:
    return "–" if row["true"] is None else quantity_text(row["true"], row["unit"], 6).replace("\u202f", " ")


def table_of_results(entries: list[Entry]) -> str:
    """Return Table 1 as markdown; relative errors have one digit, so that git shows real changes only."""
    lines = [
        "# Table 1: true against identified",
        "",
        "Relative errors of the three estimates, to one digit; written by `make reports`.",
        "",
        "| system | parameter | true | per level | first order | refined | tolerance | verdict |",
        "|---|---|---|---|---|---|---|---|",
    ]
    measured: list[str] = []
    for entry in entries:
        name, state = entry.folder.name.translate(_MARKDOWN), entry.verdict["state"]
        if all(row["true"] is None for row in entry.rows):
            measured.append(f"{name} ({state})")
            continue
        for row in entry.rows:
            known = row["tolerance"] is not None
            tolerance = float(row["tolerance"]) if known else None
            verdict = "–" if not known else "within" if row["passed"] else "**outside**"
            if state in MARKED:
                # what a value is within says nothing where the result as a whole is doubted
                verdict = f"**{state}**" if not known else f"{verdict}, result **{state}**"
            parameter = FORCE_KEYS.get(row["name"], row["name"]).translate(_MARKDOWN)
            cells = (
                name,
                parameter,
                _true_value(row),
                _rounded(row.get("paper_error"), 1e-4),
                _rounded(row.get("first_order_error"), 1e-4),
                _rounded(row["relative_error"], 1e-5),
                "–" if tolerance is None else f"{tolerance:g}",
                verdict,
            )
            lines.append(f"| {' | '.join(cells)} |")
    sources = [
        f"* {entry.folder.name.translate(_MARKDOWN)}: {source.translate(_MARKDOWN)}"
        for entry in entries
        if (source := str(entry.result.get("source") or ""))
    ]
    said = f"Measured, so without true values; `index.html` has those identified: {', '.join(measured)}"
    lines += ["", said] if measured else []
    lines += ["", "Sources:", "", *sources] if sources else []
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    write_atomic(REPORTS / "table1.md", table_of_results(read_results(REPORTS)))
