"""notebook.ipynb: the analysis of a case step by step, executed, by the public API only."""

from __future__ import annotations

import ast
import base64
import builtins
import contextlib
import io
import re
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import CodeType, MappingProxyType, ModuleType
from typing import Any

import jinja2
import nbformat

import rsgen
from rsgen.cases.case import Case
from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic
from rsgen.report.figures import Drawing
from rsgen.report.provenance import plain_text, template_environment
from rsgen.report.result_json import Parts

# ----------------------------------------------------------------------------
# Run the cells of a notebook in this process, given the results that the run already has: the cells are those
# of the template, and call each function with what the run called it with.


class _Offered:
    """A module as cells see it: public names, loaded when asked for; some calls give what the run has."""

    def __init__(self, module: ModuleType, known: Mapping[str, object]) -> None:
        self.__all__ = list(module.__all__)
        self._source = module, known

    def __getattr__(self, name: str) -> Any:
        module, known = self._source
        if name not in self.__all__:
            raise AttributeError(f"module {module.__name__!r} has no public name {name!r}")
        if name in known:
            return lambda *inputs, **options: known[name]
        value = getattr(module, name)
        return _Offered(value, known) if isinstance(value, ModuleType) else value


def _namespace(known: Mapping[str, object]) -> dict[str, Any]:
    """Return the names that cells begin with; their ``import rsgen`` gets the known results."""
    package = _Offered(rsgen, known)

    def importing(name: str, *place: Any) -> Any:
        return package if name == "rsgen" else __import__(name, *place)

    return {"__name__": "__main__", "__builtins__": {**vars(builtins), "__import__": importing}}


def _compiled(source: str, name: str) -> tuple[CodeType, CodeType | None]:
    """Compile a cell as plain Python: all statements but a last expression, and that expression."""
    tree = ast.parse(source)
    last = tree.body[-1] if tree.body else None
    if not isinstance(last, ast.Expr):
        return compile(tree, name, "exec"), None
    tree.body.pop()
    return compile(tree, name, "exec"), compile(ast.Expression(last.value), name, "eval")


def _shown(value: object) -> list[nbformat.NotebookNode]:
    """Return a value in words, and as LaTeX or a picture where it has them, as a kernel would show it.

    A shell that does so replaces ``__main__`` and the hooks of ``sys`` and opens the user's history, which is
    wrong in a process that works on cases.
    """
    data: dict[str, Any] = {"text/plain": repr(value)}
    metadata: dict[str, Any] = {}
    if hasattr(value, "_repr_latex_"):
        data["text/latex"] = value._repr_latex_()
    if hasattr(value, "_repr_mimebundle_"):
        more, metadata = value._repr_mimebundle_()
        data |= more
    for kind, content in data.items():
        if isinstance(content, bytes):
            data[kind] = base64.b64encode(content).decode("ascii")
    return [_output("execute_result", data=data, metadata=metadata)]


def _output(kind: str, **content: Any) -> nbformat.NotebookNode:
    make: Callable[..., nbformat.NotebookNode] = nbformat.v4.new_output
    return make(kind, **content)


def _run(source: str, name: str, space: dict[str, Any]) -> tuple[list[nbformat.NotebookNode], str | None]:
    """Run a cell; return its outputs, and the fault or None."""
    fault, last = None, []
    stdout, stderr = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            body, expression = _compiled(source, f"<cell {name}>")
            exec(body, space)  # noqa: S102 - the template's text; those of a case are literals in it
            value = None if expression is None else eval(expression, space)  # noqa: S307
            last = [] if value is None else _shown(value)
    except Exception as error:
        fault = f"{type(error).__name__}: {error}"
        lines = traceback.format_exception(error)
        last = [_output("error", ename=type(error).__name__, evalue=str(error), traceback=lines)]
    streams = {"stdout": stdout.getvalue(), "stderr": stderr.getvalue()}
    printed = [_output("stream", name=stream, text=text) for stream, text in streams.items() if text]
    return [*printed, *last], fault


def execute_cells(notebook: nbformat.NotebookNode, known: Mapping[str, object]) -> str | None:
    """Run every cell in this process; the notebook keeps what comes out.

    Parameters
    ----------
    known
        What the run already has, by function (`known_results`); the cells compute the others.

    Returns
    -------
    str or None
        What went wrong in which cell, in a sentence; None where everything ran.
    """
    space = _namespace(known)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    for number, cell in enumerate(cells, 1):
        cell.execution_count = number
        cell.outputs, fault = _run(cell.source, cell.id, space)
        for output in cell.outputs:
            if output.output_type == "execute_result":
                output.execution_count = number
        if fault is not None:
            return f"cell {cell.id}: {plain_text(fault)}"
    return None


_SURFACE_FILE = "surface.h5"
_METADATA = {
    "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
    "language_info": {"name": "python", "file_extension": ".py", "mimetype": "text/x-python"},
}
_CELL = re.compile(r"^--- (?P<kind>markdown|code) (?P<id>[a-z0-9-]+)\n", flags=re.MULTILINE)
# what markdown, mathematics in markdown, or HTML gives a meaning to inside a line
_MARKED = re.compile(r"[\\`*_{}\[\]<>&$~#|!@:]")


class _Safe(str):
    """Text that is ready for its place in a cell; the templates take nothing else."""

    __slots__ = ()


def literal(text: str) -> _Safe:
    r"""Write a text as a Python string literal on one line; whatever it contains, it stays a string.

    Examples
    --------
    >>> print(literal('"; import os\n!ls'))
    '"; import os\n!ls'
    """
    # whichever quotation mark needs fewer escapes, as formatters of Python have it
    mark = "'" if text.count('"') > text.count("'") else '"'
    quoted = {mark: f"\\{mark}", "\\": "\\\\", "\n": "\\n", "\t": "\\t"}
    return _Safe(
        mark
        + "".join(
            quoted.get(c) or (c if c.isprintable() else c.encode("unicode_escape").decode("ascii"))
            for c in text
        )
        + mark
    )


def prose(text: str) -> _Safe:
    """Write a text for a markdown cell; nothing in it is markup.

    Character references are text to markdown and to mathematics alike; backslashes are not.

    Examples
    --------
    >>> print(prose("[c](javascript:alert(1)) <b>"))
    &#91;c&#93;(javascript&#58;alert(1)) &#60;b&#62;
    """
    shown = plain_text(" ".join(text.splitlines()) or " ")
    return _Safe(_MARKED.sub(lambda match: f"&#{ord(match[0])};", shown))


def _lines(text: str) -> _Safe:
    """Write a text of several lines as literals, one a line."""
    parts = text.replace("\r\n", "\n").splitlines(keepends=True) or [""]
    return _Safe("\n".join(f"    {literal(part)}" for part in parts))


def _only_safe(value: object) -> object:
    if isinstance(value, _Safe | int):
        return value
    raise RsgenError(
        f"notebook template: a {type(value).__name__} goes into a cell neither as literal nor as prose"
    )


@cache
def _environment() -> jinja2.Environment:
    # no HTML: every value passes _only_safe
    environment = template_environment(False, _only_safe)
    environment.filters.update(literal=literal, prose=prose, lines=_lines)
    return environment


def build_notebook(case: Case, *, held_out: bool = False, loops: bool = False) -> nbformat.NotebookNode:
    """Build the notebook of a case, not yet executed.

    Parameters
    ----------
    held_out
        Show the levels that identification has not seen.
    loops
        Show the loops of the restoring force and the energy that they dissipate.
    """
    cells_text = _environment().get_template("notebook/cells.txt")
    text = cells_text.render(
        title=case.title or case.name,
        across=bool(case.model.sensors),
        source=case.source,
        name=case.name,
        case_text=case.text,
        simulated=case.oscillator is not None,
        multisine=case.test.many_lines,
        known=case.truth is not None,
        held_out=held_out,
        loops=loops,
        ranked=case.ranked,
        surface_file=_SURFACE_FILE,
    )
    pieces = _CELL.split(text)[1:]
    write: Any = nbformat.v4  # its functions have no types
    make = {"code": write.new_code_cell, "markdown": write.new_markdown_cell}
    cells = [
        make[kind](body.strip("\n"), id=name)
        for kind, name, body in zip(pieces[::3], pieces[1::3], pieces[2::3], strict=True)
    ]
    notebook: nbformat.NotebookNode = write.new_notebook(cells=cells, metadata=_METADATA)
    return notebook


def known_results(case: Case, parts: Parts, drawings: Sequence[Drawing]) -> dict[str, object]:
    """Return what the notebook of a case would compute again, by the function of ``rsgen`` or its figures."""
    known: dict[str, object] = {f"draw_{one.name.replace('-', '_')}": one for one in drawings}
    known |= dict.fromkeys(("simulate", "load_surface", "read"), parts.table)
    known |= {"load_case": case, "identify": parts.identification}
    known |= {"predict": parts.prediction, "compare": parts.comparison}
    if parts.identification.ranking is not None:
        known["rank"] = parts.identification.ranking
    if parts.modal.table is not None:
        known["modal_table"] = parts.modal.table
    return known


def write_notebook(
    path: Path,
    case: Case,
    known: Mapping[str, object] = MappingProxyType({}),
    *,
    held_out: bool = False,
    loops: bool = False,
) -> None:
    """Write, execute and save the notebook; it is saved even where a cell fails.

    Parameters
    ----------
    known
        What need not be computed again; see `build_notebook` for the others.

    Raises
    ------
    RsgenError
        A cell failed; the notebook with its traceback is on disk.
    """
    notebook = build_notebook(case, held_out=held_out, loops=loops)
    fault = execute_cells(notebook, known)
    write: Any = nbformat.v4.writes  # has no types; every cell and output was validated as it was made
    write_atomic(path, write(notebook) + "\n")
    if fault is not None:
        raise RsgenError(f"{path.name}: {fault} (rsgen {rsgen.__version__})")
