"""From a response surface to the law behind it: candidates compared, best first."""

from __future__ import annotations

from rsgen.identification.ranking.rank_laws import identify_best, rank
from rsgen.identification.ranking.ranking_result import Candidate, Ranking

__all__ = ["Candidate", "Ranking", "identify_best", "rank"]
