"""What `rsgen rank` prints: candidate laws, best first, and the verdict."""

from __future__ import annotations

from pathlib import Path

from rsgen.app.cli.progress_bar import stage_progress
from rsgen.app.cli.targets import MODAL, check_target, inputs_of, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import (
    ACCEPTED,
    number,
    print_block,
    print_cache_fault,
    print_json,
    print_line,
    print_verdict,
    verdict_code,
)
from rsgen.app.study import obtain_surface
from rsgen.cases import load_case
from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface, load_surface
from rsgen.formula.units import parameter_units
from rsgen.formula.units.quantities import quantity_text
from rsgen.identification.modal import modal_table
from rsgen.identification.ranking import Ranking, rank
from rsgen.report.page_tables import Modal, modal_entry, score_held_out
from rsgen.report.wording import sentence
from rsgen.report.wording.sentences import state_verdict

__all__ = ["modal_command", "rank_command"]


def _read(path: Path, data: Path | None) -> tuple[str, ResponseSurface, Model | None]:
    """Read a surface, which has no law, or a case with its model."""
    if path.suffix.lower() in (".h5", ".hdf5"):
        return path.stem, load_surface(path), None
    case = load_case(path, data)
    return case.name, obtain_surface(case), case.model


def rank_command(path: Path, data: Path | None, json: bool) -> int:
    """Rank the laws of the library on a case's test or on a saved surface."""
    print_cache_fault()
    name, surface, model = _read(path, data)
    ranking = rank(surface, model)
    if json:
        print_json(
            {
                "case": name,
                **state_verdict(ranking.verdict),
                "fits": ranking.fits,
                "verdict": [sentence(finding) for finding in ranking.findings],
                "findings": [finding.to_dict() for finding in ranking.findings],
                "noise": ranking.noise,
                "unexplained": ranking.unexplained,
                "candidates": [
                    {
                        "name": entry.name,
                        "own": entry.own,
                        "force": entry.force,
                        "parameters": entry.parameters,
                        "held_out_error": entry.held_out_error,
                        "bic": entry.bic,
                        "tied": entry.tied,
                        "values": dict(entry.values),
                    }
                    for entry in ranking.candidates
                ],
            }
        )
        return verdict_code(ranking.verdict.state)
    code = print_verdict(ranking.verdict)
    print_block("", str(ranking))
    for finding in ranking.findings:
        if finding not in ranking.verdict.decided_by and finding != ranking.verdict.summary:
            print_line(sentence(finding))
    print_line(f"best: {ranking.candidates[0].force}")
    print_line(f"with {_values(ranking)}")
    return code


def _values(ranking: Ranking) -> str:
    """Values of the best law with their units, so that absurd ones are seen."""
    try:
        units = parameter_units(ranking.model.force)
    except RsgenError:
        # a law whose terms do not agree in units can be ranked all the same
        units = {}
    units = {"m": "kg", **{name: "" if unit == "1" else unit for name, unit in units.items()}}
    return ", ".join(
        f"{name} = {number(value)} {units.get(name, '')}".rstrip()
        for name, value in ranking.candidates[0].values.items()
    )


# ----------------------------------------------------------------------------
# What `rsgen modal` prints: the modal table of a test, and how well it predicts the levels held out.


def modal_command(path: Path, surface: Path | None, data: Path | None, csv: Path | None, json: bool) -> int:
    """Tabulate the mode of a case from its test or from a saved surface."""
    print_cache_fault()
    case = load_case(path, data)
    target = check_target(csv, ".csv", "--csv") if csv else None
    if target:
        refuse_foreign(target, is_foreign(target, MODAL), inputs_of(case, surface), "--csv")
    with stage_progress(case, "surface") as note:
        note("surface", 0.0)
        tested = load_surface(surface) if surface else obtain_surface(case)
    if not isinstance(tested, ResponseSurface):
        raise RsgenError(
            f"{path.name}: test: a multisine has no modal table; its lines have no amplitude each"
        )
    table = modal_table(tested, case.model)
    modal = Modal(table, held_out=score_held_out(table, tested))
    if target:
        write_atomic(target, table.to_csv())
    said = [sentence(finding) for finding in table.findings]
    if json:
        print_json({"case": case.name, "modal": modal_entry(modal), "warnings": said})
        return ACCEPTED
    for line in str(table).splitlines()[: 2 + len(table)]:
        print_line(line)
    for text in said:
        print_line(f"note: {text}")
    for item in modal.held_out:
        level = quantity_text(item.level, item.level_unit)
        scored = len(item.frequency) - item.missing
        error = f", error {number(100 * item.error, 2)} %" if scored else ": outside the table"
        print_line(
            f"held out {level}, {item.sweep}: {scored} of {len(item.frequency)} points predicted{error}"
        )
    if target:
        print_line(f"{target}: all rows with their intervals")
    return ACCEPTED
