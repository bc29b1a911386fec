"""The command `rsgen identify`: the parameters of a case, and the file of receptances that --frf names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

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
    interval_text,
    number,
    print_json,
    print_line,
    print_next_steps,
    print_table,
    print_verdict,
    verdict_code,
)
from rsgen.app.study import obtain_table
from rsgen.app.study.run_case import identify_case
from rsgen.cases import load_case
from rsgen.common.errors import shown_path
from rsgen.common.tolerances import CONFIDENCE_TEXT
from rsgen.data.surface import ResponseSurface
from rsgen.files import load_surface
from rsgen.identification.prediction import predict
from rsgen.identification.results.result import held_out_lines
from rsgen.report.result_json import fixed_entry, rows_entry
from rsgen.report.wording import sentence
from rsgen.report.wording.sentences import state_verdict

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
        loaded.test.require_surface(
            f"{shown_path(case)}: --frf: of a multisine `rsgen run` writes the receptances"
        )
    with stage_progress(loaded.path) as note:
        note("surface", 0.0)
        tested = load_surface(surface) if surface else obtain_table(loaded)
        note("identification", 0.0)
        identification = identify_case(loaded, tested)
        # as a run of the case would, with its truth
        truth = loaded.with_model(identification.model_given).truth
        comparison = compare(identification, truth, loaded.accept)
        verdict = verdict_of(identification, comparison)
    if target:
        save_frf(target, cast("ResponseSurface", tested), predict(identification, surface=tested))
    warnings = [*map(sentence, identification.findings)]
    if json:
        print_json(
            {
                "case": loaded.name,
                "verdict": state_verdict(verdict),
                "parameters": rows_entry(comparison, forces=False),
                "fixed": fixed_entry(identification),
                "residual": identification.residual,
                "outcome": sentence(identification.outcome),
                "warnings": warnings,
            }
        )
        return verdict_code(verdict.state)
    print_verdict(state_verdict(verdict))
    print_table(
        ("", "per level", "first order", "refined", f"± ({CONFIDENCE_TEXT})", "unit"),
        [
            (
                refined.name,
                *(number(one.value) for one in (*others, refined)),
                interval_text(refined),
                refined.unit,
            )
            for *others, refined in zip(
                identification.paper, identification.first_order, identification.refined, strict=True
            )
        ],
    )
    for one in identification.fixed:
        print_line(f"fixed: {one.name} = {number(one.value)} {one.unit}".rstrip())
    print_line(sentence(identification.outcome))
    for line in held_out_lines(identification.held_out):
        print_line(line)
    for finding in identification.findings:
        if finding not in verdict.decided_by:
            print_line(f"note: {sentence(finding)}")
    return print_next_steps(state_verdict(verdict))
