"""The command `rsgen diff`: results side by side, in their values and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from rsgen.analysis.comparison import ComparedFit, FitComparison
from rsgen.app.cli.options import Json
from rsgen.app.cli.terminal import DOUBTED_RESULT, USABLE_RESULT, print_block, print_json, print_line
from rsgen.common.errors import RsgenError
from rsgen.common.finding import STATES
from rsgen.report.result_json import comparison_entry, read_result, read_results
from rsgen.report.wording.sentences import full_sentence, next_step


@dataclass(frozen=True, slots=True)
class CaseDifference:
    """One case in several results; ``everywhere`` is False where one of the places has no such case.

    ``laws`` are the different ones of the results.
    """

    case: str
    fits: FitComparison
    everywhere: bool
    laws: tuple[str, ...] = ()

    @property
    def changed(self) -> bool:
        """True where a value or a verdict differs, or a place has no such case."""
        verdicts = {str(fit.verdict) for fit in self.fits.fits}
        return not self.everywhere or len(verdicts) > 1 or any(row.changed for row in self.fits)

    @property
    def worse(self) -> bool:
        """True where a verdict is graver than the first, which identified is not, or results disagree."""
        if self.fits.findings:
            return True
        first, *others = [max(STATES.index(fit.verdict.state), 1) for fit in self.fits.fits]
        return max(others, default=first) > first


def _fits(place: Path) -> dict[str, tuple[ComparedFit, str]]:
    single = read_result(place / "result.json")
    entries = [single] if single else read_results(place)
    if not entries:
        raise RsgenError(f"{place}: holds no result of rsgen; give reports/<case> or a folder of them")
    laws = (" + ".join(str(e["force"]) for e in entry.result.get("elements", [])) for entry in entries)
    return {
        str(entry.result["case"]): (entry.fit(str(place)), law)
        for entry, law in zip(entries, laws, strict=True)
    }


def compare_results(*places: str | Path) -> tuple[CaseDifference, ...]:
    """Compare results, or folders of results case by case.

    Parameters
    ----------
    places
        Each ``reports/<case>`` or a folder of such. Single results are compared whatever their names.

    Raises
    ------
    RsgenError
        There is no result in one of them, or only one is given.
    """
    if len(places) < 2:
        raise RsgenError("diff: one result; give two or more of reports/<case>, or folders of them")
    found = [_fits(Path(place)) for place in places]
    if all(len(fits) == 1 for fits in found):
        name = " and ".join(dict.fromkeys(case for fits in found for case in fits))
        found = [dict.fromkeys([name], *fits.values()) for fits in found]
    differences = []
    for case in sorted({case for fits in found for case in fits}):
        fits, laws = zip(*(fits[case] for fits in found if case in fits), strict=True)
        same = len(fits) == len(found)
        differences.append(CaseDifference(case, FitComparison(fits), same, tuple(dict.fromkeys(laws))))
    return tuple(differences)


def difference_data(differences: Sequence[CaseDifference]) -> list[dict[str, Any]]:
    """Return a comparison for a program; what is not known is None."""
    return [
        {
            "case": difference.case,
            "changed": difference.changed,
            "worse": difference.worse,
            **comparison_entry(difference.fits),
            "findings": [finding.to_dict() for finding in difference.fits.findings],
        }
        for difference in differences
    ]


def diff_command(
    results: Annotated[
        list[Path],
        typer.Argument(help="reports/<case>, or folders of them; two or more.", show_default=False),
    ],
    json: Json = False,
) -> int:
    """Set results side by side; 1 if a verdict is graver than the first, or identified results disagree.

    \b
    Examples:
      rsgen diff reports/cubic results/cubic
      rsgen diff reports results --json
      rsgen diff runs/cubic runs/quintic runs/gap
    """
    differences = compare_results(*results)
    changed, worse = (sum(getattr(one, name) for one in differences) for name in ("changed", "worse"))
    if json:
        print_json(difference_data(differences))
        return DOUBTED_RESULT if worse else USABLE_RESULT
    for one in differences:
        if one.changed:
            print_line(one.case)
            if len(one.laws) > 1:
                print_line(f"  the laws differ: {'; '.join(one.laws)}")
            print_block("", str(one.fits))
            for finding in one.fits.findings:
                print_line(f"{full_sentence(finding)} {next_step(finding)}")
    cases = "case" if len(differences) == 1 else "cases"
    print_line(
        f"{changed} of {len(differences)} {cases} changed, {worse} with a graver verdict or a disagreement"
    )
    return DOUBTED_RESULT if worse else USABLE_RESULT
