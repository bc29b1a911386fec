"""From a response surface to the law behind it: candidates compared, best first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.identification.ranking.rank_laws import rank
    from rsgen.identification.ranking.ranking_result import Candidate, Ranking

__all__ = ["Candidate", "Ranking", "rank"]

# most runs are given their law
__getattr__ = on_first_use(
    __name__, {"Candidate": "ranking_result", "Ranking": "ranking_result", "rank": "rank_laws"}
)
