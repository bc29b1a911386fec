"""The command `rsgen show`: a page on which the response surface of a result turns."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.options import SURFACE_PAGE, Json, check_target, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import ACCEPTED, print_json, print_line
from rsgen.common.finding import verdict_lines
from rsgen.common.output import write_atomic
from rsgen.report.page import render_interactive
from rsgen.report.result_json import read_result

__all__ = ["show_command"]


def show_command(
    folder: Annotated[Path, typer.Argument(help="reports/<case>.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The page.", show_default="<folder>-surface.html")
    ] = None,
    open_it: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    json: Json = False,
) -> int:
    """Write a page on which the response surface turns and shows its values (needs rsgen[show]).

    \b
    Examples:
      rsgen show reports/cubic --open
      rsgen show reports/cubic --out cubic-surface.html
    """
    target = check_target(out or folder.with_name(f"{folder.resolve().name}-surface.html"), ".html")
    refuse_foreign(target, is_foreign(target, SURFACE_PAGE), ())
    write_atomic(target, render_interactive(folder))
    entry = read_result(folder / "result.json")
    if json:
        print_json({"file": str(target), "verdict": entry and entry.verdict})
    else:
        for line in verdict_lines(entry.verdict) if entry else ():
            print_line(line)
        print_line(f"{target}: open it in a browser")
    if open_it:
        webbrowser.open(target.resolve().as_uri())
    return ACCEPTED
