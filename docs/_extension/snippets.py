"""The commands, programs and files that pages show, found in their text and run in a folder of their own."""

from __future__ import annotations

import contextlib
import io
import logging
import re
import shlex
import signal
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsgen.app.cli import main

ROOT = Path(__file__).parents[2]

_FENCE = re.compile(
    r"^(?P<mark>`{3,}|:{3,})(?P<head>[^\n]*)\n(?P<body>.*?)^(?P=mark)$", re.MULTILINE | re.DOTALL
)
_OPTION = re.compile(r":(\w+):[ ]*(.*)")


class SnippetError(Exception):
    """A snippet that does not do what its page says."""


@dataclass(frozen=True)
class Snippet:
    """One block of a page: its kind, what stands behind the kind, its options, its text, and its line."""

    kind: str
    argument: str
    options: dict[str, str]
    text: str
    line: int

    @property
    def commands(self) -> list[list[str]]:
        """The words of each line, without comments and empty lines."""
        words = (shlex.split(line, comments=True) for line in self.text.splitlines())
        return [line for line in words if line]


def find_snippets(text: str) -> list[Snippet]:
    """Find every block of a page, plain ones and directives."""
    found = []
    for fence in _FENCE.finditer(text):
        kind, _, argument = fence["head"].strip().partition(" ")
        lines = fence["body"].splitlines()
        options = {}
        while kind.startswith("{") and lines and (option := _OPTION.fullmatch(lines[0])):
            options[option[1]] = option[2]
            del lines[0]
        line = text.count("\n", 0, fence.start()) + 1
        found.append(Snippet(kind, argument.strip(), options, "\n".join(lines) + "\n", line))
    return found


class Workspace:
    """A folder with nothing but the examples, in which the snippets of pages run in this process.

    What a page has run is not run again for another page: equal commands leave equal files. Programs of one
    page share their names, as in a notebook.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._printed: dict[tuple[str, ...], str] = {}
        self._names: dict[str, dict[str, Any]] = {}
        self.run(["rsgen", "examples", "."])

    def run(self, words: list[str], exit_code: int = 0) -> str:
        """Run a command of rsgen; give what it printed."""
        if words[0] != "rsgen":
            raise SnippetError(f"{shlex.join(words)}: only commands of rsgen can be run here")
        key = (*words, str(exit_code))
        if key not in self._printed:
            self._printed[key] = self._run(words, exit_code)
        return self._printed[key]

    def _run(self, words: list[str], exit_code: int) -> str:
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        out, err = io.StringIO(), io.StringIO()
        code: object = None
        try:
            with (
                contextlib.chdir(self.folder),
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
            ):
                main(words[1:])
        except SystemExit as end:
            code = end.code
        finally:
            logging.captureWarnings(False)
            for number, handler in handlers.items():
                signal.signal(number, handler)
        if code != exit_code:
            raise SnippetError(f"{shlex.join(words)}: exit code {code}\n{out.getvalue()}{err.getvalue()}")
        return out.getvalue() + (err.getvalue() if exit_code else "")

    def write(self, name: str, text: str) -> None:
        """Write a file that a page shows."""
        (self.folder / name).write_text(text, encoding="utf-8")

    def program(self, text: str, page: str) -> str:
        """Run lines of Python after the ones before on this page; give what they printed.

        A warning is a fault of the example as well.
        """
        names = self._names.setdefault(page, {"__name__": "__main__"})
        out = io.StringIO()
        with self._inside(), contextlib.redirect_stdout(out):
            exec(compile(text, f"<{page}>", "exec"), names)  # noqa: S102 - the pages are our own
        return out.getvalue()

    def value(self, expression: str, page: str) -> Any:
        """Evaluate an expression with the names of a page, such as a figure that is to be shown."""
        with self._inside():
            return eval(expression, self._names[page])  # noqa: S307 - the pages are our own

    @contextlib.contextmanager
    def _inside(self) -> Iterator[None]:
        with contextlib.chdir(self.folder), warnings.catch_warnings():
            warnings.simplefilter("error")
            yield

    def perform(self, snippet: Snippet, page: str) -> str:
        """Do what a snippet says; give what it printed. Blocks that are only looked at print nothing."""
        if snippet.kind in ("{shell}", "sh"):
            code = int(snippet.options.get("exit", 0))
            return "".join(
                self.run(words, code)
                for words in snippet.commands
                if snippet.kind == "{shell}" or words[0] == "rsgen"
            )
        if snippet.kind in ("{python}", "python"):
            printed = self.program(snippet.text, page)
            if "figure" in snippet.options:
                self.value(snippet.options["figure"], page)
            return printed
        if snippet.kind == "{file}":
            self.write(snippet.argument, snippet.text)
        return ""
