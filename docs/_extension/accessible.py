"""What the theme leaves out for readers without a mouse: wide tables and programs take the focus."""

from __future__ import annotations

import itertools
import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_TABLE = re.compile(r'<div class="table-wrapper([^"]*)"')
_PROGRAM = re.compile(r"<pre>")


def _make_reachable(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document | None
) -> None:
    if "body" not in context:
        return
    tables, programs = itertools.count(1), itertools.count(1)

    def name_table(found: re.Match[str]) -> str:
        focus = f'tabindex="0" role="region" aria-label="Table {next(tables)}"'
        return f'<div {focus} class="table-wrapper{found[1]}"'

    def name_program(found: re.Match[str]) -> str:
        return f'<pre tabindex="0" role="region" aria-label="Text to copy {next(programs)}">'

    body = _TABLE.sub(name_table, context["body"])
    context["body"] = _PROGRAM.sub(name_program, body)


def register(app: Sphinx) -> None:
    """Change every page just before it is written."""
    app.connect("html-page-context", _make_reachable)
