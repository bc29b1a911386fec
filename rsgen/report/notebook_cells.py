"""Run the cells of a notebook in this process, given the results that the run already has."""

from __future__ import annotations

import ast
import base64
import builtins
import contextlib
import io
import traceback
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import nbformat

import rsgen
from rsgen.cases import Case
from rsgen.report import figures
from rsgen.report.environment import plain_text

__all__ = ["KnownResults", "execute_cells"]

_MOST_CHARACTERS = 300
"""Longest message of a failed cell; the traceback in the notebook has all of it."""


class KnownResults:
    """What a run has computed, by the public call that computes it: function, inputs, result.

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
        """Give a module as cells see it, with functions that look here first."""
        return _Offered(self, module)

    def named(self, module: ModuleType, name: str) -> Any:
        """Give a public name of a module; a function looks here first."""
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
        """Give the case of the run for a file with its text."""
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
    """Give the names that cells begin with; their ``import rsgen`` gets the known results."""
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
    """Give a value in words, and as HTML, LaTeX or a picture where it has them, as a kernel would show it.

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
    """Run a cell; give its outputs, and what went wrong."""
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
            return f"cell {cell.id}: {plain_text(fault, _MOST_CHARACTERS)}"
    return None
