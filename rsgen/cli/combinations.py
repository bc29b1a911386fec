"""What the commands say of parameters that no test tells apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import sympy

__all__ = ["combination_sentences"]


def combination_sentences(force: sympy.Expr, full: bool = False) -> list[str]:
    """Say which parameters can be identified in combinations only; ``full`` with capital and full stop."""
    from rsgen.law.identifiable import combinations_of

    found = combinations_of(force)
    if not found:
        # the sentences stand in a package that imports the figures
        return []
    from rsgen.report.wording import full_sentence, sentence

    return [(full_sentence if full else sentence)(combination.finding) for combination in found]
