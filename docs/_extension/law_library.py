"""The page of the library of laws, made from `rsgen.laws`: formula, describing function, source, picture."""

from __future__ import annotations

import math

import rsgen
from rsgen.describing.function import DescribingFunction, variables_of
from rsgen.describing.quadrature import PROOF_TOLERANCE
from rsgen.law.element import Law
from rsgen.law.memory import rates_of
from rsgen.law.notation import latex
from rsgen.report.figures import Drawing, draw_derivation, unit_text


def law_sections() -> str:
    """Write all laws of the library in Markdown, a section each."""
    return "\n\n".join(describe_law(law, rsgen.derive(law)) for law in rsgen.laws)


def draw(name: str) -> list[Drawing]:
    """Draw a law and its describing function."""
    law = rsgen.laws[name]
    return [draw_derivation(rsgen.derive(law), law.example)]


def describe_law(law: Law, function: DescribingFunction) -> str:
    """Write the section of a law in Markdown."""
    arguments = {
        name: ", ".join(map(latex, variables_of(getattr(function, name))))
        for name in ("stiffness", "damping")
    }
    lines = [
        f"## {law.title}",
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
    lines.append(f"<!-- drawing: law {law.name} -->")
    return "\n\n".join(lines)


def _formula(head: str, formula: str) -> str:
    return math_block(f"{head} = {formula}")


def math_block(formula: str) -> str:
    """Write a formula that web sites of repositories show, too: they refuse the macro for functions."""
    return f"```math\n{formula}\n```".replace(r"\operatorname", r"\mathrm")


def _unit(unit: str) -> str:
    return unit_text(unit) or ("1" if unit == "1" else "follows from the law")


def _proof(function: DescribingFunction) -> str:
    if function.checked_to is None:
        return (
            "no closed form is used; the integral is evaluated by quadrature, split at the switching angles"
        )
    part = "closed form" if function.closed_form else "loop" if function.memory else "closed part"
    # the last digits of the largest difference are those of a processor
    limit = max(PROOF_TOLERANCE, 10.0 ** math.ceil(math.log10(function.checked_to or PROOF_TOLERANCE)))
    return f"the {part} agrees with an independent quadrature to {limit:g}"
