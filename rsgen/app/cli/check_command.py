"""The command `rsgen check`: every fault in case files, and what a run will do."""

from __future__ import annotations

from typing import Any

from rsgen.app.cli.derive_command import sentences_of_elements
from rsgen.app.cli.options import Cases, Data, Json
from rsgen.app.cli.terminal import ACCEPTED, FAULTY, print_faults, print_json, print_line
from rsgen.app.study.foresight import point_faults, size_findings
from rsgen.cases import Case, find_cases, load_case, name_clashes, read
from rsgen.cases.trial import law_faults
from rsgen.common.errors import CaseError, MeasurementError, RsgenError, program_fault
from rsgen.report.wording import sentence


def _plan(case: Case) -> dict[str, Any]:
    """Return the plan of a run of a case.

    Raises
    ------
    CaseError
        It would refuse the points of the test.
    """
    planned = case.test.planned()
    table = read(case) if planned is None else planned
    faults = point_faults(case, table)
    if faults:
        raise CaseError(faults)
    findings = (*table.findings, *size_findings(table, case)) if planned is None else ()
    finds_mass = case.model.mass is None and not table.per_mass
    finds_mass &= all(finding.code != "mass-at-resonance" for finding in findings)
    notes = (*sentences_of_elements(case.model.elements), *map(sentence, findings))
    return {
        "case": case.name,
        "title": case.title,
        "parameters": list(case.model.parameters),
        "identifies": [
            *(["m"] if finds_mass else []),
            *(name for name in case.model.parameters if name not in case.model.fixed),
        ],
        "warnings": [*case.warnings, *notes],
        **table.extent,
        **case.test.summary(),
    }


def _describe(plan: dict[str, Any]) -> str:
    names = ", ".join(plan["identifies"])
    levels = f"{plan['levels']} level{'' if plan['levels'] == 1 else 's'}"
    if "frequencies" in plan:
        each = plan["points"] // plan["levels"]
        across = "lags" if plan["control"] == "phase" else "frequencies"
        what = f"{levels} x {each} {across} = {plan['points']} points to simulate"
    else:
        band = f"{plan['lowest_frequency']:g} to {plan['highest_frequency']:g} Hz"
        what = f"{plan['points']} measured points at {levels}, {band}, sweep {', '.join(plan['sweeps'])}"
        if "periods" in plan:
            records = f"{plan['records']} records of {plan['periods']} periods"
            what = f"{plan['points']} excited lines of {records} at {levels}, {band}"
    return f"{plan['case']}: {what}; identifies {names}"


def check_command(cases: Cases, data: Data = None, json: Json = False) -> int:
    """Find every fault in case files, and say what a run will do.

    \b
    Examples:
      rsgen check cases
      rsgen check mine.toml --json
    """
    plans: list[dict[str, Any]] = []
    loaded: list[Case] = []
    faults: list[str] = []
    for path in find_cases(cases):
        try:
            case = load_case(path, data)
            loaded.append(case)
            odd = law_faults(case)
            faults += odd
            if not odd:
                plans.append(_plan(case))
        except CaseError as fault:
            faults += fault.faults
        except MeasurementError as fault:
            faults.append(f"{path.name}: test.file: {fault}")
        except RsgenError as fault:
            faults.append(f"{path.name}: test: {' '.join(str(fault).split())}")
        except Exception as fault:
            # a fault of the program must not hide those of other cases
            faults.append(program_fault(fault, path.name))
    faults += name_clashes(loaded).values()
    if json:
        print_json({"cases": plans, "faults": faults})
    else:
        for plan in plans:
            print_line(_describe(plan))
            for warning in plan["warnings"]:
                print_line(f"  note: {warning}")
    print_faults(faults)
    return FAULTY if faults else ACCEPTED
