"""The identification that a case asks for: of its own law, or of the best one of a ranking."""

from __future__ import annotations

from rsgen.case import Case
from rsgen.identification import identify
from rsgen.multisine import MultisineSpectra
from rsgen.ranking import identify_best
from rsgen.results import Identification
from rsgen.study.foresight import refuse_ranking
from rsgen.surface import ResponseSurface

__all__ = ["identify_case"]


def identify_case(case: Case, table: ResponseSurface | MultisineSpectra) -> Identification:
    """Identify the law of a case, or rank laws and identify the best.

    Raises
    ------
    RsgenError
        As ``identify`` and ``rank``; or laws are to be ranked on a multisine.
    """
    if isinstance(table, MultisineSpectra):
        refuse_ranking(case)
    if isinstance(table, MultisineSpectra) or not case.ranked:
        return identify(table, case.model)
    return identify_best(table, case.model)
