"""The page of the library of laws, made from `rsgen.laws`: formula, describing function, source, picture."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import rsgen
from rsgen.describing import DescribingFunction, variables_of
from rsgen.law import Law
from rsgen.law.memory import rates_of
from rsgen.law.notation import latex
from rsgen.report.figures import draw_derivation, unit_text

from .execution import drawing_node, made_section

QUICK = 3
"""Laws on the page of a quick build."""


def describe_law(law: Law, function: DescribingFunction) -> str:
    """Write the section of a law in Markdown."""
    arguments = {
        name: ", ".join(map(latex, variables_of(getattr(function, name))))
        for name in ("stiffness", "damping")
    }
    lines = [
        f"`{law.name}`: `{law.text}`",
        _formula("n(x, v)", latex(function.force)),
        *(_formula(rf"\dot {latex(z)}", latex(rate)) for z, rate in rates_of(function.force).items()),
        _formula(f"k({arguments['stiffness']})", latex(function.stiffness)),
        _formula(f"c({arguments['damping']})", latex(function.damping)),
    ]
    if function.mean is None:
        lines.append("The mean $X_0$ follows from the balance of the mean force:")
        lines.append(_formula("0", latex(function.mean_balance)))
    elif function.mean != 0:
        lines.append(_formula("X_0(X)", latex(function.mean)))
    rows = "\n".join(f"| `{entry.name}` | {entry.meaning} | {_unit(entry.unit)} |" for entry in law.table)
    lines.append(f"| parameter | meaning | unit |\n|---|---|---|\n{rows}")
    own = " The describing function is rsgen's own derivation." if law.own else ""
    lines.append(f"Proof: {_proof(function)}. Source: {law.source}.{own}")
    return "\n\n".join(lines) + "\n"


def _formula(head: str, formula: str) -> str:
    return f"$$\n{head} = {formula}\n$$"


def _unit(unit: str) -> str:
    return unit_text(unit) or ("1" if unit == "1" else "follows from the law")


def _proof(function: DescribingFunction) -> str:
    if function.checked_to is None:
        return (
            "no closed form is known; the integral is evaluated by quadrature, split at the switching angles"
        )
    part = "closed form" if function.closed_form else "loop" if function.memory else "closed part"
    return f"the {part} agrees with an independent quadrature to {function.checked_to:.1e}"


class LawLibrary(SphinxDirective):
    """All laws of the library, a section each."""

    def run(self) -> list[nodes.Node]:
        """Derive, describe and draw each law."""
        found: list[nodes.Node] = []
        laws = list(rsgen.laws)
        for law in laws[:QUICK] if self.config.rsgen_quick else laws:
            function = rsgen.derive(law)
            section = made_section(self, law.title, law.name, describe_law(law, function))
            drawing = draw_derivation(function, law.example)
            section.append(drawing_node(drawing, f"law-{law.name}"))
            found.append(section)
        return found


def register(app: Sphinx) -> None:
    """Add the directive."""
    app.add_directive("law-library", LawLibrary)
