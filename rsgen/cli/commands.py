"""What the commands about cases do: run, check, simulate, identify, report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsgen.case import Case, find_cases, load_case, name_clashes
from rsgen.cli.progress_bar import case_progress, stage_progress
from rsgen.cli.terminal import number, print_faults, print_json, print_line, print_table
from rsgen.errors import CaseError, MeasurementError, RsgenError
from rsgen.measurement import MeasuredTest, read_measurement
from rsgen.simulation import SimulatedTest
from rsgen.study import STAGES, expect

if TYPE_CHECKING:
    from rsgen.identification import Identification
    from rsgen.study import CaseRun
    from rsgen.surface import ResponseSurface

__all__ = [
    "check_command",
    "identify_command",
    "read_surface",
    "report_command",
    "run_command",
    "simulate_command",
]

ACCEPTED, MISSED, FAULTY = 0, 1, 2

FIGURE_KINDS = ("pdf", "svg", "png")


def _code(runs: Sequence[CaseRun]) -> int:
    if any(run.passed is None for run in runs):
        return FAULTY
    return ACCEPTED if all(run.passed for run in runs) else MISSED


def _check_kind(figures: str | None) -> None:
    if figures not in (None, *FIGURE_KINDS):
        raise RsgenError(f"--figures {figures}: must be one of {', '.join(FIGURE_KINDS)}")


def run_command(
    cases: list[Path],
    out: Path,
    force: bool,
    data: Path | None,
    jobs: int | None,
    figures: str | None,
    json: bool,
    cluster: str | None = None,
) -> int:
    """Run cases; the code is 2 if one failed, else 1 if one missed its ``[accept]``, else 0."""
    from rsgen.study import run_cases

    _check_kind(figures)
    files = find_cases(cases)
    words = ("rsgen", "run", *(path.name for path in cases), *(("--force",) if force else ()))
    words += ("--figures", figures) if figures else ()
    with case_progress(len(files), quiet=json) as listener:
        runs = run_cases(
            cases, out, force, data, jobs, words, listener.finished, figures, listener.tell, cluster
        )
    if json:
        print_json(
            [
                {
                    "case": run.name,
                    "file": str(run.path),
                    "passed": run.passed,
                    "skipped": run.skipped,
                    "folder": str(run.folder) if run.folder else None,
                    "seconds": round(run.seconds, 3),
                    "faults": list(run.faults),
                }
                for run in runs
            ]
        )
    elif any(run.folder for run in runs):
        print_line(f"Table of all results: {out / 'index.html'}")
    return _code(runs)


def _plan(case: Case) -> dict[str, Any]:
    test = case.test
    plan: dict[str, Any] = {
        "case": case.name,
        "title": case.title,
        "parameters": list(case.model.parameters),
        "identifies": [*(["m"] if case.model.mass is None else []), *case.model.parameters],
        "warnings": list(case.warnings),
    }
    if isinstance(test, SimulatedTest):
        points = len(test.level) * len(test.frequency)
        plan |= {
            "kind": "simulated",
            "levels": len(test.level),
            "frequencies": len(test.frequency),
            "points": points,
        }
        expected = expect(case, points, test.harmonics)
    else:
        from rsgen.report.wording import sentence

        surface = read_measurement(test)
        plan |= {
            "kind": "measured",
            "file": test.file.name,
            "levels": len(surface.levels),
            "points": len(surface),
            "sweeps": sorted({str(sweep) for sweep in surface.sweep}),
            "lowest_frequency": float(surface.frequency.min()),
            "highest_frequency": float(surface.frequency.max()),
            "warnings": [*case.warnings, *map(sentence, surface.findings)],
        }
        expected = expect(case, len(surface), surface.harmonics.shape[1] - 1)
    plan["seconds"] = {stage: round(seconds, 1) for stage, seconds in expected.seconds.items()}
    plan["seconds_at_most"] = round(expected.total)
    plan["megabytes"] = expected.megabytes
    return plan


def _takes(plan: dict[str, Any]) -> str:
    surface, identification, report = (plan["seconds"][stage] for stage in STAGES)
    work = "simulation" if plan["kind"] == "simulated" else "reading"
    return (
        f"at most about {plan['seconds_at_most']} s ({work} {surface:.0f} s, identification "
        f"{identification:.0f} s, report {report:.0f} s) and {plan['megabytes']} MB"
    )


def _describe(plan: dict[str, Any]) -> str:
    names = ", ".join(plan["identifies"])
    levels = f"{plan['levels']} level{'' if plan['levels'] == 1 else 's'}"
    if plan["kind"] == "simulated":
        return (
            f"{plan['case']}: {levels} x {plan['frequencies']} frequencies = {plan['points']} "
            f"points to simulate; {_takes(plan)}; identifies {names}"
        )
    band = f"{plan['lowest_frequency']:g} to {plan['highest_frequency']:g} Hz"
    return (
        f"{plan['case']}: {plan['points']} measured points at {levels}, {band}, "
        f"sweep {', '.join(plan['sweeps'])}; {_takes(plan)}; identifies {names}"
    )


def check_command(cases: list[Path], data: Path | None, json: bool) -> int:
    """Load cases and measured files and try the laws; the code is 2 if anything is faulty."""
    from rsgen.case.trial import law_faults

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


def read_surface(case: Case) -> ResponseSurface:
    """Simulate the test of a case, or read its measured file."""
    if isinstance(case.test, MeasuredTest):
        return read_measurement(case.test)
    from rsgen.simulation import simulate

    if case.oscillator is None:
        raise RsgenError(f"{case.path.name}: truth: is missing; a simulated case needs it")
    return simulate(case.oscillator, case.test)


def simulate_command(path: Path, out: Path | None, json: bool) -> int:
    """Write the response surface of a simulated case as HDF5."""
    from rsgen.simulation import simulate
    from rsgen.surface import save_surface

    case = load_case(path)
    if not isinstance(case.test, SimulatedTest):
        raise RsgenError(f"{path.name}: test.kind: is 'measured'; only a simulated test can be simulated")
    if case.oscillator is None:
        raise RsgenError(f"{path.name}: truth: is missing; a simulated case needs it")
    target = out or Path(f"{case.name}.h5")
    points = len(case.test.level) * len(case.test.frequency)
    with stage_progress(case, points, "surface") as note:
        surface = simulate(case.oscillator, case.test, progress=lambda share: note("surface", share))
    save_surface(target, surface)
    settled = int(surface.settled.sum())
    if json:
        print_json({"case": case.name, "file": str(target), "points": len(surface), "settled": settled})
    else:
        print_line(f"{case.name}: {len(surface)} points, {settled} settled: {target}")
    return ACCEPTED


def _rows(identification: Identification) -> list[dict[str, Any]]:
    methods = {
        "paper": {estimate.name: estimate for estimate in identification.paper},
        "first_order": {estimate.name: estimate for estimate in identification.first_order},
        "refined": {estimate.name: estimate for estimate in identification.refined},
    }
    rows = []
    for refined in identification.refined:
        row: dict[str, Any] = {"name": refined.name, "unit": refined.unit}
        for method, estimates in methods.items():
            found = estimates.get(refined.name)
            row[method] = (
                None
                if found is None
                else {
                    "value": found.value,
                    "standard_error": found.standard_error,
                    "interval": list(found.interval),
                }
            )
        rows.append(row)
    return rows


def identify_command(path: Path, surface: Path | None, data: Path | None, json: bool) -> int:
    """Identify a case from its test or from a saved surface, and print the estimates."""
    from rsgen.identification import identify
    from rsgen.ranking import identify_best
    from rsgen.report.wording import sentence
    from rsgen.surface import load_surface

    case = load_case(path, data)
    test = case.test
    points = len(test.level) * len(test.frequency) if isinstance(test, SimulatedTest) else 0
    with stage_progress(case, points, "surface", "identification") as note:
        note("surface", 0.0)
        tested = load_surface(surface) if surface else read_surface(case)
        note("identification", 0.0)
        identification = (identify_best if case.ranked else identify)(tested, case.model)
    rows = _rows(identification)
    if json:
        print_json(
            {
                "case": case.name,
                "parameters": rows,
                "residual": identification.residual,
                "outcome": identification.outcome,
                "warnings": [*identification.warnings, *map(sentence, identification.findings)],
            }
        )
        return ACCEPTED
    values = [
        [number(row[m]["value"] if row[m] else None) for m in ("paper", "first_order", "refined")]
        for row in rows
    ]
    errors = [number(row["refined"]["standard_error"], 2) for row in rows]
    print_table(
        ("", "paper", "first order", "refined", "std. error", "unit"),
        [
            (row["name"], *value, error, row["unit"])
            for row, value, error in zip(rows, values, errors, strict=True)
        ],
    )
    print_line(identification.outcome)
    for warning in (*identification.warnings, *map(sentence, identification.findings)):
        print_line(f"note: {warning}")
    return ACCEPTED


def report_command(cases: list[Path], out: Path, data: Path | None, figures: str | None, json: bool) -> int:
    """Write reports from saved surfaces, then the index; without cases the index alone."""
    _check_kind(figures)
    if figures and not cases:
        raise RsgenError("--figures: is for the reports of cases; name them")
    if not out.is_dir():
        raise RsgenError(f"{out}: is no folder of results; run `rsgen run` first or give --out")
    from rsgen.report import write_index
    from rsgen.study import rewrite_report

    runs = []
    if cases:
        files = find_cases(cases)
        with case_progress(len(files), quiet=json) as listener:
            for path in files:
                words = ("rsgen", "report", path.name)
                runs.append(rewrite_report(path, out, data, words, figures, listener.tell))
                listener.finished(runs[-1])
    if not cases or any(run.folder for run in runs):
        write_index(out)
    if json:
        print_json({"index": str(out / "index.html"), "cases": [run.name for run in runs]})
    elif not cases:
        print_line(f"Table of all results: {out / 'index.html'}")
    return _code(runs)
