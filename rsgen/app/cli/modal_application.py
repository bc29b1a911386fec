"""The command `rsgen modal`, beside the others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.application import Data, Json, OneCase, Surface, application

__all__ = ["application"]

Csv = Annotated[
    Path | None,
    typer.Option("--csv", help="Write all rows with their intervals, SI units.", show_default=False),
]


@application.command(short_help="Frequency and damping over amplitude, without a law.")
def modal(
    case: OneCase, surface: Surface = None, data: Data = None, csv: Csv = None, json: Json = False
) -> None:
    """Tabulate resonance frequency, damping ratio, stiffness and damping over the amplitude, without a law.

    Of the case the test, the mass and [identify] count; its law does not. Levels that are held out are
    predicted from the table and scored.

    \b
    Examples:
      rsgen modal cases/cubic.toml
      rsgen modal cases/cubic.toml --surface cubic.h5 --csv modal.csv
    """
    from rsgen.app.cli.modal_command import modal_command

    raise typer.Exit(modal_command(case, surface, data, csv, json))
