"""The command `rsgen inspect`: the trees of data files, and [test] tables of cases that would read them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import Annotated, Any

import typer

from rsgen.app.cli.terminal import Json, print_faults, print_json, print_line
from rsgen.common.errors import shown_path
from rsgen.common.text_table import aligned
from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import Proposal, propose
from rsgen.files.sandbox import reading_fault
from rsgen.files.tree import SHOWN_CHARACTERS, TEXT, Contents, Entry

MAX_ARRAYS = 60
"""Shown in a table; --all and --json list all."""


def _text(value: str) -> str:
    """Write a text as a TOML string; a file's names may hold any sign."""
    # half a surrogate pair is no Unicode, and a file may hold it
    legal = "".join("\ufffd" if 0xD800 <= ord(sign) <= 0xDFFF else sign for sign in value)
    escaped = legal.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(s if s.isprintable() else f"\\U{ord(s):08x}" for s in escaped) + '"'


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return _text(value) if isinstance(value, str) else str(value)


def proposal_text(proposal: Proposal) -> str:
    """Write a proposal as TOML, with a comment where the user must look."""
    lines: list[str] = []
    for name, table in proposal.tables.items():
        lines.append(f"[{name}]")
        width = max((len(key) for key in table), default=0)
        for key, value in table.items():
            doubt = proposal.doubts.get(f"{name}.{key}", "")
            line = f"{key:<{width}} = {_value(value)}"
            plain = "".join(sign if sign.isprintable() else "?" for sign in doubt)
            lines.append(f"{line:<36} # {plain}" if doubt else line)
        lines.append("")
    return "\n".join(lines)


def _shape(entry: Entry) -> str:
    return " x ".join(map(str, entry.shape)) or ("1" if entry.dtype else "-")


def _unit(entry: Entry) -> str:
    return f"{entry.unit} ({entry.unit_source})" if entry.unit and entry.unit_source else entry.unit or "-"


def _rows(entry: Entry) -> list[tuple[str, ...]]:
    """Return an array in a row, and what is said of it, where that is long, in further ones."""
    *cells, values = _cells(entry)
    texts = values.split("\n")
    first, *more = [line for text in texts for line in wrap(text, 2 * SHOWN_CHARACTERS) or [""]]
    return [(*cells, first), *(("", "", "", "", f"  {line}") for line in more)]


def _cells(entry: Entry) -> tuple[str, ...]:
    if entry.dtype == TEXT:
        return entry.path, "-", TEXT, "-", repr(entry.remark)
    if entry.fault:
        return entry.path, _shape(entry), entry.dtype or "-", _unit(entry), entry.fault[:SHOWN_CHARACTERS]
    more = ", ..." if entry.size > len(entry.first) else ""
    values = ", ".join(entry.first) + more
    title = "" if entry.path.endswith(entry.title) or entry.title in entry.remark else entry.title
    about = ", ".join(filter(None, (title, entry.remark)))
    if about:
        values += f"{'  ' if len(values + about) < 2 * SHOWN_CHARACTERS else chr(10)}({about})"
    return entry.path, _shape(entry), entry.dtype, _unit(entry), values


def _show(contents: Contents, proposal: Proposal | None, everything: bool) -> None:
    usable = [entry for entry in contents.entries if entry.dtype and not entry.fault]
    shown = list(contents.entries)
    if len(shown) > MAX_ARRAYS and not everything:
        # rows of numbers say more than the settings of an instrument
        shown = sorted(shown, key=lambda entry: (bool(entry.fault), entry.size < 2))[:MAX_ARRAYS]
    print_line(f"{contents.file.name}: {contents.format}, {len(usable)} arrays of numbers")
    header = ("path", "shape", "kind", "unit", "values")
    rows = [row for entry in shown for row in _rows(entry)]
    for line in aligned([header, *rows]):
        print_line(line)
    # a fault of many arrays is printed once, and in full
    long = {entry.fault: entry.path for entry in reversed(shown) if len(entry.fault) > SHOWN_CHARACTERS}
    for fault, path in reversed(long.items()):
        print_line(fault if fault.startswith(shown_path(contents.file)) else f"{path}: {fault}")
    if contents.remark:
        print_line(contents.remark)
    if len(contents.entries) > len(shown):
        print_line(f"... and {len(contents.entries) - len(shown)} more: --all lists them")
    print_line()
    if proposal is None:
        print_line("No columns of numbers over one another are in it; name some in a [test] table yourself.")
        return
    print_line("# a draft by names and units, for a case file; `rsgen init --from` writes it")
    for line in proposal_text(proposal).split("\n"):
        print_line(line)


def inspect_command(
    files: Annotated[list[Path], typer.Argument(help="Measured files of any format.", show_default=False)],
    everything: Annotated[bool, typer.Option("--all", help="List every array.")] = False,
    json: Json = False,
) -> int:
    """Show what is in data files (text, MATLAB, universal, TDMS, Excel, ...), and propose a [test] table.

    \b
    Examples:
      rsgen inspect sweep.mat
      rsgen inspect receptances.uff --json
    """
    read = [list_contents(file) for file in files]
    # said at the first look into binary files
    fault = None if all(contents.format == "csv" for contents in read) else reading_fault()
    if fault is not None:
        limits = f"of the process that reads a binary file this system limits {fault}"
        print_faults([f"note: {limits}; open files of strangers on Linux"])
    proposals = [propose(contents) for contents in read]
    if json:
        found = [
            {
                "file": str(file),
                "format": contents.format,
                "remark": contents.remark,
                "entries": [asdict(entry) for entry in contents.entries],
                "test": proposal.tables if proposal else None,
                "doubts": proposal.doubts if proposal else {},
            }
            for file, contents, proposal in zip(files, read, proposals, strict=True)
        ]
        print_json(found[0] if len(found) == 1 else {"files": found})
        return 0
    for contents, proposal in zip(read, proposals, strict=True):
        _show(contents, proposal, everything)
    if any(proposals):
        print_line("Then `rsgen check` reads the data, and says what is odd about them.")
    return 0
