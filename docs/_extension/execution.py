"""Directives that run what they show: `shell`, `python` and `file`, each with what it printed below."""

from __future__ import annotations

import logging
import re
import shlex
import shutil
import tempfile
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from rsgen.report.page import inline_svg

from . import gallery, law_library
from .snippets import SnippetError, Workspace

_HIGHLIGHTED = ("toml", "py", "json")
"""Files whose suffix is the name of a grammar; others are plain text."""

_OF_BUILD: dict[str, Workspace] = {}


def _workspace() -> Workspace:
    """The one folder of a build."""
    if not _OF_BUILD:
        _OF_BUILD["this"] = Workspace(Path(tempfile.mkdtemp(prefix="rsgen-docs-")))
    return _OF_BUILD["this"]


def _leave(app: Sphinx, fault: Exception | None) -> None:
    for workspace in _OF_BUILD.values():
        shutil.rmtree(workspace.folder, ignore_errors=True)
    _OF_BUILD.clear()


def _shown(text: str, language: str, classes: tuple[str, ...] = ()) -> nodes.literal_block:
    block = nodes.literal_block(text, text, language=language)
    block["classes"].extend(classes)
    return block


def drawing_node(drawing: Any, name: str) -> nodes.raw:
    """A figure of rsgen inside the page, in the colours of the page."""
    # a text: what replaces parts of a Markup is escaped
    markup = str(inline_svg(drawing))
    # several figures of one kind stand on one page: their inner names differ
    markup = markup.replace(f'id="{drawing.name}-', f'id="{name}-')
    markup = markup.replace(f'href="#{drawing.name}-', f'href="#{name}-')
    markup = markup.replace(f"url(#{drawing.name}-", f"url(#{name}-")
    caption = nodes.Text(drawing.caption).astext()
    text = f'<figure class="drawing">{markup}<figcaption>{caption}</figcaption></figure>'
    return nodes.raw("", text, format="html")


_COMMENT = re.compile(r"<!-- drawing: (law|case) (\S+) -->\s*")

QUICK = 1
"""Pictures of a page in a quick build."""


def _draw(app: Sphinx, page: nodes.document) -> None:
    """Put the pictures of laws and cases where comments of the page name them."""
    named = [(node, _COMMENT.fullmatch(node.astext())) for node in page.findall(nodes.raw)]
    found = [(node, match) for node, match in named if match]
    for node, match in found[: QUICK if app.config.rsgen_quick else None]:
        draw = law_library.draw if match[1] == "law" else gallery.draw
        node.replace_self([drawing_node(one, f"{one.name}-{match[2]}") for one in draw(match[2])])


class _Run(SphinxDirective):
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {
        "exit": directives.nonnegative_int,
        "lines": directives.positive_int,
        "silent": directives.flag,
        "figure": directives.unchanged,
    }

    def _output(self, printed: str) -> list[nodes.Node]:
        if not printed.strip() or "silent" in self.options:
            return []
        lines = printed.rstrip().splitlines()
        most = self.options.get("lines", len(lines))
        if len(lines) > most:
            lines = [*lines[:most], "..."]
        return [_shown("\n".join(lines), "text", ("printed",))]

    def _fail(self, fault: BaseException) -> nodes.Node:
        raise self.error(f"{self.env.docname}: {type(fault).__name__}: {fault}")


class Shell(_Run):
    """Commands of rsgen, run in the folder of this build, and what they print."""

    def run(self) -> list[nodes.Node]:
        """Show the commands and what they print."""
        found: list[nodes.Node] = [_shown("\n".join(self.content), "sh")]
        if self.config.rsgen_quick:
            return found
        printed = []
        for line in self.content:
            try:
                if words := shlex.split(line, comments=True):
                    printed.append(_workspace().run(words, self.options.get("exit", 0)))
            except SnippetError as fault:
                self._fail(fault)
        return found + self._output("".join(printed))


class Program(_Run):
    """Lines of Python, run after those before on the page, what they print, and a figure."""

    def run(self) -> list[nodes.Node]:
        """Show the lines, what they print, and the figure."""
        text = "\n".join(self.content)
        found: list[nodes.Node] = [_shown(text, "python")]
        if self.config.rsgen_quick:
            return found
        try:
            found += self._output(_workspace().program(text, self.env.docname))
            if "figure" in self.options:
                drawing = _workspace().value(self.options["figure"], self.env.docname)
                found.append(drawing_node(drawing, f"figure-{self.lineno}"))
        except Exception as fault:
            self._fail(fault)
        return found


class File(SphinxDirective):
    """A file that the reader writes, and that later commands read."""

    has_content = True
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Show the file under its name, and write it."""
        text = "\n".join(self.content) + "\n"
        if not self.config.rsgen_quick:
            _workspace().write(self.arguments[0], text)
        suffix = Path(self.arguments[0]).suffix.lstrip(".")
        language = suffix if suffix in _HIGHLIGHTED else "text"
        title = nodes.caption("", "", nodes.literal("", self.arguments[0]))
        box = nodes.container("", title, _shown(text, language), literal_block=True)
        box["classes"].append("literal-block-wrapper")
        return [box]


def register(app: Sphinx) -> None:
    """Add the directives and the pictures, and remove the folder of the build after it."""
    # Sphinx shows what libraries note for their own authors
    logging.getLogger("fontTools").setLevel(logging.WARNING)
    app.add_directive("shell", Shell)
    app.add_directive("python", Program)
    app.add_directive("file", File)
    app.connect("doctree-read", _draw)
    app.connect("build-finished", _leave)
