"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "Amplitude",
    "Cases",
    "Data",
    "Figures",
    "Json",
    "Memory",
    "OneCase",
    "Out",
    "Plot",
    "Settings",
    "Surface",
]

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
Plot = Annotated[
    Path | None,
    typer.Option(help="Draw the law, k(X) and c(X) into a .svg, .png or .pdf file.", show_default=False),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="A parameter (or omega) of the picture: name=value; others are 1.", show_default=False
    ),
]
Amplitude = Annotated[str | None, typer.Option(help="Largest amplitude, as '2 mm'.", show_default=False)]
Surface = Annotated[
    Path | None,
    typer.Option(help="A response surface that `rsgen simulate` wrote.", show_default=False),
]
Memory = Annotated[list[str] | None, typer.Option(help="A state: 'z = g(x, v, z)'.", show_default=False)]
Figures = Annotated[
    str | None,
    typer.Option(help="Save every figure beside the report, too: pdf, svg or png.", show_default=False),
]
