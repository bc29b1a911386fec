"""The template environment: everything from a file is text, and a missing value is an error."""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from pathlib import Path

import jinja2
from markupsafe import Markup, escape

__all__ = ["TEMPLATES", "coded", "page_environment", "plain_text", "unbroken", "verbatim"]

_MOST_CHARACTERS = 2000
_CATEGORIES = {"Cc", "Cf", "Cs", "Co", "Zl", "Zp"}


TEMPLATES = Path(__file__).resolve().parents[1] / "templates"
"""Package data; the folder of this name beside the package is a link to it."""


def plain_text(text: str, most: int = _MOST_CHARACTERS, keep: str = "") -> str:
    r"""Make invisible characters visible: controls, direction marks, lone surrogates become escapes.

    Parameters
    ----------
    most
        Longer texts are cut, and say so.
    keep
        Characters to leave as they are, such as line ends.

    Examples
    --------
    >>> plain_text("a\x1b[2Jb"), plain_text("\u202egpj.exe")
    ('a\\x1b[2Jb', '\\u202egpj.exe')
    """
    if len(text) > most:
        text = f"{text[:most]}… ({len(text)} characters)"
    return "".join(
        character
        if character in keep or unicodedata.category(character) not in _CATEGORIES
        else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def verbatim(text: str) -> Markup:
    """Give a text of several lines for a ``<pre>`` block: escaped, line ends and tabs kept."""
    return Markup(escape(plain_text(text.replace("\r\n", "\n"), most=200_000, keep="\n\t")))  # noqa: S704 - escaped


def coded(text: str) -> Markup:
    """Show what stands between backticks in a sentence of ours as code; all of it is escaped.

    Examples
    --------
    >>> print(coded("try `rsgen rank <file>` & look"))
    try <code>rsgen rank &lt;file&gt;</code> &amp; look
    """
    shown = str(escape(plain_text(text)))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", shown))  # noqa: S704 - escaped


def unbroken(text: str) -> str:
    """Keep a number, its power of ten and its unit on one line.

    Examples
    --------
    >>> unbroken("4.1 × 10⁻⁶ %")
    '4.1\xa0×\xa010⁻⁶\xa0%'
    """
    return str(text).replace(" × ", "\u00a0×\u00a0").replace(" %", "\u00a0%")


def _finalize(value: object) -> object:
    return plain_text(value) if isinstance(value, str) and not isinstance(value, Markup) else value


@cache
def page_environment() -> jinja2.Environment:
    """Give the environment of the HTML pages: autoescape on, undefined names are errors."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_finalize,
    )
    environment.filters.update(verbatim=verbatim, unbroken=unbroken, coded=coded)
    return environment
