"""Levels that stand side by side: columns "x@1N", "x@2N", or variables "phase_1N", "phase_2N"."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from rsgen.files.address import natural_order
from rsgen.files.column_titles import split_title, unit_in
from rsgen.files.tree import Entry

__all__ = ["level_in", "levels_in_columns", "without_level"]

_LEVEL = re.compile(
    r"(?:(?<![A-Za-z])(?:F|force|level|Kraft|Stufe)\s?[=: ]\s?)?"
    r"(?<![\d.,])(\d{1,9}(?:[.,]\d{1,9})?)[\s_]?([munk]?N|lbf)(?![A-Za-z])"
)
"""The amount of a force in a name. A number without one may as well be that of a sensor."""


def level_in(text: str) -> str:
    """Give the amount of a force in a text as a case writes it, "" where there is none.

    Examples
    --------
    >>> level_in("receptance, 2,5 N, up"), level_in("BEAM 2 +Z")
    ('2.5 N', '')
    """
    found = _LEVEL.search(text)
    return f"{found[1].replace(',', '.')} {found[2]}" if found else ""


def without_level(text: str) -> str:
    """Take the amount of a force out of a text.

    Examples
    --------
    >>> without_level("receptance, 2 N, up, measured")
    'receptance, up, measured'
    """
    return _LEVEL.sub("", text).replace(", ,", ",").strip(" ,_-")


def levels_in_columns(entries: Sequence[Entry], *, tree: bool = False) -> tuple[list[Entry], list[str]]:
    """Put columns that differ in the amount of a force alone under one address with a *.

    Parameters
    ----------
    entries
        Of a file.
    tree
        Whether its reader sorts what a * means, as of all formats but text, whose columns keep their order.

    Returns
    -------
    The entries, of each family the first under the address of all; and the levels in their order, as a case
    writes them; none where there are no such columns.

    Examples
    --------
    >>> columns = [Entry("f"), Entry("x@1N [mm]"), Entry("x@2,5N [mm]")]
    >>> found, levels = levels_in_columns(columns)
    >>> [entry.path for entry in found], found[1].unit, levels
    (['f', 'x@*N [mm]'], 'mm', ['1 N', '2.5 N'])
    """
    families: dict[str, list[tuple[str, Entry]]] = defaultdict(list)
    for entry in entries:
        found = _LEVEL.search(entry.path)
        # a column that goes by its number has no name for a * to stand in; a sheet has
        if not found or "*" in entry.path:
            continue
        if found.end() <= entry.path.rfind("/") or entry.title in ("", entry.path):
            address = f"{entry.path[: found.start(1)]}*{entry.path[found.end(1) :]}"
            families[address].append((level_in(found[0]), entry))
    by_levels: dict[tuple[str, ...], dict[str, Entry]] = defaultdict(dict)
    for address, members in families.items():
        if tree:
            members.sort(key=lambda member: natural_order(member[1].path))
        levels = tuple(level for level, _ in members)
        if len(set(levels)) == len(levels) > 1:
            by_levels[levels][address] = members[0][1]
    if not by_levels:
        return list(entries), []
    levels = max(by_levels, key=lambda found: (len(by_levels[found]), len(found)))
    together = by_levels[levels]
    first = {entry.path: _joined(address, entry) for address, entry in together.items()}
    members_of = {entry.path for address in together for _, entry in families[address]}
    kept = [first.get(e.path, e) for e in entries if e.path in first or e.path not in members_of]
    return kept, list(levels)


def _joined(address: str, first: Entry) -> Entry:
    """Put a family under one address; its name and its unit are those without the level."""
    if first.title not in ("", first.path):
        return replace(first, path=address)
    name, unit = split_title(_LEVEL.sub("", first.path))
    name = name.strip(" _@-,") or first.path
    if not unit and first.unit != unit_in(first.path):
        unit = first.unit
    return replace(first, path=address, title=f"{name} [{unit}]" if unit else name, unit=unit)
