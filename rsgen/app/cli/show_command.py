"""What `rsgen show` does: a page on which the response surface of a result turns."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from rsgen.app.cli.targets import SURFACE_PAGE, check_target, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import ACCEPTED, print_json, print_line
from rsgen.common.output import write_atomic
from rsgen.common.verdict import verdict_lines
from rsgen.report.interactive import render_interactive
from rsgen.report.result_reading import read_result

__all__ = ["show_command"]


def show_command(folder: Path, out: Path | None, open_it: bool, json: bool) -> int:
    """Write the interactive page of a result beside its folder, whose files the manifest lists."""
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
