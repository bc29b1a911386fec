"""What the theme leaves out for readers without a mouse: wide tables and programs take the focus."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
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


_NAMED = (
    # what stands in the theme's own text, and what assistive technology needs in its place
    ('role="heading">', 'role="heading" aria-level="2">'),
    ('<aside class="sidebar-drawer"', '<aside class="sidebar-drawer" aria-label="All pages"'),
    ('<aside class="toc-drawer', '<aside aria-label="On this page" class="toc-drawer'),
)


def _name_parts(app: Sphinx, fault: Exception | None) -> None:
    if fault is not None or app.builder.format != "html":
        return
    for page in Path(app.outdir).rglob("*.html"):
        text = named = page.read_text(encoding="utf-8")
        for theirs, ours in _NAMED:
            if ours not in named:
                named = named.replace(theirs, ours)
        if named != text:
            page.write_text(named, encoding="utf-8")


def register(app: Sphinx) -> None:
    """Change the body of each page before it is written, and the theme's part of it afterwards."""
    app.connect("html-page-context", _make_reachable)
    app.connect("build-finished", _name_parts)
