"""The command `rsgen identify`: the parameters of a case."""

from __future__ import annotations

from dataclasses import replace

from rsgen.analysis.comparison import all_findings, compare, verdict_of
from rsgen.app.cli import terminal
from rsgen.app.cli.progress_bar import tested_case
from rsgen.app.cli.terminal import Data, Json, OneCase
from rsgen.app.study.run_case import identify_case
from rsgen.identification.prediction.resonance_curves import predict_shown
from rsgen.identification.results.result import held_out_lines, mass_lines
from rsgen.report.provenance import Subject
from rsgen.report.result_json import fixed_entry, rows_entry
from rsgen.report.sentences import sentence, state_verdict


def identify_command(case: OneCase, data: Data = None, json: Json = False) -> int:
    """Identify the parameters of a case and print them; nothing is written.

    \b
    Example:
      rsgen identify cases/cubic.toml --json
    """
    with tested_case(case, data) as (loaded, tested, note):
        identification = identify_case(loaded, tested, note)
        note("prediction", 0.0)
        # as a run of the case would, with its truth
        subject = Subject.of_case(loaded, identification)
        comparison = compare(identification, subject.truth, loaded.accept)
        prediction = predict_shown(tested, identification)
        verdict = verdict_of(identification, comparison, prediction)
    findings = all_findings(identification, prediction)
    if json:
        terminal.print_json(
            {
                "case": loaded.name,
                "verdict": state_verdict(verdict),
                "parameters": rows_entry(comparison, forces=False),
                "fixed": fixed_entry(identification),
                "residual": identification.residual,
                "outcome": sentence(identification.outcome),
                "warnings": [*map(sentence, findings)],
            }
        )
        return terminal.verdict_code(verdict.state)
    terminal.print_verdict(state_verdict(verdict))
    # as print(found) shows it; verdict and findings stand around it
    table = identification.table
    law = table.caption.partition("\n")[2]
    notes = (*table.notes[:1], *mass_lines(identification, rms=subject.scale_is_sure))
    terminal.print_block("", str(replace(table, caption=law, notes=notes)))
    terminal.print_line(sentence(identification.outcome))
    for line in held_out_lines(identification.held_out, verdict.usable):
        terminal.print_line(line)
    for finding in findings:
        if finding not in verdict.decided_by:
            terminal.print_line(str(finding))
    return terminal.print_next_steps(state_verdict(verdict))
