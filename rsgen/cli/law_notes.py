"""What the commands say of a law before any test: what no test tells apart, and what is odd about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy

__all__ = ["law_sentences"]


def law_sentences(force: sympy.Expr, full: bool = False) -> list[str]:
    """Say what is to be known of a law before any test; ``full`` with capital and full stop."""
    from rsgen.law.identifiable import combinations_of
    from rsgen.law.remarks import law_remarks

    found = [*(combination.finding for combination in combinations_of(force)), *law_remarks(force)]
    if not found:
        # the sentences stand in a package that imports the figures
        return []
    from rsgen.report.wording import full_sentence, sentence

    return [(full_sentence if full else sentence)(finding) for finding in found]
