"""notebook.ipynb: a lesson on the case, executed, that calls the public API only."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
import tempfile
import threading
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import nbformat
from jupyter_client.kernelspec import KernelSpec, KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
from traitlets import default
from traitlets.config import Config

import rsgen
from rsgen.case import Case
from rsgen.errors import RsgenError
from rsgen.output import write_atomic
from rsgen.report.environment import TEMPLATES, plain_text
from rsgen.simulation import SimulatedTest

__all__ = ["build_notebook", "execute_notebook", "literal", "prose", "write_notebook"]

_CELL_SECONDS = 300
_LISTEN_SECONDS = 0.2
_END_SECONDS = 10.0
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
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=False,  # noqa: S701 - no HTML: every value passes _only_safe
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=_only_safe,
    )
    environment.filters.update(literal=literal, prose=prose, lines=_lines)
    return environment


def build_notebook(
    case: Case, *, mean: bool = False, held_out: bool = False, surface_file: str = "surface.h5"
) -> nbformat.NotebookNode:
    """Write the lesson on a case, not yet executed.

    Parameters
    ----------
    mean
        Show one period of the motion: for laws that push the mean off zero.
    held_out
        Show the levels that identification has not seen.
    surface_file
        Where a measured case finds its surface: a file beside the notebook.
    """
    text = (
        _environment()
        .get_template("notebook/lesson.txt")
        .render(
            title=case.title or case.name,
            source=case.source,
            name=case.name,
            case_text=case.text,
            simulated=isinstance(case.test, SimulatedTest),
            known=case.truth is not None,
            elements=[element.name for element in case.model.elements],
            mean=mean,
            held_out=held_out,
            ranked=case.ranked,
            surface_file=surface_file,
        )
    )
    pieces = _CELL.split(text)[1:]
    write: Any = nbformat.v4  # its functions have no types
    cells = []
    for kind, name, body in zip(pieces[::3], pieces[1::3], pieces[2::3], strict=True):
        make = write.new_code_cell if kind == "code" else write.new_markdown_cell
        cells.append(make(body.strip("\n"), id=name))
    notebook: nbformat.NotebookNode = write.new_notebook(cells=cells)
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook.metadata["language_info"] = {
        "name": "python",
        "file_extension": ".py",
        "mimetype": "text/x-python",
    }
    return notebook


class _ThisPython(KernelSpecManager):
    """Kernels of the Python that runs rsgen, whatever kernels the user has installed."""

    def get_kernel_spec(self, kernel_name: str) -> KernelSpec:
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        return KernelSpec(argv=command, display_name="Python 3", language="python")


class _PrivateKernel(AsyncKernelManager):
    """A kernel of this Python; nbclient makes, ends and clears it up by itself."""

    @default("kernel_spec_manager")
    def _this_python(self) -> KernelSpecManager:
        return _ThisPython(parent=self)


def _private_sockets(folder: str) -> Config:
    """Put the kernel's sockets into a private folder: no port is opened, parallel runs cannot meet."""
    config = Config()
    config.KernelManager.connection_file = str(Path(folder, "kernel.json"))
    if os.name == "posix":
        config.KernelManager.transport = "ipc"
        config.KernelManager.ip = str(Path(folder, "s"))
    return config


def _clean(notebook: nbformat.NotebookNode) -> None:
    """Drop what changes from run to run: times and the machine's version of Python."""
    notebook.metadata.pop("widgets", None)
    notebook.metadata["language_info"] = {
        "name": "python",
        "file_extension": ".py",
        "mimetype": "text/x-python",
    }
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)


def _in_a_thread(client: NotebookClient, **kernel: Any) -> BaseException | None:
    """Execute beside the main thread, where nbclient would take Ctrl-C for itself; give what went wrong."""
    errors: list[BaseException] = []

    def work() -> None:
        try:
            asyncio.run(client.async_execute(cleanup_kc=True, **kernel))
        except BaseException as error:
            errors.append(error)

    worker = threading.Thread(target=work, name="notebook", daemon=True)
    worker.start()
    try:
        while worker.is_alive():
            worker.join(_LISTEN_SECONDS)
    except BaseException:
        process = getattr(getattr(client.km, "provisioner", None), "process", None)
        if process is not None:
            process.kill()
        worker.join(_END_SECONDS)
        raise
    return errors[0] if errors else None


def execute_notebook(notebook: nbformat.NotebookNode, folder: Path) -> str | None:
    """Run every cell in a fresh kernel of this Python; the notebook keeps what came out.

    Parameters
    ----------
    folder
        Where the kernel runs.

    Returns
    -------
    str or None
        What went wrong in which cell, in a sentence; None where everything ran.
    """
    with tempfile.TemporaryDirectory(prefix="rsgen-", ignore_cleanup_errors=True) as private:
        client = NotebookClient(
            notebook,
            kernel_manager_class=_PrivateKernel,
            config=_private_sockets(private),
            timeout=_CELL_SECONDS,
            record_timing=False,
            coalesce_streams=True,
            # it keeps nothing that would need a farewell, and Ctrl-C must not wait for one
            shutdown_kernel="immediate",
        )
        # the user's own start-up files must not take part, and figures need no window
        surroundings: dict[str, Any] = {
            **os.environ,
            "IPYTHONDIR": private,
            "MPLBACKEND": "agg",
            "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        }
        # what cells print comes through the kernel; what else it says at its end is for nobody
        error = _in_a_thread(client, cwd=str(folder), env=surroundings, stderr=subprocess.DEVNULL)
        fault: str | None = None
        if isinstance(error, CellExecutionError):
            fault = f"{error.ename}: {error.evalue}"
        elif isinstance(error, CellTimeoutError | DeadKernelError | RuntimeError):
            fault = str(error).splitlines()[0]
        elif error is not None:
            raise error
        _clean(notebook)
    if fault is None:
        return None
    place = next((cell.id for cell in notebook.cells if _failed(cell)), "?")
    return f"cell {place}: {plain_text(fault, 300)}"


def _failed(cell: nbformat.NotebookNode) -> bool:
    return cell.cell_type == "code" and any(output.output_type == "error" for output in cell.outputs)


def write_notebook(
    path: Path, case: Case, *, mean: bool = False, held_out: bool = False, surface_file: str = "surface.h5"
) -> None:
    """Write, execute and save the lesson; it is saved even where a cell fails. See `build_notebook`.

    Raises
    ------
    RsgenError
        A cell failed; the notebook with its traceback is on disk.
    """
    notebook = build_notebook(case, mean=mean, held_out=held_out, surface_file=surface_file)
    fault = execute_notebook(notebook, path.parent)
    nbformat.validate(notebook)
    write: Any = nbformat.writes  # has no types
    write_atomic(path, write(notebook, version=4) + "\n")
    if fault is not None:
        raise RsgenError(f"{path.name}: {fault}; it is saved with its traceback (rsgen {rsgen.__version__})")
