"""The gallery: each case of `cases/` simulated, identified and compared with its truth."""

from __future__ import annotations

from functools import cache

import rsgen
from rsgen.analysis.comparison import Row
from rsgen.common.text_table import short
from rsgen.law.memory import memory_form
from rsgen.law.notation import latex
from rsgen.report.figures import Drawing

from .law_library import math_block
from .snippets import ROOT

NAMES = sorted(path.stem for path in (ROOT / "cases").glob("*.toml"))


@cache
def results(name: str) -> tuple[rsgen.Case, rsgen.ResponseSurface, rsgen.Identification]:
    """Return a case with its virtual test and what was identified from it."""
    case = rsgen.load_case(ROOT / "cases" / f"{name}.toml")
    surface = rsgen.simulate(case.oscillator, case.test)
    return case, surface, rsgen.identify(surface, case.model)


def gallery_sections() -> str:
    """Write all cases in Markdown, a section each."""
    return "\n\n".join(map(_section, NAMES))


def _section(name: str) -> str:
    case, _, found = results(name)
    comparison = rsgen.compare(found, case.truth, case.accept)
    # how far below its tolerance an error is differs by processor
    verdict = rsgen.explain(rsgen.verdict_of(found, comparison)).strip().partition(", largest")[0]
    law = latex(case.oscillator.force)
    remembered = memory_form(case.oscillator.force)
    for rate in () if remembered is None else remembered.rates:
        law += f", \\qquad \\dot{{{latex(rate.symbol)}}} = {latex(rate.rate)}"
    table = ["| parameter | true | identified | unit | tolerated relative error |", "|---|---|---|---|---|"]
    return "\n\n".join(
        (
            f"## {case.title}",
            f"`cases/{name}.toml`; {case.source}.",
            math_block(f"n(x, v) = {law}"),
            f"{verdict}.",
            "\n".join([*table, *map(_row, comparison)]),
            f"<!-- drawing: case {name} -->",
        )
    )


def _row(row: Row) -> str:
    tolerance = "" if row.tolerance is None else f"{row.tolerance:g}"
    return f"| `{row.name}` | {short(row.true)} | {short(row.refined.value, 5)} | {row.unit} | {tolerance} |"


def draw(name: str) -> list[Drawing]:
    """Draw the response surface, the collapse and, with memory, the loops."""
    case, surface, found = results(name)
    drawings = [rsgen.figures.draw_surface(surface), rsgen.figures.draw_collapse(found)]
    if memory_form(case.oscillator.force) is not None:
        drawings.append(rsgen.figures.draw_loops(surface, found))
    return drawings
