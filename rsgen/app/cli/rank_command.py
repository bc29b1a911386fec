"""The command `rsgen rank`: candidate laws, best first, and the verdict."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import nan
from typing import Annotated

import typer

from rsgen.app.cli import terminal
from rsgen.app.cli.progress_bar import print_cache_fault, stage_progress
from rsgen.app.cli.terminal import Data, Json, OneCase
from rsgen.app.study.run_case import obtain_table
from rsgen.cases.loading import load_case
from rsgen.common.text_table import short
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.identification.ranking import Ranking, rank
from rsgen.identification.ranking.library_sums import library_terms
from rsgen.identification.results import units_of
from rsgen.identification.results.result import mass_lines
from rsgen.report.result_json import ranking_entry
from rsgen.report.sentences import ranking_steps, sentence, state_verdict


def rank_command(
    case: OneCase,
    data: Data = None,
    terms_in_sum: Annotated[int, typer.Option(help="Most laws of the library in a sum.", min=1, max=3)] = 2,
    json: Json = False,
) -> int:
    """Compare the laws of the library, alone and in sums, on the test of a case.

    The verdict names the best law and those that fit equally well, or says that none fits and what is left
    unexplained. The law of the case is one more candidate.

    \b
    Example:
      rsgen rank cases/cubic.toml --json
    """
    print_cache_fault()
    loaded = load_case(case, data)
    name, table = loaded.name, obtain_table(loaded)
    counted = "points" if isinstance(table, ResponseSurface) else "records"
    terminal.print_faults(
        [f"{name}: comparing {len(library_terms())} laws and their sums on {len(table)} {counted}"]
    )
    with stage_progress(case) as note:
        ranking = rank(table, loaded.model, terms_in_sum=terms_in_sum, progress=partial(note, "ranking"))
    # of a law that is not to be used values are shown, so that absurd ones are seen, but no intervals
    best = ranking.best.refined if ranking.verdict.usable else ()
    # what the page of this law says, too
    more = [finding for finding in ranking.best.findings if finding not in ranking.findings] if best else []
    if json:
        entry = ranking_entry(ranking)
        terminal.print_json(
            {
                "case": name,
                **state_verdict(ranking.verdict),
                **entry,
                "candidates": [
                    one | {"own": candidate.own, "values": dict(candidate.values)}
                    for one, candidate in zip(entry["candidates"], ranking.candidates, strict=True)
                ],
                "warnings": [*map(sentence, (*ranking.findings, *more))],
                "best": {one.name: {"value": one.value, "interval": [*one.interval]} for one in best},
            }
        )
        return terminal.verdict_code(ranking.verdict.state)
    terminal.print_verdict(state_verdict(ranking.verdict))
    terminal.print_block("", str(ranking))
    for finding in (*ranking.findings, *more):
        if finding not in ranking.verdict.decided_by and finding != ranking.verdict.summary:
            terminal.print_line(sentence(finding))
    terminal.print_line(
        f"{'best' if best else 'least misfit, not to be used as it is'}: {ranking.candidates[0].force}"
    )
    if best:
        # which law is the best may hang on a given mass, too
        notes = tuple(mass_lines(ranking.best)[:1])
        terminal.print_block("", str(replace(ranking.best.table, caption="", notes=notes)))
    else:
        terminal.print_line(f"with {_values(ranking, table)}")
    stated = state_verdict(ranking.verdict)
    return terminal.print_next_steps(stated, ranking_steps(ranking, stated["state"]))


def _values(ranking: Ranking, table: ResponseSurface | MultisineSpectra) -> str:
    """Values of the first law with their units."""
    units = units_of(ranking.model, table.on_mass(ranking.model.mass or nan).units)
    return ", ".join(
        f"{name} = {short(value, 6)} {units.get(name, '')}".rstrip()
        for name, value in ranking.candidates[0].values.items()
    )
