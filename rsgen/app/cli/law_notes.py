"""What the commands say of a law before any test: what no test distinguishes, and what is odd about it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rsgen.common.errors import RsgenError

if TYPE_CHECKING:
    import sympy

    from rsgen.law import Element

__all__ = ["law_sentences", "read_memory", "sentences_of_elements"]


def sentences_of_elements(elements: Sequence[Element]) -> list[str]:
    """Say it of the elements of a model: those across two sensors follow another motion than the others."""
    found: list[str] = []
    for place in dict.fromkeys(element.across for element in elements):
        first, *others = (element.force for element in elements if element.across == place)
        found += law_sentences(sum(others, start=first))
    return found


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


def read_memory(options: Sequence[str]) -> dict[str, str]:
    """Read ``z = g(x, v, z)`` of every state."""
    found: dict[str, str] = {}
    for option in options:
        name, sign, rate = (part.strip() for part in option.partition("="))
        # z' = ... is what books write
        name = name.removesuffix("'").rstrip()
        if not sign or not name or not rate:
            raise RsgenError(
                f"--memory {option!r}: must be 'z = ...', the rate of change of the state z in x, v and z"
            )
        if name in found:
            raise RsgenError(f"--memory {option!r}: the state {name} has an equation already")
        found[name] = rate
    return found
