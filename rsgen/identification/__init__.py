"""From a test to parameters with intervals; the truth is never seen.

``fitting`` is the least squares, ``starting`` its initial values, ``results`` what comes out; ``lines`` is
the same for multisines, ``modal_table`` a mode without a law, ``ranking`` the choice among laws,
``prediction`` what a result says of other levels, held-out ones among them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.identification.lines.line_identification import (
        fit_multisine,
        identify_multisine,
        predict_multisine,
    )
    from rsgen.identification.lines.modal_lines import table_of_lines
    from rsgen.identification.profile import with_profiles
    from rsgen.identification.ranking.rank_laws import rank

__all__ = [
    "fit_multisine",
    "identify_multisine",
    "predict_multisine",
    "rank",
    "table_of_lines",
    "with_profiles",
]

# most laws are given and linear in their parameters, and most tests have one line a record
__getattr__ = on_first_use(
    __name__,
    {
        "fit_multisine": "lines.line_identification",
        "identify_multisine": "lines.line_identification",
        "predict_multisine": "lines.line_identification",
        "rank": "ranking.rank_laws",
        "table_of_lines": "lines.modal_lines",
        "with_profiles": "profile",
    },
)
