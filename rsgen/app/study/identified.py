"""The identification that a case asks for: of its own law, or of the best one of a ranking."""

from __future__ import annotations

from rsgen.app.study.foresight import refuse_ranking
from rsgen.cases import Case
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface
from rsgen.identification.identify import identify
from rsgen.identification.ranking import identify_best
from rsgen.identification.results import Identification

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
