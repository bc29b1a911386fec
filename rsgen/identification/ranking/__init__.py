"""From a response surface to the law behind it: candidates compared, best first.

Why a law is not a candidate, is no longer one, or is not the best, in the order of a ranking:

1. Never tried: a law of the library without a ``Search`` (``library_terms``); between two sensors, where the
   mean of the motion across was not recorded, a term that is not odd (``rank``); sums of more terms than
   ``terms_in_sum``, which is one where the channels of a driven base were misread (``rank``).
2. No stage reached it (``_all_rounds``): a term with memory, where a law without leaves a negligible misfit
   or, on a test without mean and even harmonics, fits in the stages that precede. Each stage but the last is
   passed over as a whole where its best law misses by far.
3. A sum of two terms that a steady-state test does not separate (``is_sensible``).
4. A sum whose friction would feed energy at all values that are tried (``_best_variants``). A single law of
   the library stays, so that its fit says why it is refused.
5. A sum behind the best ones: of three terms, some with values to be tried, by ``_BEAM_WIDTH``, of all by
   ``_SHORTLIST`` and ``_SHORTLIST_WITH_MEMORY``.
6. A sum that equals a law of the user: one row has both (``_merge_equal_laws``).
7. Fitted and refused, a row with a ``fault`` and without values (``fit_candidate``): its force is not finite,
   its friction would feed energy, or it has almost no static stiffness.
8. In a free decay, refused as well: its damper would feed energy, which another law explains without
   (``_settle_best``).
9. Last: it predicts levels worse than a law of fewer parameters does (``order_candidates``).
10. Not the best: the identification does not determine one of its terms, or the law fits worse along its own
    motion, so that a law without the term is as good (``_settle_best``).
"""

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
