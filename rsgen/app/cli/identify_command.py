"""What `rsgen identify` prints, the parameters of a case, and the file of receptances that --frf names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsgen.analysis.comparison import compare, verdict_of
from rsgen.analysis.export import save_frf
from rsgen.app.cli.progress_bar import stage_progress
from rsgen.app.cli.targets import FRF, SURFACE, check_target, inputs_of, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import (
    ACCEPTED,
    MISSED,
    number,
    print_cache_fault,
    print_json,
    print_line,
    print_table,
    print_verdict,
    verdict_code,
)
from rsgen.app.study import obtain_surface, obtain_table
from rsgen.app.study.foresight import identify_case
from rsgen.cases import Case, load_case
from rsgen.cases.trial import law_faults
from rsgen.common.errors import CaseError, RsgenError
from rsgen.common.finding import Verdict
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import load_surface, save_surface
from rsgen.dynamics.simulation import MultisineTest
from rsgen.files import MeasuredTest
from rsgen.identification.prediction import predict
from rsgen.identification.results import Estimate, Identification
from rsgen.report.wording import sentence
from rsgen.report.wording.sentences import state_verdict

__all__ = ["identify_command", "simulate_command"]


_METHODS = ("paper", "first_order", "refined")


def _entry(estimate: Estimate | None) -> dict[str, Any] | None:
    if estimate is None:
        return None
    return {
        "value": estimate.value,
        "standard_error": estimate.standard_error,
        "interval": list(estimate.interval),
    }


def _rows(identification: Identification) -> list[dict[str, Any]]:
    found = {method: {e.name: e for e in getattr(identification, method)} for method in _METHODS}
    return [
        {"name": refined.name, "unit": refined.unit}
        | {method: _entry(found[method].get(refined.name)) for method in _METHODS}
        for refined in identification.refined
    ]


def identify_command(
    path: Path, surface: Path | None, data: Path | None, frf: Path | None, json: bool
) -> int:
    """Identify a case from its test or from a saved surface, and print the estimates."""
    print_cache_fault()
    case = load_case(path, data)
    target = check_target(frf, ".uff", "--frf") if frf else None
    if target:
        refuse_foreign(target, is_foreign(target, FRF), inputs_of(case, surface), "--frf")
    with stage_progress(case, "surface", "identification") as note:
        note("surface", 0.0)
        tested = load_surface(surface) if surface else obtain_table(case)
        note("identification", 0.0)
        identification = identify_case(case, tested)
        verdict = _verdict(case, identification)
    if target:
        if isinstance(tested, MultisineSpectra):
            raise RsgenError(f"{case.path.name}: --frf: of a multisine `rsgen run` writes the receptances")
        save_frf(target, tested, predict(identification, surface=tested))
    rows = _rows(identification)
    warnings = [*map(sentence, identification.findings)]
    if json:
        print_json(
            {
                "case": case.name,
                "verdict": state_verdict(verdict),
                "parameters": rows,
                "residual": identification.residual,
                "outcome": sentence(identification.outcome),
                "warnings": warnings,
            }
        )
        return verdict_code(verdict.state)
    code = print_verdict(verdict)
    print_table(
        ("", "paper", "first order", "refined", "± (95 %)", "unit"),
        [
            (
                row["name"],
                *(number(row[method]["value"] if row[method] else None) for method in _METHODS),
                number((row["refined"]["interval"][1] - row["refined"]["interval"][0]) / 2, 2),
                row["unit"],
            )
            for row in rows
        ],
    )
    print_line(sentence(identification.outcome))
    for finding in identification.findings:
        if finding not in verdict.decided_by:
            print_line(f"note: {sentence(finding)}")
    return code


def _verdict(case: Case, identification: Identification) -> Verdict:
    """Reach the verdict as a run of the case would, with its truth."""
    return verdict_of(
        identification, compare(identification, case.with_model(identification.model).truth, case.accept)
    )


# ----------------------------------------------------------------------------
# What `rsgen simulate` does: the response surface of a simulated case as a file.


def simulate_command(path: Path, out: Path | None, json: bool) -> int:
    """Write the response surface of a simulated case as HDF5."""
    print_cache_fault()
    case = load_case(path)
    if isinstance(case.test, MeasuredTest):
        raise RsgenError(f"{path.name}: test.kind: is 'measured'; only a simulated test can be simulated")
    if isinstance(case.test, MultisineTest):
        raise RsgenError(
            f"{path.name}: test.kind: a multisine has no response surface; `rsgen run` simulates it"
        )
    refused = law_faults(case)
    if refused:
        raise CaseError(refused)
    target = out or Path(f"{case.name}.h5")
    refuse_foreign(target, is_foreign(target, SURFACE), inputs_of(case))
    with stage_progress(case, "surface") as note:
        surface = obtain_surface(case, lambda share: note("surface", share))
    save_surface(target, surface)
    settled = int(surface.settled.sum())
    if json:
        print_json({"case": case.name, "file": str(target), "points": len(surface), "settled": settled})
    else:
        print_line(f"{case.name}: {len(surface)} points, {settled} settled: {target}")
        if not settled:
            print_line(
                "no point settled: check the values of [truth], their signs first; levels and frequencies"
            )
    return ACCEPTED if settled else MISSED
