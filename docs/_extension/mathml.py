"""Formulas as MathML, which every current browser shows without a script and without the network."""

from __future__ import annotations

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

# latex2mathml spaces names of functions and slashes as binary operators
_THIN = "0.1667em"
_MENDED = (
    (
        re.compile(r"<m[io]>([A-Za-z]{2,})</m[io]>(?=<mo[^>]*>(?:\(|&#x00028;))"),
        rf'<mo lspace="{_THIN}" rspace="0">\1</mo>',
    ),
    (re.compile(r"<m[io]>([A-Za-z]{2,})</m[io]>"), rf'<mo lspace="{_THIN}" rspace="{_THIN}">\1</mo>'),
    (re.compile(r"<mo>(/|&#x0002F;)</mo>"), '<mo lspace="0" rspace="0">/</mo>'),
)


def to_mathml(latex: str, *, block: bool) -> str:
    """Convert one formula; a formula that cannot be converted ends the build."""
    markup = convert(latex, display="block" if block else "inline")
    for pattern, instead in _MENDED:
        markup = pattern.sub(instead, markup)
    return markup


def _visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(to_mathml(node.astext(), block=False))
    raise nodes.SkipNode


def _visit_block(self: HTML5Translator, node: nodes.math_block) -> None:
    # a long formula is moved sideways with the keyboard as well
    self.body.append(self.starttag(node, "div", CLASS="formula", tabindex="0", role="group"))
    if node["number"]:
        number = get_node_equation_number(self, node)
        self.body.append(f'<span class="number">({number})</span>')
    self.body.append(to_mathml(node.astext(), block=True) + "</div>\n")
    raise nodes.SkipNode


def register(app: Sphinx) -> None:
    """Make this the renderer of mathematics."""
    app.add_html_math_renderer("mathml", (_visit_inline, None), (_visit_block, None))
