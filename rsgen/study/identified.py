"""The identification that a case asks for: of its own law, or of the best one of a ranking."""

from __future__ import annotations

from rsgen.case import Case
from rsgen.errors import RsgenError
from rsgen.identification import Identification, identify
from rsgen.multisine import MultisineSpectra
from rsgen.ranking import identify_best
from rsgen.surface import ResponseSurface

__all__ = ["identify_case"]


def identify_case(case: Case, table: ResponseSurface | MultisineSpectra) -> Identification:
    """Identify the law of a case, or rank laws and identify the best.

    Raises
    ------
    RsgenError
        As ``identify`` and ``rank``; or laws are to be ranked on a multisine.
    """
    if not case.ranked:
        return identify(table, case.model)
    if isinstance(table, MultisineSpectra):
        raise RsgenError(
            f"{case.path.name}: model: 'rank' compares laws on a response surface; of a multisine identify "
            "one law after the other, and compare their misfits"
        )
    return identify_best(table, case.model)
