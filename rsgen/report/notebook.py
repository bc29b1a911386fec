"""notebook.ipynb: the analysis of a case step by step, executed, by the public API only."""

from __future__ import annotations

import ast
import base64
import builtins
import contextlib
import io
import re
import traceback
from collections.abc import Callable, Sequence
from functools import cache, wraps
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import jinja2
import nbformat

import rsgen
from rsgen.analysis.comparison import Comparison
from rsgen.cases import Case
from rsgen.common.errors import RsgenError
from rsgen.common.output import write_atomic
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface
from rsgen.identification.prediction import Prediction
from rsgen.identification.results import Identification
from rsgen.report import figures
from rsgen.report.figures import Drawing
from rsgen.report.page_tables import NO_MODAL, Modal
from rsgen.report.provenance import notebook_mark, plain_text, template_environment

# ----------------------------------------------------------------------------
# Run the cells of a notebook in this process, given the results that the run already has.


class KnownResults:
    """Results of a run by the public call that computes them: function, inputs, result.

    A call in a cell with the same inputs gets the result; every other call is computed. Two inputs are the
    same if they are one object, or equal numbers, texts or lists of them.
    """

    def __init__(self, case: Case) -> None:
        self.case = case
        self._known: dict[str, list[tuple[tuple[object, ...], object]]] = {}

    def add(self, function: str, *inputs: object, result: object) -> None:
        """Add the result of a function of ``rsgen`` or ``rsgen.report.figures``, named without its module."""
        self._known.setdefault(function, []).append((inputs, result))

    def offered(self, module: ModuleType) -> _Offered:
        """Return a module as cells see it, with functions that look here first."""
        return _Offered(self, module)

    def named(self, module: ModuleType, name: str) -> Any:
        """Return a public name of a module; a function looks here first."""
        if module is rsgen and name == "load_case":
            return self._load_case
        if module is rsgen and name == "figures":
            return self.offered(figures)
        value = getattr(module, name)
        return self._looked_up(name, value) if name in self._known else value

    def _looked_up(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*inputs: object, **options: object) -> Any:
            for known, result in self._known[name]:
                if not options and len(known) == len(inputs) and all(map(_same, known, inputs)):
                    return result
            return function(*inputs, **options)

        return call

    def _load_case(self, path: str | Path) -> Case:
        """Return the case of the run for a file with its text."""
        text = Path(path).read_text(encoding="utf-8")
        return self.case if text.splitlines() == self.case.text.splitlines() else rsgen.load_case(path)


class _Offered:
    """A module as cells see it: its names are loaded when a cell asks for them."""

    def __init__(self, results: KnownResults, module: ModuleType) -> None:
        self.__all__ = list(module.__all__)
        self._source = results, module

    def __getattr__(self, name: str) -> Any:
        results, module = self._source
        if name not in self.__all__:
            raise AttributeError(f"module {module.__name__!r} has no public name {name!r}")
        return results.named(module, name)


def _same(one: object, other: object) -> bool:
    return one is other or (isinstance(one, str | float | list) and one == other)


def _namespace(results: KnownResults | None) -> dict[str, Any]:
    """Return the names that cells begin with; their ``import rsgen`` gets the known results."""
    space: dict[str, Any] = {"__name__": "__main__"}
    if results is not None:
        package = results.offered(rsgen)

        def importing(name: str, *place: Any) -> Any:
            return package if name == "rsgen" else __import__(name, *place)

        space["__builtins__"] = {**vars(builtins), "__import__": importing}
    return space


def _compiled(source: str, name: str) -> tuple[CodeType, CodeType | None]:
    """Compile a cell as plain Python: all statements but a last expression, and that expression."""
    tree = ast.parse(source)
    last = tree.body[-1] if tree.body else None
    if not isinstance(last, ast.Expr):
        return compile(tree, name, "exec"), None
    tree.body.pop()
    return compile(tree, name, "exec"), compile(ast.Expression(last.value), name, "eval")


def _shown(value: object) -> list[nbformat.NotebookNode]:
    """Return a value in words, and as HTML, LaTeX or a picture where it has them, as a kernel would show it.

    A shell that does so replaces ``__main__`` and the hooks of ``sys`` and opens the user's history, which is
    wrong in a process that works on cases.
    """
    data: dict[str, Any] = {"text/plain": repr(value)}
    metadata: dict[str, Any] = {}
    for kind, name in (("text/html", "_repr_html_"), ("text/latex", "_repr_latex_")):
        written = getattr(value, name)() if hasattr(value, name) else None
        if written is not None:
            data[kind] = written
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


def execute_cells(notebook: nbformat.NotebookNode, results: KnownResults | None = None) -> str | None:
    """Run every cell in this process; the notebook keeps what comes out.

    Parameters
    ----------
    results
        What the run already has; without it, cells compute everything.

    Returns
    -------
    str or None
        What went wrong in which cell, in a sentence; None where everything ran.
    """
    space = _namespace(results)
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


def build_notebook(
    case: Case,
    *,
    held_out: bool = False,
    loops: bool = False,
) -> nbformat.NotebookNode:
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
    metadata = {**_METADATA, "rsgen": notebook_mark(cell.source for cell in cells)}
    notebook: nbformat.NotebookNode = write.new_notebook(cells=cells, metadata=metadata)
    return notebook


def known_results(
    case: Case,
    surface: ResponseSurface | MultisineSpectra,
    identification: Identification,
    comparison: Comparison,
    prediction: Prediction,
    asked: Sequence[object],
    drawings: Sequence[Drawing],
    modal: Modal = NO_MODAL,
) -> KnownResults:
    """Collect results that the notebook of a case would compute again.

    Parameters
    ----------
    case
        As it was loaded, with its own law.
    asked
        Further inputs of the prediction: levels [N] and surface; none of a multisine.
    modal
        The modal table, or why there is none.
    """
    results = KnownResults(case)
    case = case.with_model(identification.model_given)
    fitted = (identification,) if case.truth is None else (identification, case.truth)
    inputs: dict[str, tuple[object, ...]] = {
        "surface": (surface,),
        "map": (surface,),
        "collapse": fitted,
        "resonance": (identification,),
        "loops": (surface, *fitted),
        "energy": (surface, *fitted),
        "responses": (surface, prediction),
        "held-out": (prediction,),
        "best-linear": (identification,),
        "line-misfit": (identification,),
        "predicted-record": (prediction,),
    }
    if modal.table is not None:
        results.add("modal_table", surface, case.model, result=modal.table)
        inputs["modal"] = (modal.table, identification)
    for drawing in drawings:
        if drawing.name in inputs:
            function = f"draw_{drawing.name.replace('-', '_')}"
            results.add(function, *inputs[drawing.name], result=drawing)
    results.add("simulate", case.oscillator, case.test, result=surface)
    results.add("load_surface", _SURFACE_FILE, result=surface)
    results.add("read", results.case, result=surface)
    if identification.ranking is not None:
        results.add("rank", surface, results.case.model, result=identification.ranking)
    results.add("identify", surface, case.model, result=identification)
    results.add("predict", identification, *asked, result=prediction)
    results.add("compare", identification, case.truth, case.accept, result=comparison)
    return results


def write_notebook(
    path: Path,
    case: Case,
    results: KnownResults | None = None,
    *,
    held_out: bool = False,
    loops: bool = False,
) -> None:
    """Write, execute and save the notebook; it is saved even where a cell fails.

    Parameters
    ----------
    results
        What need not be computed again; see `build_notebook` for the others.

    Raises
    ------
    RsgenError
        A cell failed; the notebook with its traceback is on disk.
    """
    notebook = build_notebook(case, held_out=held_out, loops=loops)
    fault = execute_cells(notebook, results)
    nbformat.validate(notebook)
    write: Any = nbformat.v4.writes  # has no types; ``nbformat.writes`` would validate once more
    write_atomic(path, write(notebook) + "\n")
    if fault is not None:
        raise RsgenError(f"{path.name}: {fault}; it is saved with its traceback (rsgen {rsgen.__version__})")
