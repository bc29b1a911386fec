"""Docstrings are written for readers of the source: signs that mark up text elsewhere mean themselves."""

from __future__ import annotations

import re
from collections.abc import Sequence
from inspect import signature
from typing import Any

from sphinx.application import Sphinx

_LITERAL = re.compile(r"(``.*?``|`[^`]*`)")
_SIGN = re.compile(r"(?<=\S)[*]|[*](?=\S)|[|]|(?<=\w)_(?!\w)")


def escape_signs(lines: Sequence[str]) -> list[str]:
    """Escape ``|X|``, ``k*x`` and ``numpy.str_`` outside of literals and programs."""
    found, program, block = [], False, -1
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if not line.strip():
            program = False
        elif block >= 0 and indent <= block:
            block = -1
        program = program or line.lstrip().startswith(">>>")
        if program or (block >= 0 and indent > block):
            found.append(line)
            continue
        parts = _LITERAL.split(line)
        parts[::2] = [_SIGN.sub(lambda sign: "\\" + sign[0], part) for part in parts[::2]]
        found.append("".join(parts))
        if line.rstrip().endswith("::"):
            block = indent
    return found


def _process(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = escape_signs(lines)


def _name_arguments(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, given: str | None, returned: str | None
) -> tuple[str, str | None] | None:
    """Give a class its arguments without types, which its description says in words."""
    if what != "class" or given is None:
        return None
    parts = []
    for argument in signature(thing).parameters.values():
        star = {argument.VAR_POSITIONAL: "*", argument.VAR_KEYWORD: "**"}.get(argument.kind, "")
        default = "" if argument.default is argument.empty else f"={argument.default!r}"
        parts.append(
            star + argument.name + (default if default.isprintable() and "<" not in default else "=...")
        )
    return f"({', '.join(parts)})", returned


def register(app: Sphinx) -> None:
    """Change docstrings before their sections are read, and signatures of classes."""
    app.connect("autodoc-process-docstring", _process, priority=100)
    app.connect("autodoc-process-signature", _name_arguments)
