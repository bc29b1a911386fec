"""What to do about each finding that casts doubt on a result, from the texts that reports use."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from rsgen.report.wording import NEXT_STEPS

_FIELD = re.compile(r"\{(\w+)(?::[^}]*)?\}")


class NextSteps(SphinxDirective):
    """A list of findings by code, each with its next step; numbers of a result stand in angle brackets."""

    def run(self) -> list[nodes.Node]:
        """Write the list."""
        items = []
        for code, text in sorted(NEXT_STEPS.items()):
            step = nodes.paragraph("", _FIELD.sub(r"<\1>", text))
            term = nodes.term("", "", nodes.literal("", code))
            items.append(nodes.definition_list_item("", term, nodes.definition("", step)))
        return [nodes.definition_list("", *items)]


def register(app: Sphinx) -> None:
    """Add the directive."""
    app.add_directive("next-steps", NextSteps)
