"""Count the conditions that ask what kind of test or linear part there is.

Such a question is answered once, where the value is made; asked all through the code it is a seam between
programs. The syntax tree of every module is walked: each ``if``, ternary, ``while``, ``match`` and filter of
a comprehension whose condition holds a name of ``KINDS``, or compares one of ``OPTIONAL`` with None, or asks
whether "m" is in something that is ``fixed``, counts once, and so does each ``isinstance`` of a type of
``RECORDS``.

    python -m benchmarks.conditions [FOLDER]
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

KINDS = {
    "across": {"across", "acts_across", "sensors", "response_share"},
    "phase known": {"phase_known", "known_phase", "has_phase", "phases"},
    "per mass": {"per_mass", "per_unit_mass", "of_mass"},
    "mass given": {"mass_free", "free_mass", "mass_given"},
}
OPTIONAL = {"mass": "mass given", "given": "mass given", "phase": "phase known"}
RECORDS = {
    "MultisineSpectra",
    "ResponseSurface",
    "MultisineTest",
    "SimulatedTest",
    "MeasuredTest",
    "FreeDecay",
}


def name_of(node: ast.expr) -> str:
    """Return the last name of a variable or attribute, "" of anything else."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def kinds_asked(condition: ast.expr) -> set[str]:
    """Return the kinds that a condition asks for."""
    found = set()
    for node in ast.walk(condition):
        if isinstance(node, ast.Name | ast.Attribute):
            found |= {kind for kind, names in KINDS.items() if name_of(node).lstrip("_") in names}
        if isinstance(node, ast.Compare) and any(
            isinstance(side, ast.Constant) and side.value is None for side in node.comparators
        ):
            found |= {OPTIONAL[name] for name in [name_of(node.left).lstrip("_")] if name in OPTIONAL}
        if isinstance(node, ast.Compare) and name_of(node.comparators[0]).lstrip("_") == "fixed":
            found |= {"mass given"} if getattr(node.left, "value", None) == "m" else set()
        if isinstance(node, ast.Call) and name_of(node.func) == "isinstance":
            types = {name_of(part) for part in ast.walk(node.args[1]) if isinstance(part, ast.expr)}
            found |= {"type of a record"} if types & RECORDS else set()
    return found


def conditions(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield the condition of each branch of a syntax tree."""
    for node in ast.walk(tree):
        if isinstance(node, ast.If | ast.IfExp | ast.While):
            yield node.test
        elif isinstance(node, ast.comprehension):
            yield from node.ifs
        elif isinstance(node, ast.Match):
            yield node.subject


def count(folder: Path) -> Counter[tuple[str, str]]:
    """Return the conditions of each file and kind below a folder."""
    found: Counter[tuple[str, str]] = Counter()
    for path in sorted(folder.rglob("*.py")):
        for condition in conditions(ast.parse(path.read_text(encoding="utf-8"))):
            found.update((str(path.relative_to(folder)), kind) for kind in kinds_asked(condition))
    return found


def main() -> None:
    """Print the conditions by kind and by file."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "rsgen"
    found = count(folder)
    for place in (1, 0):
        sums: Counter[str] = Counter()
        for key, number in found.items():
            sums[key[place]] += number
        for name, number in sums.most_common():
            print(f"{number:4} {name}")
        print()
    print(f"{found.total():4} in all")


if __name__ == "__main__":
    main()
