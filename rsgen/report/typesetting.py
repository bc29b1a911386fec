"""Sentences of the numerical floors, set as a book prints them: 1.6e-08 becomes a power of ten."""

from __future__ import annotations

import re
from collections.abc import Iterable

from rsgen.figures import number_text

__all__ = ["set_sentence"]

_POWER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?e[+-]?\d+\b")
_PER_CENT = re.compile(r"(?<=\d)%")
_FILE = re.compile(r"[^:]*\.\w+: ")
_FIRST = re.compile(r"\w+")


def set_sentence(text: str, names: Iterable[str] = ()) -> str:
    """Set a sentence: powers of ten, a space before the per cent sign, a capital and a full stop.

    Parameters
    ----------
    names
        Parameters, whose spelling is kept at the beginning as well.

    Examples
    --------
    >>> set_sentence("force and response agree within 1.6e-08 of their size")
    'Force and response agree within 1.6 × 10⁻⁸ of their size.'
    >>> set_sentence("kn: untold", ["kn"])
    'kn: untold.'
    >>> set_sentence("run 7.csv: no phase")
    'run 7.csv: no phase.'
    """
    text = _POWER.sub(lambda power: number_text(float(power[0]), 3), text.strip())
    text = _PER_CENT.sub(" %", text)
    first = _FIRST.match(text)
    if first is not None and first[0] not in names and first[0].isalpha() and not _FILE.match(text):
        text = text[0].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) or not text else f"{text}."
