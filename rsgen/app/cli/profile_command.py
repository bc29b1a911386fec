"""The command `rsgen profile`: how the misfit grows as one parameter leaves its value."""

from __future__ import annotations

from typing import Annotated

import typer

from rsgen.app.cli.progress_bar import print_cache_fault, stage_progress
from rsgen.app.cli.terminal import Data, Json, OneCase, print_block, print_json
from rsgen.app.study.run_case import identify_case, obtain_table
from rsgen.cases.loading import load_case
from rsgen.identification.profile import profile
from rsgen.report.result_json import finite_or_none


def profile_command(
    case: OneCase,
    name: Annotated[str, typer.Argument(help="A parameter of the law, or m.", show_default=False)],
    data: Data = None,
    json: Json = False,
) -> int:
    """Profile the likelihood of one parameter: its interval where a standard error says too little.

    \b
    Examples:
      rsgen profile cases/formats/csv-table.toml kn
      rsgen profile cases/formats/csv-table.toml m --json
    """
    print_cache_fault()
    loaded = load_case(case, data)
    with stage_progress(loaded.path) as note:
        note("surface", 0.0)
        tested = obtain_table(loaded)
        found = profile(identify_case(loaded, tested, note), name)
    if json:
        columns = {
            "interval": found.interval,
            "wald": found.wald,
            "followed": found.followed,
            "values": found.values.tolist(),
            "root": found.root.tolist(),
        }
        entry = {key: list(map(finite_or_none, column)) for key, column in columns.items()}
        print_json({"case": loaded.name, "name": name, "unit": found.unit, **entry})
        return 0
    print_block("", str(found))
    return 0
