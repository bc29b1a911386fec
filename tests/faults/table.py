"""The table of faults: small errors that a refactoring might make, each with the test that sees it.

A fault names a function, ``rsgen.module:Qualified.name``, and a text in it that another replaces. Templates
of kernels are no functions: there the name of the file stands alone, and the text is one of the whole file.
"""

import ast
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
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


def find_place(fault: Fault, root: Path) -> Place:
    """Where the function of a fault is in a checkout: in its module, or a template."""
    module, _, name = fault.function.partition(":")
    file, found = Path(*module.split(".")).with_suffix(".py"), list[Place]()
    if not name:
        for path in (root / "rsgen").rglob(module):
            text = path.read_text(encoding="utf-8")
            found.append(Place(path.relative_to(root), text, 0, len(text)))
    elif (root / file).is_file():
        text, tree = _parsed(root / file)
        ends = [0, *accumulate(map(len, text.splitlines(keepends=True)))]
        nodes = (node for one, node in _definitions(tree) if one == name)
        found += [Place(file, text, ends[node.lineno - 1], ends[node.end_lineno]) for node in nodes]
    if len(found) != 1:
        raise FaultError(f"{fault.name}: {len(found)} places are {fault.function}; one is needed")
    return found[0]


def is_there(test: str, root: Path) -> bool:
    """Whether the file of a test id and its function are there."""
    file, _, name = test.partition("::")
    found = _definitions(_parsed(root / file)[1]) if (root / file).is_file() else ()
    return name.partition("[")[0].replace("::", ".") in {one for one, _ in found}
