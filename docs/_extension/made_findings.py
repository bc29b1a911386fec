"""Where the source makes each finding, with which severities, and by which thresholds it decides.

A threshold is a number with a name in capitals in what decides: the conditions around the finding and before
it in the same function, its severity, what local names there were assigned, and functions of the same module
that are asked. The reason of a threshold is the text below it. Other functions may keep or drop what was
made: those that decide by what the function returns.
"""

from __future__ import annotations

import ast
import importlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import rsgen

PACKAGE = Path(rsgen.__file__).parent
SEVERITIES = ("info", "warning", "doubt", "error")

_SCOPES = (ast.FunctionDef, ast.ClassDef)


@dataclass(frozen=True)
class Threshold:
    """A number that decides, and why it is that number."""

    name: str
    value: Any
    reason: str
    grades: bool
    """Whether it decides the severity, and not only that the finding is made, or what it says."""


@dataclass(frozen=True)
class Place:
    """A function that makes a finding."""

    where: str
    severities: tuple[str, ...]
    thresholds: tuple[Threshold, ...]


@cache
def places_of_findings() -> dict[str, list[Place]]:
    """Every code with the places that make it, by module."""
    found = defaultdict[str, list[Place]](list)
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.stem != "sentences" and "inding(" in text:
            module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
            for code, place in Source(module, ast.parse(text)).places():
                if place not in found[code]:
                    found[code].append(place)
    return dict(found)


def is_finding(node: ast.AST) -> bool:
    """Whether a call makes a finding, itself or by a function that is named after it."""
    if not isinstance(node, ast.Call):
        return False
    called = node.func
    name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
    return "finding" in name.lower()


def texts_of(tree: ast.AST) -> list[str]:
    """Texts that stand in a piece of source."""
    parts = (part.value for part in ast.walk(tree) if isinstance(part, ast.Constant))
    return [part for part in parts if isinstance(part, str)]


class Source:
    """The tree of a module, with the parent of each node and its functions by name."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self.module, self.tree = module, tree
        self.nodes = list(ast.walk(tree))
        self.parent = {child: node for node in self.nodes for child in ast.iter_child_nodes(node)}
        self.functions = {node.name: node for node in self.nodes if isinstance(node, ast.FunctionDef)}
        self._assigned: dict[ast.AST, dict[str, list[ast.expr]]] = {}

    def places(self) -> Iterator[tuple[str, Place]]:
        """Codes of the calls that make findings, each with its place."""
        for node in self.nodes:
            if isinstance(node, ast.Call) and is_finding(node) and node.args:
                codes = [text for text in texts_of(node.args[0]) if text not in SEVERITIES]
                scopes = [one for one in self.ancestors(node) if isinstance(one, _SCOPES)]
                if codes and scopes:
                    where = ".".join([self.module, *(scope.name for scope in reversed(scopes))])
                    deciding = list(self.deciding(node, scopes[0]))
                    place = Place(
                        where, self.severities(node, deciding), tuple(self.thresholds(deciding, scopes[0]))
                    )
                    yield from ((code, place) for code in codes)

    def ancestors(self, node: ast.AST) -> Iterator[ast.AST]:
        """The nodes around a node, innermost first."""
        while node in self.parent:
            node = self.parent[node]
            yield node

    def deciding(self, call: ast.Call, scope: ast.AST) -> Iterator[ast.AST]:
        """Expressions that decide whether a finding is made, and with which severity."""
        pending, seen = [*self.conditions(call, scope), *call.args[1:], *call.keywords], set[str]()
        assigned = self.assigned(scope)
        called = {ast.unparse(call.func)}
        while pending:
            expression = pending.pop()
            yield expression
            names = {node.id for node in ast.walk(expression) if isinstance(node, ast.Name)} | called
            called = set()
            for name in sorted(names - seen):
                seen.add(name)
                if name in self.functions and self.functions[name] is not scope:
                    yield self.functions[name]
                pending += assigned.get(name, ())

    def assigned(self, scope: ast.AST) -> dict[str, list[ast.expr]]:
        """Return what each name is assigned in a function."""
        if scope not in self._assigned:
            found = self._assigned[scope] = defaultdict[str, list[ast.expr]](list)
            for node in ast.walk(scope):
                if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign) and node.value is not None:
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    parts = (part for target in targets for part in ast.walk(target))
                    for name in {part.id for part in parts if isinstance(part, ast.Name)}:
                        found[name].append(node.value)
        return self._assigned[scope]

    def conditions(self, call: ast.Call, scope: ast.AST) -> Iterator[ast.expr]:
        """Conditions around a call, and those by which its function ends before it comes there."""
        inside: ast.AST = call
        for node in self.ancestors(call):
            match node:
                case ast.If(test=test) | ast.IfExp(test=test):
                    yield test
                case ast.ListComp(generators=parts) | ast.GeneratorExp(generators=parts):
                    yield from (test for part in parts for test in part.ifs)
            for block in (getattr(node, name, None) for name in ("body", "orelse")):
                if isinstance(block, list) and inside in block:
                    for earlier in block[: block.index(inside)]:
                        if isinstance(earlier, ast.If) and isinstance(
                            earlier.body[-1], ast.Return | ast.Continue | ast.Raise
                        ):
                            yield earlier.test
            if node is scope:
                return
            inside = node

    def severities(self, call: ast.Call, deciding: Iterable[ast.AST]) -> tuple[str, ...]:
        """Severities that a finding may have."""
        direct = {text for part in (*call.args[1:2], *call.keywords) for text in texts_of(part)}
        if not direct & set(SEVERITIES):
            direct = {text for part in deciding for text in texts_of(part)}
            graded = any("severity_of" in ast.unparse(part) for part in deciding)
            direct |= {"warning", "doubt", "error"} if graded else set()
        if not direct & set(SEVERITIES):
            direct = _given().get(
                next(one.name for one in self.ancestors(call) if isinstance(one, _SCOPES)), set()
            )
        return tuple(severity for severity in SEVERITIES if severity in direct)

    def thresholds(self, deciding: Iterable[ast.AST], scope: ast.AST) -> Iterator[Threshold]:
        """Numbers with a name that stand in what decides."""
        deciding = list(deciding)
        names = {name for part in deciding for name in _compared(part)}
        grading = {name for part in deciding for name in _grading(part, self.assigned(scope))}
        loaded = importlib.import_module(self.module)
        for name in sorted(names):
            value = getattr(loaded, name, None)
            if name.isupper() and isinstance(value, int | float) and not isinstance(value, bool):
                yield Threshold(name, value, _reason(self.module, name), name in grading)


@cache
def places_that_keep() -> dict[str, tuple[str, ...]]:
    """Return the functions that decide by what each function of the package returns."""
    found = defaultdict[str, dict[str, None]](dict)
    for path in sorted(PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        source = Source(module, ast.parse(path.read_text(encoding="utf-8")))
        imports = [node for node in source.nodes if isinstance(node, ast.ImportFrom)]
        homes = {one.name: str(node.module) for node in imports for one in node.names}
        for scope in source.functions.values():
            tests = [node.test for node in ast.walk(scope) if isinstance(node, ast.If | ast.IfExp)]
            names = {node.id for test in tests for node in ast.walk(test) if isinstance(node, ast.Name)}
            given = [value for name in sorted(names) for value in source.assigned(scope).get(name, ())]
            for part in (part for tree in (*tests, *given) for part in ast.walk(tree)):
                if isinstance(part, ast.Call) and isinstance(part.func, ast.Name):
                    home = homes.get(part.func.id, module)
                    found[f"{home}.{part.func.id}"][f"{module}.{scope.name}"] = None
    return {name: tuple(places) for name, places in found.items()}


_LIMITS = ("max", "min", "severity_of", "maximum", "minimum", "hypot")
"""Functions of limits: what others are called with is no threshold."""


def _called(node: ast.AST) -> str:
    return ast.unparse(node.func).split(".")[-1] if isinstance(node, ast.Call) else ""


def _compared(node: ast.AST) -> Iterator[str]:
    """Names that take part in a comparison; of a function those of its comparisons."""
    match node:
        case ast.FunctionDef() | ast.Call() if getattr(node, "name", _called(node)) not in _LIMITS:
            for part in ast.walk(node):
                if isinstance(part, ast.Compare):
                    yield from _compared(part)
        case ast.Name(id=name):
            yield name
        case _:
            for part in ast.iter_child_nodes(node):
                yield from _compared(part)


def _grading(tree: ast.AST, assigned: dict[str, list[ast.expr]]) -> Iterator[str]:
    """Names that decide a severity: limits of ``severity_of``, and conditions between severities."""
    for part in ast.walk(tree):
        match part:
            case ast.Call() if _called(part) == "severity_of":
                limits: list[ast.AST] = part.args[1:]
            case ast.IfExp(body=one, orelse=other) if {*texts_of(one), *texts_of(other)} & set(SEVERITIES):
                limits = [part.test]
            case _:
                limits = []
        names = {node.id for limit in limits for node in ast.walk(limit) if isinstance(node, ast.Name)}
        yield from names
        # limits that have a local name, as those of a case and of another
        for value in (value for name in names for value in assigned.get(name, ())):
            yield from (node.id for node in ast.walk(value) if isinstance(node, ast.Name))


@cache
def _given() -> dict[str, set[str]]:
    """Severities that the functions of the package are given by name."""
    given = defaultdict[str, set[str]](set)
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "severity=" in text else ():
            for word in node.keywords if isinstance(node, ast.Call) else ():
                given[_called(node)] |= set(texts_of(word)) if word.arg == "severity" else set()
    return given


@cache
def _tree(module: str) -> ast.Module:
    source = Path(importlib.import_module(module).__file__ or "")
    return ast.parse(source.read_text(encoding="utf-8"))


@cache
def _reason(module: str, name: str) -> str:
    """The text below a number, in the module that it stands in."""
    body = _tree(module).body
    for node, below in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.ImportFrom) and name in {one.asname or one.name for one in node.names}:
            return _reason(str(node.module), name)
        if isinstance(node, ast.Assign) and name in {ast.unparse(target) for target in node.targets}:
            return " ".join(texts_of(below)[0].split()) if isinstance(below, ast.Expr) else ""
    return ""
