"""Every sentence that rsgen says about a result, one function a finding.

The numerical layers make findings (``rsgen.finding``); pages, notebooks, ``result.json`` and the command line
take their sentences from here. Nothing reads a sentence back.
"""

from __future__ import annotations

from collections.abc import Callable

from rsgen.finding import Finding

__all__ = ["sentence"]

_SENTENCES: dict[str, Callable[[Finding], str]] = {}


def _says(code: str) -> Callable[[Callable[[Finding], str]], Callable[[Finding], str]]:
    """Register the sentence of a code."""

    def register(function: Callable[[Finding], str]) -> Callable[[Finding], str]:
        _SENTENCES[code] = function
        return function

    return register


def sentence(finding: Finding) -> str:
    """Say a finding in one sentence; a code without a sentence is shown as data."""
    say = _SENTENCES.get(finding.code)
    return repr(finding) if say is None else say(finding)


# --- measurement and history ---


# --- identification ---


# --- ranking and prediction ---
