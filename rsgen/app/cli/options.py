"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Cases = Annotated[list[Path], typer.Argument(help="Case files, or folders of them.", show_default=False)]
OneCase = Annotated[Path, typer.Argument(help="A case file.", show_default=False)]
Out = Annotated[Path, typer.Option("--out", "-o", help="The folder of all results.")]
Data = Annotated[
    Path | None,
    typer.Option(
        help="Folder of measured files; otherwise RSGEN_DATA, then the case's own.", show_default=False
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Answer as JSON, for programs.")]
Memory = Annotated[list[str] | None, typer.Option(help="A state: 'z = g(x, v, z)'.", show_default=False)]
Figures = Annotated[
    str | None,
    typer.Option(help="Save every figure with the report, too: pdf, svg or png.", show_default=False),
]
