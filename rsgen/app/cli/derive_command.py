"""The command `rsgen derive`, and how a describing function is shown as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import sympy
import typer

from rsgen.app.cli.terminal import Memory, print_block
from rsgen.common.errors import RsgenError
from rsgen.describing.derivation import derive
from rsgen.describing.function import DescribingFunction, variables_of
from rsgen.formula.names import remembers
from rsgen.law import notation
from rsgen.law.element import Element, forces_by_motion, law_remarks, make_element
from rsgen.law.memory import rates_of
from rsgen.report.sentences import full_sentence, sentence

# ----------------------------------------------------------------------------
# What the commands say of a law before any test: what is odd about it.


def sentences_of_elements(elements: Sequence[Element]) -> list[str]:
    """Say it of the elements of a model: those across two sensors follow another motion than the others."""
    return [text for force in forces_by_motion(elements).values() for text in law_sentences(force)]


def law_sentences(force: sympy.Expr, full: bool = False) -> list[str]:
    """Say what is to be known of a law before any test; ``full`` with capital and full stop."""
    return list(map(full_sentence if full else sentence, law_remarks(force)))


def read_memory(options: Sequence[str]) -> dict[str, str]:
    """Read ``z = g(x, v, z)`` of every state."""
    found: dict[str, str] = {}
    for option in options:
        name, sign, rate = (part.strip() for part in option.partition("="))
        # z' = ... is what books write
        name = name.removesuffix("'").rstrip()
        if not sign or not name or not rate:
            raise RsgenError(
                f"--memory {option!r}: must be 'z = ...', the rate of change of the state z in x, v and z"
            )
        if name in found:
            raise RsgenError(f"--memory {option!r}: the state {name} has an equation already")
        found[name] = rate
    return found


def derive_command(
    expression: Annotated[
        str,
        typer.Argument(help="A force law in x and v; every other name is a parameter.", show_default=False),
    ],
    memory: Memory = None,
    latex: Annotated[bool, typer.Option("--latex", help="Write the formulas as LaTeX.")] = False,
) -> int:
    """Derive equivalent stiffness and damping of a force law, with the proof.

    \b
    Examples:
      rsgen derive "k*x + masing(Min(kt*x, Fs))" --latex
      rsgen derive "k*x + z" --memory "z = alpha*v - bg*abs(v)*z - bd*v*abs(z)"
    """
    function = derive(make_element("law", expression, read_memory(memory or [])))
    describe(function, latex, law_sentences(function.force, full=True))
    return 0


def describe(function: DescribingFunction, latex: bool, notes: Sequence[str] = ()) -> None:
    """Print a describing function line by line, with further notes."""
    show = notation.latex if latex else notation.readable

    def head(name: str, formula: sympy.Expr) -> str:
        return f"{name}({', '.join(map(show, variables_of(formula)))})"

    equations = rates_of(function.force)
    rows = [
        ("force", f"n({', '.join(('x', 'v', *map(show, equations)))})", function.force),
        *(("" if n else "memory", f"{show(z)}'", equations[z]) for n, z in enumerate(equations)),
        ("stiffness", head("k", function.stiffness), function.stiffness),
        ("damping", head("c", function.damping), function.damping),
    ]
    if remembers(function.force):
        rows.append(("energy", head("D", function.energy), function.energy))
    if function.mean is not None:
        rows.append(("mean", head("X0", function.mean) if function.mean != 0 else "X0", function.mean))
    if function.mean != 0:
        rows.append(("balance", "0", function.mean_balance))
    width = max(len(name) for _, name, _ in rows)
    for what, name, formula in rows:
        print_block(f"{what:<9}  {name:<{width}} = ", show(formula))
    for number, regime in enumerate(function.regimes):
        print_block(f"{'' if number else 'regimes':<9}  ", show(regime))
    for number, remark in enumerate((*notes, *function.remarks)):
        print_block(f"{'' if number else 'notes':<9}  ", remark)
    print_block(f"{'proof':<9}  ", function.proof)
