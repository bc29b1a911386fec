"""Figures inside a page: SVG that takes its colours from the page and clashes with no other figure.

A picture that stands in a file of its own brings the colours of light and dark pages with it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

if TYPE_CHECKING:
    from rsgen.report.figures import Drawing

__all__ = ["THUMBNAIL", "inline_svg", "picture_svg"]

THUMBNAIL = "thumbnail.svg"
"""The file of a result by whose picture the index shows it."""

# the neutral colours of the style file become variables of the page, so that dark pages have dark figures
_COLOURS = {
    "#1b1c1e": "var(--ink)",
    "#fdfcfa": "var(--sheet)",
    "#6c6e70": "var(--dim)",
    "#dddcda": "var(--line)",
    "#0072b2": "var(--point)",
}


_LIGHT_AND_DARK = (
    "<style>*{stroke-linejoin:round;stroke-linecap:butt}:root{--ink:#1b1c1e;--sheet:#fdfcfa}"
    "@media (prefers-color-scheme:dark){:root{--ink:#e8e6e2;--sheet:#1f2225}}</style>"
)
"""For a picture without a page around it: its rules and those two of the page's colours that it has."""


def _coloured(drawing: Drawing) -> str:
    """Draw as one ``<svg>`` element whose neutral colours are the variables of a page, without rules."""
    text = drawing.render("svg").decode("utf-8")
    text = text[text.index("<svg") :]
    # a style sheet inside an inline SVG would act on the whole page; the page has these rules for figures
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for colour, variable in _COLOURS.items():
        text = text.replace(colour, variable)
    return text


def picture_svg(drawing: Drawing) -> str:
    """Give the figure as an SVG file, which follows the reader's choice of light or dark."""
    head, rest = _coloured(drawing).split(">", 1)
    return f"{head}>{_LIGHT_AND_DARK}{rest}"


def inline_svg(drawing: Drawing) -> Markup:
    """Give the figure as one ``<svg>`` element: own ids, no fixed size, named by its alternative text."""
    text = _coloured(drawing)
    text = re.sub(r' (?:xmlns(?::xlink)?|version)="[^"]*"', "", text)
    text = text.replace("xlink:href=", "href=")
    prefix = f"{drawing.name}-"
    text = re.sub(r'\bid="', f'id="{prefix}', text)
    text = re.sub(r'href="#', f'href="#{prefix}', text)
    text = text.replace("url(#", f"url(#{prefix}")
    size = re.search(r'<svg width="([0-9.]+)pt" height="([0-9.]+)pt"', text)
    if size is None:  # pragma: no cover - matplotlib has written this for twenty years
        raise ValueError("matplotlib wrote an SVG without size")
    named = f'<svg class="drawing" role="img" aria-label="{escape(drawing.alternative)}"'
    text = text.replace(size[0], named, 1)
    text = re.sub(r">\s+<", ">\n<", text)
    return Markup(text)  # noqa: S704 - written by matplotlib, which escapes text; the label is escaped here
