"""The command `rsgen laws`: the library of force laws, or one law of it."""

from __future__ import annotations

from typing import Annotated

import typer

from rsgen.app.cli.derive_command import describe
from rsgen.app.cli.terminal import print_line
from rsgen.describing.derivation import derive
from rsgen.law.element import Law, Library, laws


def laws_command(
    name: Annotated[
        str | None, typer.Argument(help="One law of the library; without it, all.", show_default=False)
    ] = None,
) -> int:
    """List the library of force laws, or show one: formula, parameters, describing function, source.

    \b
    Examples:
      rsgen laws cubic-spring
    """
    if name is None:
        _print_all(laws)
        return 0
    _print_law(laws[name])
    describe(derive(laws[name]), latex=False)
    return 0


def _print_all(laws: Library) -> None:
    width = max(len(law.name) for law in laws)
    for law in laws:
        print_line(f"{law.name:<{width}}  {law.text}")
    print_line()
    print_line('One of them: rsgen laws NAME. In a case: law = "NAME" in place of force.')


def _print_law(law: Law) -> None:
    print_line(f"{law.name}: {law.title}")
    for entry in law.table:
        unit = f" [{entry.unit}]" if entry.unit else ""
        print_line(f"{'':<9}  {entry.name}: {entry.meaning}{unit}")
    derived = "; the describing function is an own derivation" if law.own else ""
    print_line(f"{'source':<9}  {law.source}{derived}")
