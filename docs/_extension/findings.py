"""The table of findings: sentence, threshold, place and next step of each, from the source and its texts."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from functools import partial

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from rsgen.report.wording import CODES, NEXT_STEPS

from .made_findings import SEVERITIES, Threshold, places_of_findings, texts_of

HEADS = ("finding", "sentence", "threshold", "where", "next step")

_FIELD = re.compile(r"\{(\w+)(?::[^}]*)?\}")


def rows() -> Iterator[tuple[str, ...]]:
    """One row a finding, with the columns of ``HEADS``; numbers of a result stand in angle brackets."""
    places = places_of_findings()
    for code in sorted(set(CODES) - {"note"}):
        made = places[code]
        found = {severity for place in made for severity in place.severities}
        severities = ", ".join(severity for severity in SEVERITIES if severity in found)
        thresholds = dict.fromkeys(_told(one) for place in made for one in place.thresholds)
        where = dict.fromkeys(place.where for place in made)
        step = _FIELD.sub(r"<\1>", NEXT_STEPS.get(code, ""))
        yield f"{code} ({severities})", _said(code), "; ".join(thresholds), "; ".join(where), step


def _told(one: Threshold) -> str:
    reason = f": {one.reason.rstrip('.')}" if one.reason else ""
    return f"{one.name} = {one.value:g}{reason}"


def _said(code: str) -> str:
    """The sentence of a code; of one with logic each that its function returns."""
    say = CODES[code]
    if isinstance(say, partial):
        return _FIELD.sub(r"<\1>", say.args[0])
    tree = ast.parse(textwrap.dedent(inspect.getsource(say)))
    returned = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return) and node.value]
    return " / ".join(dict.fromkeys(map(_text, returned)))


def _text(node: ast.expr) -> str:
    """A text of the source, with names in angle brackets for what a result puts in."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(map(_text, parts))
        case ast.IfExp(body=one, orelse=other):
            return f"{_text(one)} / {_text(other)}"
        case ast.FormattedValue(value=value):
            return f"<{(texts_of(value) or [ast.unparse(value)])[0]}>"
    return f"<{(texts_of(node) or [ast.unparse(node)])[0]}>"


class FindingsTable(SphinxDirective):
    """The findings of rsgen, a row each."""

    def run(self) -> list[nodes.Node]:
        """Write the table."""
        group = nodes.tgroup(cols=len(HEADS))
        group += [nodes.colspec(colwidth=width) for width in (15, 30, 25, 15, 15)]
        group += nodes.thead("", _row(HEADS))
        group += nodes.tbody("", *map(_row, rows()))
        return [nodes.table("", group)]


def _row(cells: tuple[str, ...]) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", cell or "–")) for cell in cells))


def register(app: Sphinx) -> None:
    """Add the directive."""
    app.add_directive("findings-table", FindingsTable)
