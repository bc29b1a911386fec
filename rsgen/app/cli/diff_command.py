"""The command `rsgen diff`: what changed between two results, in their values and verdicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from rsgen.app.cli.options import Json
from rsgen.app.cli.terminal import ACCEPTED, MISSED, number, print_json, print_line, print_table
from rsgen.common.errors import RsgenError
from rsgen.common.finding import STATES, StatedVerdict, verdict_lines
from rsgen.report.result_json import read_result, read_results
from rsgen.report.wording.sentences import read_verdict

_SAME = 1e-12
"""Relative change below which two values are the same: the last digits differ between machines."""


@dataclass(frozen=True, slots=True)
class ValueDifference:
    """The refined estimate of one value in both results, SI; None where a result has none.

    ``error_before`` and ``error_after`` are standard errors, ``passed_before`` and ``passed_after`` the
    verdicts, None where nothing was judged.
    """

    name: str
    unit: str
    before: float | None
    after: float | None
    error_before: float | None
    error_after: float | None
    passed_before: bool | None
    passed_after: bool | None

    @property
    def change(self) -> float | None:
        """(after - before) / before [1]; None where it is not defined."""
        if self.before is None or self.after is None or self.before == 0:
            return None
        return (self.after - self.before) / abs(self.before)

    @property
    def in_errors(self) -> float | None:
        """The change in parts of the standard error of a difference, for independent tests [1]."""
        if None in (self.before, self.after, self.error_before, self.error_after):
            return None
        spread = math.hypot(self.error_before or 0.0, self.error_after or 0.0)
        return ((self.after or 0.0) - (self.before or 0.0)) / spread if spread else None

    @property
    def changed(self) -> bool:
        """True where value or verdict differ."""
        if self.passed_before != self.passed_after or (self.before is None) != (self.after is None):
            return True
        change = self.change
        return self.before != self.after if change is None else abs(change) > _SAME


@dataclass(frozen=True, slots=True)
class CaseDifference:
    """One case in both results.

    ``before``, ``after`` say whether all judged values are within tolerance, None where nothing was judged or
    the case is absent; ``verdict_before``, ``verdict_after`` are the verdicts, None where it is absent.
    """

    case: str
    before: bool | None
    after: bool | None
    rows: tuple[ValueDifference, ...]
    verdict_before: StatedVerdict | None
    verdict_after: StatedVerdict | None
    only: str = ""

    @property
    def verdict_changed(self) -> bool:
        """True where the verdict is another one, or other findings decided."""
        return _decision(self.verdict_before) != _decision(self.verdict_after)

    @property
    def changed(self) -> bool:
        """True where a value or a verdict differs, or one result has no such case."""
        judged = self.before != self.after or self.verdict_changed
        return bool(self.only) or judged or any(row.changed for row in self.rows)

    @property
    def worse(self) -> bool:
        """True where a value or the case is no longer within tolerance, or the verdict is a graver one."""
        lost = any(row.passed_before and row.passed_after is False for row in self.rows)
        lost = lost or (self.before is True and self.after is False)
        if self.verdict_before is None or self.verdict_after is None:
            return lost
        return lost or _grade(self.verdict_after) > _grade(self.verdict_before)


def _decision(verdict: StatedVerdict | None) -> tuple[str, ...]:
    """Give the state and the codes that decided."""
    if verdict is None:
        return ()
    return (verdict["state"], *sorted({str(finding["code"]) for finding in verdict["decided_by"]}))


def _grade(verdict: StatedVerdict) -> int:
    """How grave a verdict is; without a truth, identified is the best there can be."""
    return max(0, STATES.index(verdict["state"]) - STATES.index("identified"))


def _results(place: Path) -> dict[str, dict[str, Any]]:
    single = read_result(place / "result.json")
    entries = [single] if single else read_results(place)
    if not entries:
        raise RsgenError(f"{place}: holds no result of rsgen; give reports/<case> or a folder of them")
    return {str(entry.result["case"]): entry.result for entry in entries}


def _rows(result: dict[str, Any] | None) -> dict[str, dict[str, Any]]:
    if result is None:
        return {}
    judged = [row for row in result.get("forces", []) if row.get("tolerance") is not None]
    return {str(row["name"]): row for row in [*result["parameters"], *judged]}


def _estimate(row: dict[str, Any], suffix: str) -> dict[str, Any]:
    """Give value, standard error and verdict of a row as the fields of ``ValueDifference`` for one result."""
    refined = row.get("refined") or {}
    value, error = (refined.get(key) for key in ("value", "standard_error"))
    return {
        suffix: None if value is None else float(value),
        f"error_{suffix}": None if error is None else float(error),
        f"passed_{suffix}": bool(row["passed"]) if row.get("tolerance") is not None else None,
    }


def _judgement(result: dict[str, Any] | None) -> bool | None:
    """Tell whether a whole case is within tolerance; None without ``[accept]``, whatever its result says."""
    rows = _rows(result).values()
    if result is None or not any(row.get("tolerance") is not None for row in rows):
        return None
    return bool(result["passed"])


def _compare(case: str, before: dict[str, Any] | None, after: dict[str, Any] | None) -> CaseDifference:
    old, new = _rows(before), _rows(after)
    rows = []
    for name in {**old, **new}:
        one, two = old.get(name, {}), new.get(name, {})
        fields = _estimate(one, "before") | _estimate(two, "after")
        rows.append(ValueDifference(name, str((two or one)["unit"]), **fields))
    return CaseDifference(
        case,
        before=_judgement(before),
        after=_judgement(after),
        rows=tuple(rows),
        verdict_before=None if before is None else read_verdict(before),
        verdict_after=None if after is None else read_verdict(after),
        only="" if before and after else ("before" if before else "after"),
    )


def compare_results(before: str | Path, after: str | Path) -> tuple[CaseDifference, ...]:
    """Compare two results, or two folders of results case by case.

    Parameters
    ----------
    before, after
        Each ``reports/<case>`` or a folder of such. Two single results are compared whatever their names.

    Raises
    ------
    RsgenError
        There is no result in one of them.
    """
    old, new = _results(Path(before)), _results(Path(after))
    if len(old) == len(new) == 1:
        (first, one), (second, two) = *old.items(), *new.items()
        name = first if first == second else f"{first} and {second}"
        return (_compare(name, one, two),)
    return tuple(_compare(name, old.get(name), new.get(name)) for name in sorted({*old, *new}))


def _named(verdict: StatedVerdict | None) -> str:
    """Name a verdict, with the findings that decided."""
    if verdict is None:
        return "absent"
    codes = ", ".join(dict.fromkeys(str(finding["code"]) for finding in verdict["decided_by"]))
    return f"{verdict['state']} ({codes})" if codes else verdict["state"]


def verdict_change(difference: CaseDifference) -> str:
    """Say the verdicts of one case before and after; "" where they are the same."""
    if not difference.verdict_changed:
        return ""
    return f"{_named(difference.verdict_before)} -> {_named(difference.verdict_after)}"


def difference_data(differences: Sequence[CaseDifference]) -> list[dict[str, Any]]:
    """Give a comparison for a program; what is not known is None."""
    return [
        {
            "case": difference.case,
            "changed": difference.changed,
            "worse": difference.worse,
            "passed": {"before": difference.before, "after": difference.after},
            "verdict": {"before": difference.verdict_before, "after": difference.verdict_after},
            "only": difference.only or None,
            "values": [
                {
                    "name": row.name,
                    "unit": row.unit,
                    "before": row.before,
                    "after": row.after,
                    "change": row.change,
                    "in_standard_errors": row.in_errors,
                    "passed": {"before": row.passed_before, "after": row.passed_after},
                    "changed": row.changed,
                }
                for row in difference.rows
            ],
        }
        for difference in differences
    ]


# ----------------------------------------------------------------------------
# The command.

_TOLERANCE: dict[object, str] = {True: "within tolerance", False: "outside tolerance", None: "-"}


def _printed(difference: CaseDifference) -> list[tuple[str, ...]]:
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
            f"{_TOLERANCE[row.passed_before]} -> {_TOLERANCE[row.passed_after]}",
        )
        for row in difference.rows
        if row.changed
    ]


def diff_command(
    before: Annotated[Path, typer.Argument(help="reports/<case>, or a folder of them.", show_default=False)],
    after: Annotated[Path, typer.Argument(help="The same, later.", show_default=False)],
    json: Json = False,
) -> int:
    """Say what changed between two results in values and verdicts; 1 if a verdict is graver than before.

    \b
    Examples:
      rsgen diff reports/cubic results/cubic
      rsgen diff reports results --json
    """
    differences = compare_results(before, after)
    worse = sum(difference.worse for difference in differences)
    if json:
        print_json(difference_data(differences))
        return MISSED if worse else ACCEPTED
    rows = [row for difference in differences for row in _printed(difference)]
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
    return MISSED if worse else ACCEPTED
