"""The command `rsgen diff`: results side by side, in their values and verdicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.analysis.fit_comparison import FitComparison
from rsgen.app.cli.terminal import DOUBTED_RESULT, USABLE_RESULT, Json, print_block, print_json, print_line
from rsgen.common.errors import RsgenError
from rsgen.common.finding import STATES
from rsgen.report.result_json import Entry, comparison_entry, read_result
from rsgen.report.sentences import full_sentence, next_step


def compare_results(*places: str | Path) -> tuple[FitComparison, list[Entry]]:
    """Set results side by side, and return them as they were read, too.

    Parameters
    ----------
    places
        Each a folder of a result, ``reports/<case>``; the first is the reference.

    Raises
    ------
    RsgenError
        One of them holds no result, or only one is given.
    """
    if len(places) < 2:
        raise RsgenError("diff: one result; give two or more of reports/<case>")
    entries = list[Entry]()
    for place in places:
        entry = read_result(Path(place) / "result.json")
        if entry is None:
            raise RsgenError(f"{place}: holds no result of rsgen; give reports/<case>")
        entries.append(entry)
    fits = (entry.fit(str(place)) for entry, place in zip(entries, places, strict=True))
    return FitComparison(tuple(fits)), entries


def is_worse(fits: FitComparison) -> bool:
    """Return True if a verdict is graver than the first, which identified is not, or results disagree."""
    first, *others = [max(STATES.index(fit.verdict.state), 1) for fit in fits.fits]
    return any(finding.severity == "doubt" for finding in fits.findings) or max(others) > first


def diff_command(
    results: Annotated[list[Path], typer.Argument(help="Two or more of reports/<case>.", show_default=False)],
    json: Json = False,
) -> int:
    """Set results side by side; 1 if a verdict is graver than the first, or identified results disagree.

    \b
    Examples:
      rsgen diff reports/cubic results/cubic
      rsgen diff runs/cubic runs/quintic runs/gap --json
    """
    fits, entries = compare_results(*results)
    laws = list(dict.fromkeys(entry.law for entry in entries))
    code = DOUBTED_RESULT if is_worse(fits) else USABLE_RESULT
    if json:
        found = [finding.to_dict() for finding in fits.findings]
        print_json({**comparison_entry(fits), "findings": found})
        return code
    if len(laws) > 1:
        print_line(f"the laws differ: {'; '.join(laws)}")
    print_block("", str(fits))
    for finding in fits.findings:
        print_line(f"{full_sentence(finding)} {next_step(finding)}")
    return code
