"""The command `rsgen modal`: the modal table of a test, and how well it predicts the levels held out."""

from __future__ import annotations

from rsgen.app.cli.progress_bar import tested_case
from rsgen.app.cli.terminal import USABLE_RESULT, Data, Json, OneCase, print_json, print_line
from rsgen.common.text_table import short
from rsgen.identification.modal_table import modal_table
from rsgen.report.page_tables import Modal, score_held_out
from rsgen.report.result_json import modal_entry
from rsgen.report.sentences import sentence


def modal_command(case: OneCase, data: Data = None, json: Json = False) -> int:
    """Tabulate resonance frequency, damping ratio, stiffness and damping over the amplitude, without a law.

    Of the case the test, the mass and [identify] count; its law does not. Levels that are held out are
    predicted from the table and scored. `rsgen run` writes all rows with their intervals to modal.csv.

    \b
    Example:
      rsgen modal cases/cubic.toml
    """
    with tested_case(case, data) as (loaded, tested, _):
        table = modal_table(tested, loaded.model)
    modal = Modal(table, held_out=score_held_out(table, tested))
    if json:
        said = [sentence(finding) for finding in table.findings]
        print_json({"case": loaded.name, "modal": modal_entry(modal), "warnings": said})
        return USABLE_RESULT
    for line in str(table).splitlines()[: 2 + len(table)]:
        print_line(line)
    for finding in table.findings:
        print_line(str(finding))
    for item in modal.held_out:
        scored = len(item.frequency) - item.missing
        error = f", error {short(100 * item.error, 2)} %" if scored else ": outside the table"
        print_line(
            f"held out {item.name}, {item.sweep}: {scored} of {len(item.frequency)} points predicted{error}"
        )
    return USABLE_RESULT
