"""The command `rsgen check`: every fault in case files, and what a run will do."""

from __future__ import annotations

from typing import Any

import rsgen
from rsgen.app.cli.derive_command import sentences_of_elements
from rsgen.app.cli.terminal import (
    FAULTY,
    USABLE_RESULT,
    Cases,
    Data,
    Json,
    print_faults,
    print_json,
    print_line,
)
from rsgen.cases.case import Case, law_faults
from rsgen.cases.loading import find_cases, load_case, name_clashes, read
from rsgen.common.errors import (
    CaseError,
    MeasurementError,
    RsgenError,
    faults_of,
    listed,
    one_line,
    shown_path,
)
from rsgen.common.finding import Finding
from rsgen.data.multisine.linear import implausible
from rsgen.data.multisine.spectra import MultisineSpectra, check_records
from rsgen.data.surface.mode_findings import mode_findings
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.files.inspection.listing import unread
from rsgen.files.plan import MeasuredTest
from rsgen.identification.fitting.points import (
    mass_needs,
    per_unit_mass,
    refuse_resonance_alone,
    select_points,
)
from rsgen.identification.fitting.repeats import gather_repeats
from rsgen.law.memory import refuse_free_powers
from rsgen.law.numeric import compile_law
from rsgen.report.sentences import in_order, sentence


def point_faults(case: Case, table: ResponseSurface | MultisineSpectra) -> list[str]:
    """Say why identification or ranking could not use law or points of a test; nothing where they can.

    Parameters
    ----------
    case
        As it was read.
    table
        What was measured, or planned: of a virtual test all points count as settled, for none is simulated.

    Returns
    -------
    list of str
        One sentence a fault, ``file: place: what; what is allowed``.
    """
    try:
        refuse_free_powers(case.model.force, case.model.fixed)
        faults = _faults_of(table, case)
    except RsgenError as fault:
        faults = [one_line(fault)]
    return [f"{shown_path(case.path)}: {text}" for text in faults]


def _faults_of(table: ResponseSurface | MultisineSpectra, case: Case) -> list[str]:
    if isinstance(table, MultisineSpectra):
        check_records(table, case.observation)
        return []
    points = select_points(gather_repeats(table)[0], case.model)
    if case.ranked:
        needed = mass_needs(points, per_unit_mass(table, case.model)[1])
        return [f"model: 'rank' needs the mass, or {needed}"] if needed else []
    if case.oscillator is None:
        model = per_unit_mass(table, case.model)[1]
        refuse_resonance_alone(points, model, remembers=compile_law(model.force).remembers)
    return []


def size_findings(table: ResponseSurface | MultisineSpectra, case: Case) -> list[Finding]:
    """Find what no vibration test can have."""
    calibrated = case.observation.calibrated
    if isinstance(table, MultisineSpectra):
        return list(implausible(table)) if calibrated else []
    mass = case.model.mass if case.observation.background in ("none", "phase") else None
    return mode_findings(table, mass, plausibility_findings(table, calibrated=calibrated))


def _plan(case: Case) -> tuple[dict[str, Any], list[str]]:
    """Return the plan of a run of a case, and what is to be said of it, with the severity of doubts.

    Raises
    ------
    CaseError
        It would refuse the points of the test.
    """
    planned = case.test.planned()
    table = planned
    if table is None:
        test: Any = case.test
        table = read(case) if case.oscillator is None else rsgen.simulate(case.oscillator, test)
    faults = point_faults(case, table)
    if faults:
        raise CaseError(faults)
    # of a virtual test only an amplitude that is held is known
    sized = planned is None or getattr(planned, "control", "") in ("response", "continuation")
    read_as = [f for f in table.findings if f.code != "mass-of-case"]
    findings = (*read_as, *size_findings(table, case)) if sized else ()
    finds_mass = "m" not in case.model.fixed and not table.per_mass
    notes = sentences_of_elements(case.model.elements)
    if isinstance(case.test, MeasuredTest) and (left := unread(case.test)):
        notes.append(f"not read of {case.test.file.name}: {listed(left)}")
    lines = [f"note: {text}" for text in notes]
    # errors first; of one severity in the order in which to look at them
    severities = ("error", "doubt", "warning", "info")
    lines = [*map(str, sorted(in_order(findings), key=lambda f: severities.index(f.severity))), *lines]
    plan = {
        "case": case.name,
        "title": case.title,
        "parameters": list(case.model.parameters),
        "identifies": [
            *(["m"] if finds_mass else []),
            *(name for name in case.model.parameters if name not in case.model.fixed),
        ],
        "warnings": [*notes, *map(sentence, findings)],
        **table.extent,
        **case.test.summary(),
    }
    return plan, lines


def _describe(plan: dict[str, Any]) -> str:
    names = ", ".join(plan["identifies"])
    levels = f"{plan['levels']} level{'' if plan['levels'] == 1 else 's'}"
    if "frequencies" in plan:
        each = plan["points"] // plan["levels"]
        across = "lags" if plan["control"] == "phase" else "frequencies"
        what = f"{levels} x {each} {across} = {plan['points']} points to simulate"
    else:
        band = f"{plan['lowest_frequency']:g} to {plan['highest_frequency']:g} Hz"
        orders = {"up": "ascend", "down": "descend"}
        order = " and ".join(orders[name] for name in plan["sweeps"] if name in orders)
        rows = f" (rows {order})" if order and plan.get("sweeps_recognised") else ""
        sweeps = f"{'read as ' * bool(rows)}sweep {' and '.join(plan['sweeps'])}{rows}"
        what = f"{plan['points']} {plan['kind']} points at {levels}, {band}, {sweeps}"
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
    plans: list[tuple[dict[str, Any], list[str]]] = []
    loaded: list[Case] = []
    faults: list[str] = []
    for path in find_cases(cases):
        try:
            case = load_case(path, data)
            loaded.append(case)
            if odd := law_faults(case):
                raise CaseError(odd)
            plans.append(_plan(case))
        except MeasurementError as fault:
            faults.append(f"{shown_path(path)}: test.file: {fault}")
        except Exception as fault:
            # a fault of the program must not hide those of other cases
            faults += faults_of(fault, shown_path(path), "test: ")
    faults += name_clashes(loaded).values()
    if json:
        print_json({"cases": [plan for plan, _ in plans], "faults": faults})
    else:
        for plan, lines in plans:
            print_line(_describe(plan))
            for line in lines:
                print_line(f"  {line}")
    print_faults(faults)
    return FAULTY if faults else USABLE_RESULT
