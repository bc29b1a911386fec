"""The command `rsgen profile`: how the misfit grows as one parameter leaves its value."""

from __future__ import annotations

from typing import Annotated

import typer

from rsgen.app.cli.progress_bar import tested_case
from rsgen.app.cli.terminal import Data, Json, OneCase, print_block, print_json
from rsgen.app.study.run_case import identify_case
from rsgen.identification.profile import profile


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
    with tested_case(case, data) as (loaded, tested, note):
        found = profile(identify_case(loaded, tested, note), name)
    if json:
        print_json(
            {
                "case": loaded.name,
                "name": name,
                "unit": found.unit,
                "interval": found.interval,
                "wald": found.wald,
                "followed": found.followed,
                "values": found.values.tolist(),
                "root": found.root.tolist(),
            }
        )
        return 0
    print_block("", str(found))
    return 0
