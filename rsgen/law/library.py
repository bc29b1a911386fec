"""The library of laws that users name instead of typing: springs, dampers and what is both."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache

from rsgen.common.errors import RsgenError
from rsgen.common.text_table import TextTable
from rsgen.law.element import Law, Parameter
from rsgen.law.library_rows import ROWS

__all__ = ["Library", "laws"]


@cache
def _law(name: str) -> Law:
    row = ROWS[name]
    table = tuple(Parameter(*entry) for entry in row.parameters)
    return Law(row.formula, name, row.title, table, row.source, row.own, row.search, memory=row.memory or {})


class Library:
    """The laws by name; iterating gives the laws themselves, so that ``[law, *laws]`` is a list of laws.

    Examples
    --------
    >>> laws["coulomb"].formula
    'Ff*sign(v)'
    >>> "cubic-spring" in laws
    True
    >>> [law.name for law in laws][:3]
    ['linear-spring', 'linear-damper', 'cubic-spring']
    """

    def __getitem__(self, name: str) -> Law:
        """Give a law by name.

        Raises
        ------
        RsgenError
            There is no law of this name.
        """
        if name in self:
            return _law(name)
        near = get_close_matches(str(name)[:80], ROWS, n=3)
        hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
        raise RsgenError(f"law {name!r}: unknown; {hint}known: {', '.join(ROWS)}")

    def __contains__(self, name: object) -> bool:
        return name in ROWS

    def __iter__(self) -> Iterator[Law]:
        return map(_law, ROWS)

    def __len__(self) -> int:
        return len(ROWS)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all laws."""
        return tuple(ROWS)

    def __repr__(self) -> str:
        width = max(map(len, ROWS))
        return "\n".join(f"{law.name:<{width}}  {law.text}" for law in self)

    def _repr_html_(self) -> str:
        rows = tuple((law.name, law.title, law.text) for law in self)
        return TextTable(("law", "what it is", "force"), rows).html()


laws = Library()
"""All laws of the library."""
