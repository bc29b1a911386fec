"""Every sentence that rsgen says about a result.

Those about tests stand in ``surface_sentences``, those about fits, excluded points and modal tables in
``identification_sentences``, those about laws, predictions, rankings and comparisons in ``sentences``.

The numerical layers make findings (``rsgen.common.finding``); pages, notebooks, ``result.json`` and the
command line take their sentences from here. Nothing reads a sentence back.
"""

from __future__ import annotations

# importing registers the sentences
from rsgen.report.wording import (  # noqa: F401
    identification_sentences,
    surface_sentences,
)
from rsgen.report.wording.sentences import CODES, NEXT_STEPS, full_sentence, next_step, sentence

__all__ = ["CODES", "NEXT_STEPS", "full_sentence", "next_step", "sentence"]
