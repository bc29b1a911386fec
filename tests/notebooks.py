"""Notebooks as their readers run them."""

import ast
import json
from pathlib import Path
from typing import Any


def run_cells(place: Path) -> dict[str, Any]:
    """Run the cells of a notebook in one namespace; return what each shows, by its name."""
    shown: dict[str, Any] = {}
    space: dict[str, Any] = {"__name__": "__main__"}
    for cell in json.loads(place.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, cell["id"], "exec"), space)
        if isinstance(last, ast.Expr):
            shown[cell["id"]] = eval(compile(ast.Expression(last.value), cell["id"], "eval"), space)
    return shown
