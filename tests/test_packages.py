"""The shape of the package: few rooms, no circles, one idea a file."""

import ast
import importlib
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import rsgen
from tests.programs import python

ROOT = Path(rsgen.__file__).parent
LONGEST = 600
"""Lines of a file; what needs more is more than one idea."""


@cache
def modules() -> dict[str, ast.Module]:
    """Every module by its dotted name, without the files that only name what a package has."""
    return {
        ".".join(path.relative_to(ROOT.parent).with_suffix("").parts): ast.parse(path.read_text("utf-8"))
        for path in sorted(ROOT.rglob("*.py"))
        if not path.name.startswith("__")
    }


def imported(tree: ast.Module) -> set[str]:
    """Modules that one imports anywhere: in functions and for type checkers, too."""
    named = {
        name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
    }
    named |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return named & set(modules())


def test_no_modules_import_each_other_in_a_circle():
    graph = {name: imported(tree) for name, tree in modules().items()}
    assert sum(map(len, graph.values())) > 1000
    TopologicalSorter(graph).prepare()
    # a circle would be seen
    one, other = next((name, other) for name, found in graph.items() for other in found)
    with pytest.raises(CycleError):
        TopologicalSorter(graph | {other: graph[other] | {one}}).prepare()


def test_a_file_has_one_idea_and_a_name_of_its_own():
    paths = [path for path in ROOT.rglob("*.py") if not path.name.startswith("__")]
    assert {path.name: n for path in paths if (n := path.read_text("utf-8").count("\n")) > LONGEST} == {}
    assert [name for name, times in Counter(path.name for path in paths).items() if times > 1] == []


def test_every_benchmark_finds_what_it_imports():
    # `make bench` needs packages that tests have not; those are imported where they are used
    for path in sorted((ROOT.parent / "benchmarks").glob("*.py")):
        importlib.import_module(f"benchmarks.{path.stem}")


@pytest.mark.thorough
@pytest.mark.parametrize("program", [
    "accuracy --runs 2 --processes 1 cubic joint",
    "background --runs 2 --processes 1",
    "campaign --kind right --tests 2",
    "verdicts --part untampered --seeds 1 --processes 1 cubic",
    "wordings",
])  # fmt: skip
def test_a_small_part_of_a_benchmark_runs(program):
    # names that a program asks of the package only while it runs
    ran = python("-m", *f"benchmarks.{program}".split(), cwd=ROOT.parent, timeout=None)
    assert ran.returncode == 0, ran.stderr[-2000:]
    assert ran.stdout.count("\n") > 4
