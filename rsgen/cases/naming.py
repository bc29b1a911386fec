"""What names and descriptive texts of a case may contain: they become folders, files and report headings."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection
from difflib import get_close_matches

from rsgen.common.errors import quote

__all__ = ["is_device", "name_fault", "suggest", "text_fault"]

MAX_NAME = 64
MAX_TEXT = 300
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*\Z")
# Windows opens a device, not a file, under these names
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10))}


def is_device(name: str) -> bool:
    """Whether Windows takes a file name for a device, whatever its ending."""
    return name.casefold().split(".")[0] in _DEVICES


def suggest(word: str, known: Collection[str]) -> str:
    """Give a did-you-mean in words, with a trailing blank, or nothing when no known word is close.

    Examples
    --------
    >>> suggest("frequncy", ["frequency", "level"])
    "did you mean 'frequency'? "
    """
    close = get_close_matches(word[:MAX_NAME], list(known), n=1, cutoff=0.6)
    return f"did you mean {quote(close[0])}? " if close else ""


def name_fault(name: str) -> str | None:
    """Say what is wrong with a name that becomes a folder, or None where nothing is.

    Examples
    --------
    >>> name_fault("cubic-hardening") is None
    True
    >>> name_fault("../evil")
    "'../evil' is not a plain name; letters, digits, - and _ are allowed, a letter or digit first"
    """
    if len(name) > MAX_NAME:
        return f"{quote(name)} has {len(name)} characters; at most {MAX_NAME} are allowed"
    if not _NAME.match(name):
        allowed = "letters, digits, - and _ are allowed, a letter or digit first"
        return f"{quote(name)} is not a plain name; {allowed}"
    if is_device(name):
        return f"{quote(name)} is the name of a device on Windows; choose another name"
    return None


def text_fault(text: str) -> str | None:
    """Say what is wrong with a title or source, or None: one printable line that reorders no text.

    Examples
    --------
    >>> text_fault("Müller & Söhne < 5 %") is None
    True
    >>> text_fault("gpj\\u202eexe")
    'contains U+202E, which is not printable; printable text on one line is allowed'
    """
    if len(text) > MAX_TEXT:
        return f"has {len(text)} characters; at most {MAX_TEXT} are allowed"
    for sign in text:
        # Cc control, Cf format (bidi), Cs surrogate, Co private, Cn unassigned, Zl Zp line separators
        if unicodedata.category(sign) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"):
            return (
                f"contains U+{ord(sign):04X}, which is not printable; printable text on one line is allowed"
            )
    return None if text.strip() else "is empty; a short text is needed"
