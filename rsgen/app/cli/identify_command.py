"""The command `rsgen identify`: the parameters of a case, and the file of receptances that --frf names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from rsgen.analysis.comparison import compare, verdict_of
from rsgen.analysis.export import save_frf
from rsgen.app.cli.options import (
    FRF,
    Data,
    Json,
    OneCase,
    Surface,
    check_target,
    inputs_of,
    is_foreign,
    refuse_foreign,
)
from rsgen.app.cli.progress_bar import print_cache_fault, stage_progress
from rsgen.app.cli.terminal import (
    number,
    print_json,
    print_line,
    print_table,
    print_verdict,
    verdict_code,
)
from rsgen.app.study import obtain_table
from rsgen.app.study.run_case import identify_case
from rsgen.cases import Case, load_case
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Verdict
from rsgen.data.surface import ResponseSurface, load_surface
from rsgen.identification.prediction import predict
from rsgen.identification.results import Estimate, Identification
from rsgen.report.result_json import fixed_entry
from rsgen.report.wording import sentence
from rsgen.report.wording.sentences import state_verdict

_METHODS = ("paper", "first_order", "refined")


def _entry(estimate: Estimate | None) -> dict[str, Any] | None:
    if estimate is None:
        return None
    return {
        "value": estimate.value,
        "standard_error": estimate.standard_error,
        "interval": list(estimate.interval),
        "interval_by": "profile" if estimate.by_profile else "standard error",
    }


def _rows(identification: Identification) -> list[dict[str, Any]]:
    found = {method: {e.name: e for e in getattr(identification, method)} for method in _METHODS}
    return [
        {"name": refined.name, "unit": refined.unit}
        | {method: _entry(found[method].get(refined.name)) for method in _METHODS}
        for refined in identification.refined
    ]


Frf = Annotated[Path | None, typer.Option(help="Write receptances, universal (.uff).", show_default=False)]


def identify_command(
    case: OneCase, surface: Surface = None, data: Data = None, frf: Frf = None, json: Json = False
) -> int:
    """Identify the parameters of a case and print them; nothing is written but what --frf names.

    \b
    Examples:
      rsgen identify cases/cubic.toml
      rsgen identify cases/cubic.toml --surface cubic.h5 --json
      rsgen identify cases/cubic.toml --frf cubic.uff
    """
    print_cache_fault()
    loaded = load_case(case, data)
    target = check_target(frf, ".uff", "--frf") if frf else None
    if target:
        refuse_foreign(target, is_foreign(target, FRF), inputs_of(loaded, surface), "--frf")
        if loaded.test.many_lines:
            raise RsgenError(f"{case.name}: --frf: of a multisine `rsgen run` writes the receptances")
    with stage_progress(loaded) as note:
        note("surface", 0.0)
        tested = load_surface(surface) if surface else obtain_table(loaded)
        note("identification", 0.0)
        identification = identify_case(loaded, tested)
        verdict = _verdict(loaded, identification)
    if target:
        save_frf(target, cast("ResponseSurface", tested), predict(identification, surface=tested))
    rows = _rows(identification)
    warnings = [*map(sentence, identification.findings)]
    if json:
        print_json(
            {
                "case": loaded.name,
                "verdict": state_verdict(verdict),
                "parameters": rows,
                "fixed": fixed_entry(identification),
                "residual": identification.residual,
                "outcome": sentence(identification.outcome),
                "warnings": warnings,
            }
        )
        return verdict_code(verdict.state)
    code = print_verdict(state_verdict(verdict))
    print_table(
        ("", "paper", "first order", "refined", "± (95 %)", "unit"),
        [
            (
                row["name"],
                *(number(row[method]["value"] if row[method] else None) for method in _METHODS),
                _interval_text(row["refined"]),
                row["unit"],
            )
            for row in rows
        ],
    )
    for one in identification.fixed:
        print_line(f"fixed: {one.name} = {number(one.value)} {one.unit}".rstrip())
    print_line(sentence(identification.outcome))
    for finding in identification.findings:
        if finding not in verdict.decided_by:
            print_line(f"note: {sentence(finding)}")
    return code


def _interval_text(entry: dict[str, Any]) -> str:
    low, high = entry["interval"]
    if entry["interval_by"] == "profile":
        return f"{number(low)} to {number(high)}, by profile"
    return number((high - low) / 2, 2)


def _verdict(case: Case, identification: Identification) -> Verdict:
    """Reach the verdict as a run of the case would, with its truth."""
    return verdict_of(
        identification, compare(identification, case.with_model(identification.model).truth, case.accept)
    )
