"""The command `rsgen diff`: what changed between two results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.options import Json
from rsgen.app.cli.targets import DIFFERENCE, check_target, is_foreign, refuse_foreign
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

__all__ = ["diff_command"]


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


def diff_command(
    before: Annotated[Path, typer.Argument(help="reports/<case>, or a folder of them.", show_default=False)],
    after: Annotated[Path, typer.Argument(help="The same, later.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Render a page, too.", show_default=False)
    ] = None,
    json: Json = False,
) -> int:
    """Say what changed between two results in values and verdicts; 1 if a verdict is graver than before.

    \b
    Examples:
      rsgen diff reports/cubic results/cubic
      rsgen diff reports results --out changes.html
    """
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
