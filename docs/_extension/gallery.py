"""The gallery: each case of `cases/` simulated, identified and drawn while the pages are built."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import rsgen
from rsgen.law.memory import memory_form
from rsgen.law.notation import latex

from .execution import drawing_node, made_section
from .snippets import ROOT

QUICK = 1
"""Cases in the gallery of a quick build."""


class Gallery(SphinxDirective):
    """A section each case: the law, the picture, the comparison with the truth."""

    def run(self) -> list[nodes.Node]:
        """Run every case."""
        paths = sorted((ROOT / "cases").glob("*.toml"))
        return [self._section(path) for path in (paths[:QUICK] if self.config.rsgen_quick else paths)]

    def _section(self, path: object) -> nodes.Node:
        case = rsgen.load_case(path)
        self.env.note_dependency(str(path))
        surface = rsgen.simulate(case.oscillator, case.test)
        found = rsgen.identify(surface, case.model)
        comparison = rsgen.compare(found, case.truth, case.accept)
        verdict = rsgen.explain(rsgen.verdict_of(found, comparison)).strip().splitlines()[0]
        law = latex(case.oscillator.force)
        remembered = memory_form(case.oscillator.force)
        for rate in () if remembered is None else remembered.rates:
            law += f", \\qquad \\dot{{{latex(rate.symbol)}}} = {latex(rate.rate)}"
        text = f"`cases/{path.name}`; {case.source}.\n\n$$\nn(x, v) = {law}\n$$\n\n"
        text += f"{verdict}\n\n```text\n{comparison}\n```\n"
        section = made_section(self, case.title, case.name, text)
        section.append(drawing_node(rsgen.figures.draw_surface(surface), f"surface-{case.name}"))
        section.append(drawing_node(rsgen.figures.draw_collapse(found), f"collapse-{case.name}"))
        if remembered is not None:
            section.append(drawing_node(rsgen.figures.draw_loops(surface, found), f"loops-{case.name}"))
        return section


def register(app: Sphinx) -> None:
    """Add the directive."""
    app.add_directive("gallery", Gallery)
