"""What `rsgen diff` prints: what changed between two results."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from rsgen.app.cli.targets import DIFFERENCE, SURFACE_PAGE, check_target, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import ACCEPTED, MISSED, number, print_json, print_line, print_table
from rsgen.common.finding import verdict_lines
from rsgen.common.output import write_atomic
from rsgen.report.difference import (
    CaseDifference,
    compare_results,
    difference_data,
    render_difference,
    verdict_change,
)
from rsgen.report.page import render_interactive
from rsgen.report.result_json import read_result

__all__ = ["diff_command", "show_command"]


_VERDICTS: dict[object, str] = {True: "within tolerance", False: "outside tolerance", None: "-"}


def _rows(difference: CaseDifference) -> list[tuple[str, ...]]:
    if difference.only:
        return [(difference.case, f"only {difference.only}", *[""] * 5)]
    return [
        (
            difference.case,
            row.name,
            number(row.before, 8),
            number(row.after, 8),
            row.unit,
            "-" if row.change is None else f"{row.change:+.1e}",
            f"{_VERDICTS[row.passed_before]} -> {_VERDICTS[row.passed_after]}",
        )
        for row in difference.rows
        if row.changed
    ]


def diff_command(before: Path, after: Path, out: Path | None, json: bool) -> int:
    """Print what changed; the code is 1 if a value left its tolerance or a verdict is graver."""
    target = None if out is None else check_target(out, ".html")
    if target:
        refuse_foreign(target, is_foreign(target, DIFFERENCE), ())
    differences = compare_results(before, after)
    if target is not None:
        write_atomic(target, render_difference(differences, str(before), str(after)))
    worse = sum(difference.worse for difference in differences)
    if json:
        print_json(difference_data(differences))
        return MISSED if worse else ACCEPTED
    rows = [row for difference in differences for row in _rows(difference)]
    for difference in differences:
        change = verdict_change(difference)
        if change and not difference.only:
            print_line(f"{difference.case}: {change}")
            for line in verdict_lines(difference.verdict_after)[1:] if difference.verdict_after else ():
                print_line(line)
    if rows:
        print_table(("case", "value", "before", "after", "unit", "change", "verdict"), rows)
    changed = sum(difference.changed for difference in differences)
    cases = "case" if len(differences) == 1 else "cases"
    print_line(f"{changed} of {len(differences)} {cases} changed, {worse} for the worse")
    if target is not None:
        print_line(f"{target}")
    return MISSED if worse else ACCEPTED


# ----------------------------------------------------------------------------
# What `rsgen show` does: a page on which the response surface of a result turns.


def show_command(folder: Path, out: Path | None, open_it: bool, json: bool) -> int:
    """Write the interactive page of a result beside its folder, whose files the manifest lists."""
    target = check_target(out or folder.with_name(f"{folder.resolve().name}-surface.html"), ".html")
    refuse_foreign(target, is_foreign(target, SURFACE_PAGE), ())
    write_atomic(target, render_interactive(folder))
    entry = read_result(folder / "result.json")
    if json:
        print_json({"file": str(target), "verdict": entry and entry.verdict})
    else:
        for line in verdict_lines(entry.verdict) if entry else ():
            print_line(line)
        print_line(f"{target}: open it in a browser")
    if open_it:
        webbrowser.open(target.resolve().as_uri())
    return ACCEPTED
