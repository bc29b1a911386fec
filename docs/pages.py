"""The parts of pages that are made from rsgen: ``python -m docs.pages`` writes them anew.

Such a part stands between two comments, which no reader sees: the first names what makes it. Pages are
files with their content, so that they read on the web site of a repository as in a browser.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import rsgen
from rsgen.app.cli.application import COMMANDS
from rsgen.cases.case import case_schema
from rsgen.report.figures import draw_derivation
from rsgen.report.figures.drawing import new_figure, project_style

from ._extension.case_keys import keys_table
from ._extension.findings import findings_list
from ._extension.gallery import NAMES, gallery_sections, results
from ._extension.law_library import law_sections
from ._extension.snippets import ROOT, Workspace, find_snippets

HERE = Path(__file__).parent
_MADE = re.compile(r"(<!-- made: (?P<maker>[^\n]*) -->\n).*?\n?(<!-- end -->)", re.DOTALL)


def _commands() -> str:
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, COLUMNS="80"):
        workspace = Workspace(Path(folder))
        texts = {name: workspace.run(["rsgen", name, "--help"]) for name in COMMANDS}
        first = workspace.run(["rsgen", "--help"])
    parts = [f"```text\n{first.rstrip()}\n```"]
    parts += [f"## {name}\n\n```text\n{text.rstrip()}\n```" for name, text in texts.items()]
    return "\n\n".join(parts)


def _contents() -> str:
    """List the pages under their headings, from the hidden tables of contents of the first page."""
    lines = []
    for snippet in find_snippets((HERE / "index.md").read_text(encoding="utf-8")):
        if snippet.kind == "{toctree}":
            lines.append(f"* {snippet.options['caption']}")
            for name in snippet.text.split():
                title = (HERE / f"{name}.md").read_text(encoding="utf-8").partition("\n")[0]
                lines.append(f"  * [{title.removeprefix('# ')}]({name}.md)")
    return "\n".join(lines)


def _case_from(path: str, first: str) -> str:
    """Show a case file from one of its lines on."""
    text = (ROOT / path).read_text(encoding="utf-8")
    return f"```toml\n{text[text.index(first) :].rstrip()}\n```"


def _report_part(*words: str) -> str:
    """Show a part of a report one level deeper: its file, the text before and, if any, behind it."""
    name, begin, *end = " ".join(words).split(" | ", 2)
    text = (ROOT / "reports" / name).read_text(encoding="utf-8").partition(begin)[2]
    return re.sub(r"^(?=#+ )", "#", text.partition(end[0])[0] if end else text, flags=re.MULTILINE).strip()


MAKERS: dict[str, Callable[..., str]] = {
    "keys": keys_table,
    "case": _case_from,
    "commands": _commands,
    "contents": _contents,
    "findings": findings_list,
    "laws": law_sections,
    "gallery": gallery_sections,
    "report": _report_part,
}


def renewed(text: str) -> str:
    """Return a page with all its parts made anew."""

    def make(found: re.Match[str]) -> str:
        name, *arguments = found["maker"].split()
        return f"{found[1]}\n{MAKERS[name](*arguments)}\n\n{found[3]}"

    return _MADE.sub(make, text)


def pages() -> list[Path]:
    """Return the pages that have such parts."""
    return [
        path
        for path in sorted(HERE.glob("[!_]*/*.md")) + sorted(HERE.glob("*.md"))
        if _MADE.search(path.read_text(encoding="utf-8"))
    ]


def _draw_sheet(name: str, titles: list[str], columns: int, draw: Callable[..., object]) -> None:
    """Draw one small panel a title into a picture of the page."""
    with project_style():
        rows = -(-len(titles) // columns)
        figure = new_figure(10, 1.6 * rows + 0.4)
        axes = list(figure.subplots(rows, columns).flat)
        for title, panel in zip(titles, axes, strict=False):
            draw(title, ax=panel)
            panel.set_title(title, fontsize=8)
            panel.set(xlabel="", ylabel="")
            panel.tick_params(labelbottom=False, labelleft=False)
            for box in filter(None, [panel.get_legend()]):
                box.remove()
        for other in set(figure.axes) - set(axes[: len(titles)]):
            other.remove()
        figure.tight_layout(w_pad=1.5)
        figure.savefig(HERE / name, dpi=72, metadata={"Software": None})


def main() -> None:
    """Write every page anew, the JSON Schema of the cases, and the pictures of laws and gallery."""
    for path in pages():
        path.write_text(renewed(path.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")
    schema = json.dumps(case_schema(), indent=2)
    (ROOT / "cases" / "case.schema.json").write_text(f"{schema}\n", encoding="utf-8", newline="\n")
    laws = rsgen.laws
    _draw_sheet(
        "laws.png",
        list(laws.names),
        6,
        lambda name, ax: draw_derivation(rsgen.derive(laws[name]), laws[name].example, ax=ax),
    )
    _draw_sheet(
        "gallery.png", NAMES, 4, lambda name, ax: rsgen.figures.draw_collapse(results(name)[2], ax=ax)
    )


if __name__ == "__main__":
    main()
