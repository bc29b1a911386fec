"""The table of faults: small errors that a refactoring might make, each with the test that sees it.

A fault names a function, ``rsgen.module:Qualified.name``, and a text in it that another replaces. Templates
of kernels are no functions: there the name of the file stands alone, and the text is one of the whole file.
"""

import ast
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

FAULTS = Path(__file__).with_name("faults.toml")

GROUPS = (
    "describing functions", "kernels", "balances", "least squares", "histories", "readers", "law and units",
    "prediction and modal",
)  # fmt: skip


class FaultError(Exception):
    """The table has gone stale: a function or a text in it is not there."""


@dataclass(frozen=True, slots=True)
class Fault:
    name: str  # short, for the report
    group: str  # one of ``GROUPS``
    function: str  # where: module and qualified name, or the name of a template
    old: str  # a text that occurs once there,
    new: str  # and what replaces it
    means: str  # what goes wrong physically
    caught: tuple[str, ...]  # tests that fail with the fault, the quickest first; three at most


@dataclass(frozen=True, slots=True)
class Place:
    """A file, relative to the folder of the package, and the part of its text that a function is."""

    file: Path
    text: str
    start: int
    stop: int

    def replaced(self, fault: Fault) -> str:
        part = self.text[self.start : self.stop]
        found = part.count(fault.old)
        if found != 1:
            times = f"{found} times in {fault.function}; once is needed"
            raise FaultError(f"{fault.name}: {fault.old!r} occurs {times}")
        return self.text[: self.start] + part.replace(fault.old, fault.new) + self.text[self.stop :]


def load_faults(path: Path = FAULTS) -> tuple[Fault, ...]:
    rows = tomllib.loads(path.read_text(encoding="utf-8"))["fault"]
    return tuple(Fault(**row | {"caught": tuple(row["caught"])}) for row in rows)


@lru_cache(maxsize=1024)
def _parsed(path: Path) -> tuple[str, ast.Module]:
    text = path.read_text(encoding="utf-8")
    return text, ast.parse(text)


def _definitions(tree: ast.AST, before: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Qualified name and node of every function and method."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield before + node.name, node
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield from _definitions(node, f"{before}{node.name}.")


def _places(root: Path, module: str, name: str) -> Iterator[Place]:
    """Where the functions of this qualified name are in a module; properties may have several."""
    file = Path(*module.split(".")).with_suffix(".py")
    if not (root / file).is_file():
        return
    text, tree = _parsed(root / file)
    lines = text.splitlines(keepends=True)
    for found, node in _definitions(tree):
        if found == name:
            start, stop = ("".join(lines[:end]) for end in (node.lineno - 1, node.end_lineno))
            yield Place(file, text, len(start), len(stop))


def find_place(fault: Fault, root: Path) -> Place:
    """Where the function of a fault is in a checkout: in its module, or a template."""
    module, _, name = fault.function.partition(":")
    if name:
        found = list(_places(root, module, name))
    else:
        files = {path: path.read_text(encoding="utf-8") for path in sorted((root / "rsgen").rglob(module))}
        found = [Place(path.relative_to(root), text, 0, len(text)) for path, text in files.items()]
    if len(found) != 1:
        raise FaultError(f"{fault.name}: {len(found)} places are {fault.function}; one is needed")
    return found[0]


def is_there(test: str, root: Path) -> bool:
    """Whether the file of a test id and its function are there."""
    file, _, name = test.partition("::")
    wanted = name.partition("[")[0].replace("::", ".")
    if not (root / file).is_file():
        return False
    return not wanted or any(found == wanted for found, _ in _definitions(_parsed(root / file)[1]))
