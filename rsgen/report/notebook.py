"""notebook.ipynb: the analysis of a case step by step, to be executed, by the public API only."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from rsgen.cases import Case
from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic
from rsgen.report.provenance import notebook_mark, plain_text, template_environment

_SURFACE_FILE = "surface.h5"
_METADATA = {
    "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
    "language_info": {"name": "python", "file_extension": ".py", "mimetype": "text/x-python"},
}
_CELL = re.compile(r"^--- (?P<kind>markdown|code) (?P<id>[a-z0-9-]+)\n", flags=re.MULTILINE)
# what markdown, mathematics in markdown, or HTML gives a meaning to inside a line
_MARKED = re.compile(r"[\\`*_{}\[\]<>&$~#|!@:]")


class _Safe(str):
    """Text that is ready for its place in a cell; the templates take nothing else."""

    __slots__ = ()


def literal(text: str) -> _Safe:
    r"""Write a text as a Python string literal on one line; whatever it contains, it stays a string.

    Examples
    --------
    >>> print(literal('"; import os\n!ls'))
    '"; import os\n!ls'
    """
    # whichever quotation mark needs fewer escapes, as formatters of Python have it
    mark = "'" if text.count('"') > text.count("'") else '"'
    quoted = {mark: f"\\{mark}", "\\": "\\\\", "\n": "\\n", "\t": "\\t"}
    return _Safe(
        mark
        + "".join(
            quoted.get(c) or (c if c.isprintable() else c.encode("unicode_escape").decode("ascii"))
            for c in text
        )
        + mark
    )


def prose(text: str) -> _Safe:
    """Write a text for a markdown cell; nothing in it is markup.

    Character references are text to markdown and to mathematics alike; backslashes are not.

    Examples
    --------
    >>> print(prose("[c](javascript:alert(1)) <b>"))
    &#91;c&#93;(javascript&#58;alert(1)) &#60;b&#62;
    """
    shown = plain_text(" ".join(text.splitlines()) or " ")
    return _Safe(_MARKED.sub(lambda match: f"&#{ord(match[0])};", shown))


def _lines(text: str) -> _Safe:
    """Write a text of several lines as literals, one a line."""
    parts = text.replace("\r\n", "\n").splitlines(keepends=True) or [""]
    return _Safe("\n".join(f"    {literal(part)}" for part in parts))


def _only_safe(value: object) -> object:
    if isinstance(value, _Safe | int):
        return value
    raise RsgenError(
        f"notebook template: a {type(value).__name__} goes into a cell neither as literal nor as prose"
    )


@cache
def _environment() -> jinja2.Environment:
    # no HTML: every value passes _only_safe
    environment = template_environment(False, _only_safe)
    environment.filters.update(literal=literal, prose=prose, lines=_lines)
    return environment


def build_notebook(
    case: Case,
    *,
    mean: bool = False,
    held_out: bool = False,
    loops: bool = False,
) -> dict[str, Any]:
    """Build the notebook of a case, in format 4.5 of Jupyter, not executed.

    Parameters
    ----------
    mean
        Show one period of the motion: for laws that push the mean off zero.
    held_out
        Show the levels that identification has not seen.
    loops
        Show the loops of the restoring force and the energy that they dissipate.
    """
    cells_text = _environment().get_template("notebook/cells.txt")
    text = cells_text.render(
        title=case.title or case.name,
        across=bool(case.model.sensors),
        source=case.source,
        name=case.name,
        case_text=case.text,
        simulated=case.oscillator is not None,
        multisine=case.test.many_lines,
        known=case.truth is not None,
        mean=mean,
        held_out=held_out,
        loops=loops,
        ranked=case.ranked,
        surface_file=_SURFACE_FILE,
    )
    cells: list[dict[str, Any]] = []
    pieces = _CELL.split(text)[1:]
    for kind, name, body in zip(pieces[::3], pieces[1::3], pieces[2::3], strict=True):
        cell: dict[str, Any] = {
            "cell_type": kind,
            "id": name,
            "metadata": {},
            "source": body.strip("\n").splitlines(True),
        }
        cells.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    mark = notebook_mark("".join(cell["source"]) for cell in cells)
    return {"cells": cells, "metadata": {**_METADATA, "rsgen": mark}, "nbformat": 4, "nbformat_minor": 5}


def write_notebook(path: Path, case: Case, *, mean: bool, held_out: bool, loops: bool) -> None:
    """Write the notebook of a case; see `build_notebook`."""
    notebook = build_notebook(case, mean=mean, held_out=held_out, loops=loops)
    write_atomic(path, json.dumps(notebook, indent=1, ensure_ascii=False) + "\n")
