"""Every sentence that rsgen says about a result: a file a layer, with a table of texts and a few functions.

The numerical layers make findings (``rsgen.common.finding``); pages, notebooks, ``result.json`` and the
command line take their sentences from here. Nothing reads a sentence back.
"""

from __future__ import annotations

# importing registers the sentences
from rsgen.report.wording import (  # noqa: F401
    identification_sentences,
    law_sentences,
    surface_sentences,
)
from rsgen.report.wording.sentences import CODES, NEXT_STEPS, full_sentence, next_step, sentence

__all__ = ["CODES", "NEXT_STEPS", "full_sentence", "next_step", "sentence"]
