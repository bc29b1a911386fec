"""Sections of reports/accuracy.md, which several benchmarks write."""

from __future__ import annotations

from pathlib import Path

from rsgen.common.output import write_atomic

REPORT = Path(__file__).parent.parent / "reports" / "accuracy.md"


def replaced(report: str, section: str) -> str:
    """Give the report with this section in place of the one with its title, or after all others."""
    title = section.partition("\n")[0]
    first, *others = ("\n" + report).split("\n## ")
    parts = [first.lstrip("\n"), *("## " + other for other in others)]
    titles = [part.partition("\n")[0] for part in parts]
    if title in titles:
        parts[titles.index(title)] = section
    else:
        parts.append(section)
    return "\n\n".join(part.strip() for part in parts) + "\n"


def write_section(section: str) -> None:
    """Replace the section in reports/accuracy.md."""
    write_atomic(REPORT, replaced(REPORT.read_text(encoding="utf-8"), section))
