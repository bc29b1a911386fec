"""What all tables of pins share: numbers of a result as a tree, where two trees differ, how pins are kept.

A tree is a nested dict of numbers, texts and lists: null for what is not finite, a pair for a complex number,
for an array some entries and their root mean square (``trees.series``). A module has a table ``PINS`` of
``id -> Pin`` and a file of the same name with the numbers.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

import rsgen

Tree = Any


@dataclass(frozen=True)
class Allowed:
    """How far numbers may move until a pin fails: largest changes."""

    # relative, of a number; of an entry of an array relative to the root mean square there
    value: float
    of_standard_error: float  # or in standard errors, whichever is more
    error: float  # relative, of a standard error, and of what a fit leaves
    # of what a fit leaves, relative to force and response, where nothing is left but round-off and the last
    # step of the fit
    left: float


SMOOTH = Allowed(value=1e-9, of_standard_error=1e-6, error=1e-5, left=1e-9)
"""Of methods whose every step is smooth. Sums in another order move a parameter in proportion to its standard
error: with the rows of every surface in another order nothing moved by more than 3 % of what is allowed."""

ACCURACY = 1e-7
"""To which motions of laws with switches are simulated for these pins."""

SWITCHED = Allowed(value=2 * ACCURACY, of_standard_error=1e-3, error=1e-3, left=10 * ACCURACY)
"""Of friction, gaps and joints. The instants of their switches are located only as well as the simulator is
asked to: two simulators that both keep to the accuracy differ by twice as much. At one per cent of noise a
change of all N points at once moves a value by sqrt(N) 2e-5, a few ten-thousandths, of its standard error."""

LEFT = frozenset({"noise", "residual", "misfit", "unexplained", "held_out_error", "error", "largest_error"})
"""Names of numbers that say what is left of force and response: a relative change of them is one of noise."""

DIGITS = 11
"""Significant digits that are kept: a hundredth of the smallest change that is looked for."""

ROUND_OFF = 1e-12
"""Standard errors below this share of their value, as exact tests leave them, are round-off."""

SMALLEST = 1e-14
"""Any change [SI] below this is round-off: the smallest numbers of the tests are receptances of 1e-5 m/N."""

_ENDS = 4.0
"""Ends of an interval are two to four standard errors away, and move as often with a change of them."""


@dataclass(frozen=True)
class Pin:
    """One result that is pinned: how it is computed, how far it may move, whether that takes long."""

    compute: Callable[[], Tree]
    allowed: Allowed = SMOOTH
    slow: bool = False
    thorough: bool = False
    data: str = ""
    """Folder of measured data that it needs."""

    def numbers(self) -> Tree:
        """Compute the tree, or the kind of error with which rsgen refuses the task."""
        try:
            text = json.dumps(self.compute(), default=_plain)
        except rsgen.RsgenError as error:
            return {"refused": type(error).__name__}
        rounded = lambda number: float(f"{float(number):.{DIGITS - 1}e}")  # noqa: E731
        return json.loads(text, parse_float=rounded, parse_constant=lambda name: None)


def _plain(value: Any) -> Tree:
    """Return what JSON has in place of a complex number, a mapping or a scalar of NumPy."""
    if isinstance(value, complex):
        return [value.real, value.imag]
    return dict(value) if isinstance(value, Mapping) else value.item()


def leaves(
    tree: Tree, allowed: Allowed = SMOOTH, path: str = "", room: float = 0.0
) -> Iterator[tuple[str, Tree, float]]:
    """Yield every number, text and list of texts with its path, and how far it may move."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            if key == "at" and "rms" in tree:
                room = (allowed.error if path.endswith("_error") else allowed.value) * _scale(tree)
                yield from ((f"{path}/at/{index}", entry, room) for index, entry in value.items())
            else:
                yield from leaves(value, allowed, f"{path}/{key}", _room(tree, key, allowed))
    elif isinstance(tree, list) and not _is_number(tree) and not _are_texts(tree):
        for i, value in enumerate(tree):
            yield from leaves(value, allowed, f"{path}[{i}]", allowed.value * _size(value))
    else:
        yield path, tree, room


def changes(old: Tree, new: Tree, allowed: Allowed = SMOOTH) -> list[str]:
    """Return every place where two trees differ by more than is allowed, with old and new number."""
    before = {path: (leaf, room) for path, leaf, room in leaves(old, allowed)}
    after = {path: leaf for path, leaf, _ in leaves(new, allowed)}
    found = []
    for path in dict.fromkeys((*before, *after)):
        leaf, room = before.get(path, ("nothing", 0.0))
        found += _moved(path, leaf, after.get(path, "nothing"), room)
    return found


def _is_number(tree: Tree) -> bool:
    """True of a real or complex number; counts are compared exactly, as texts are."""
    pair = isinstance(tree, list) and len(tree) == 2 and all(isinstance(part, float) for part in tree)
    return pair or isinstance(tree, float)


def _are_texts(tree: Tree) -> bool:
    return isinstance(tree, list) and all(isinstance(one, str) for one in tree)


def _size(tree: Tree) -> float:
    if not _is_number(tree):
        return 0.0
    return hypot(*tree) if isinstance(tree, list) else abs(tree)


def _scale(summary: dict[str, Tree]) -> float:
    return float(summary.get("scale", summary["rms"]) or 0.0)


def _room(siblings: dict[str, Tree], key: str, allowed: Allowed) -> float:
    """How far the number of this name may move, among the numbers beside it."""
    size = _size(siblings[key])
    if "rms" in siblings:
        return allowed.value * max(size, _scale(siblings))
    if key in LEFT:
        return max(allowed.error * size, allowed.left)
    if key == "standard_error":
        return max(allowed.error * size, ROUND_OFF * _size(siblings.get("value")))
    if key == "bic":
        # twice a logarithm of likelihood: one is little, whatever the others are
        return allowed.error * max(size, 1.0)
    error = siblings.get("standard_error") or 0.0
    if key in ("lower", "upper"):
        return max(allowed.value * size, _ENDS * allowed.error * error)
    return max(allowed.value * size, allowed.of_standard_error * error)


def _moved(path: str, old: Tree, new: Tree, room: float) -> list[str]:
    said = [f"{path}: {old} -> {new}"]
    if _are_texts(old) and _are_texts(new):
        gone = [f"{path}: {name} -> nothing" for name in old if name not in new]
        come = [f"{path}: nothing -> {name}" for name in new if name not in old]
        return gone + come or said * (old != new)
    if not (_is_number(old) and _is_number(new)) or isinstance(old, list) != isinstance(new, list):
        return said if old != new or type(old) is not type(new) else []
    apart = hypot(old[0] - new[0], old[1] - new[1]) if isinstance(old, list) else abs(new - old)
    # the last digit that is kept may turn
    apart -= 10.0 ** (1 - DIGITS) * _size(old)
    return said if apart > max(room, SMALLEST) else []


def stored(table: str) -> dict[str, Tree]:
    """Read the numbers of a table."""
    return dict(json.loads(Path(__file__).with_name(f"{table}.json").read_text(encoding="utf-8")))
