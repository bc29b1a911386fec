"""What all tables of pins share: numbers of a result as a tree, where two trees differ, how pins are kept.

A tree is a nested dict of numbers, texts and lists: null for what is not finite, a pair for a complex number,
for an array some entries and their root mean square (``trees.series``). A module has a table ``PINS`` of
``id -> Pin`` and a file of the same name with the numbers; ``python -m tests.pins.MODULE --renew "reason" id
...`` computes these ids anew and writes the reason with each.
"""

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import hypot, isfinite
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
            return json.loads(json.dumps(_rounded(self.compute()), allow_nan=False))
        except rsgen.RsgenError as error:
            return {"refused": type(error).__name__}


def _rounded(tree: Tree) -> Tree:
    """Keep what JSON has: null for what is not finite, pairs for complex numbers."""
    if isinstance(tree, Mapping):
        return {str(key): _rounded(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_rounded(value) for value in tree]
    if hasattr(tree, "item"):
        tree = tree.item()
    if isinstance(tree, complex):
        return [_rounded(tree.real), _rounded(tree.imag)]
    if isinstance(tree, float):
        return float(f"{tree:.{DIGITS - 1}e}") if isfinite(tree) else None
    if tree is None or isinstance(tree, bool | int | str):
        return tree
    raise TypeError(f"a pin holds numbers and texts, no {type(tree).__name__}")


def changes(old: Tree, new: Tree, allowed: Allowed = SMOOTH, path: str = "") -> list[str]:
    """Return every place where two trees differ by more than is allowed, with old and new number."""
    if isinstance(old, dict) and isinstance(new, dict):
        found = [
            said
            for key in sorted(set(old) ^ set(new))
            for said in _moved(f"{path}/{key}", old.get(key, "nothing"), new.get(key, "nothing"))
        ]
        for key in (key for key in old if key in new):
            inner = f"{path}/{key}"
            if key == "at" and "rms" in old:
                room = (allowed.error if path.endswith("_error") else allowed.value) * _scale(old)
                for index, entry in old[key].items():
                    found += _moved(f"{inner}/{index}", entry, new[key].get(index), room)
            elif _is_number(old[key]):
                found += _moved(inner, old[key], new[key], _room(old, key, allowed))
            else:
                found += changes(old[key], new[key], allowed, inner)
        return found
    if _is_number(old) or not (isinstance(old, list) and isinstance(new, list)):
        return _moved(path, old, new, allowed.value * _size(old) if _is_number(old) else 0.0)
    if all(isinstance(one, str) for one in (*old, *new)):
        gone, come = sorted(set(old) - set(new)), sorted(set(new) - set(old))
        found = [f"{path}: {name} -> nothing" for name in gone] + [
            f"{path}: nothing -> {name}" for name in come
        ]
        return found or _moved(path, old, new)
    if len(old) != len(new):
        return [f"{path}: {len(old)} entries -> {len(new)} entries"]
    return [
        said
        for i, (one, other) in enumerate(zip(old, new, strict=True))
        for said in changes(one, other, allowed, f"{path}[{i}]")
    ]


def _is_number(tree: Tree) -> bool:
    """True of a real or complex number; counts are compared exactly, as texts are."""
    pair = isinstance(tree, list) and len(tree) == 2 and all(isinstance(part, float) for part in tree)
    return pair or isinstance(tree, float)


def _size(number: Tree) -> float:
    return hypot(*number) if isinstance(number, list) else abs(number)


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
        return max(allowed.error * size, ROUND_OFF * _size(siblings.get("value") or 0.0))
    if key == "bic":
        # twice a logarithm of likelihood: one is little, whatever the others are
        return allowed.error * max(size, 1.0)
    error = siblings.get("standard_error") or 0.0
    if key in ("lower", "upper"):
        return max(allowed.value * size, _ENDS * allowed.error * error)
    return max(allowed.value * size, allowed.of_standard_error * error)


def _moved(path: str, old: Tree, new: Tree, room: float = 0.0) -> list[str]:
    said = [f"{path}: {old} -> {new}"]
    if not (_is_number(old) and _is_number(new)) or isinstance(old, list) != isinstance(new, list):
        return said if old != new or type(old) is not type(new) else []
    apart = hypot(old[0] - new[0], old[1] - new[1]) if isinstance(old, list) else abs(new - old)
    # the last digit that is kept may turn
    apart -= 10.0 ** (1 - DIGITS) * _size(old)
    return said if apart > max(room, SMALLEST) else []


def is_empty(tree: Tree) -> bool:
    """True of a tree without any number, text or truth: a pin of nothing would never fail."""
    if isinstance(tree, dict):
        return all(is_empty(value) for key, value in tree.items() if key != "renewed")
    if isinstance(tree, list):
        return all(map(is_empty, tree))
    return tree is None


def read(file: Path) -> dict[str, Tree]:
    return dict(json.loads(file.read_text(encoding="utf-8")))


def numbers_file(module: str) -> Path:
    return Path(module).with_suffix(".json")


def renew(pins: Mapping[str, Pin], module: str, about: str | None) -> None:
    """Compute pins anew and write why; pins that are new need no reason beside them."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--renew", metavar="REASON", required=True, help="why these numbers may change")
    parser.add_argument("ids", nargs="+", choices=tuple(pins), metavar="id")
    arguments = parser.parse_args()
    file = numbers_file(module)
    known = read(file) if file.exists() else {}
    for key in arguments.ids:
        reason = {"renewed": arguments.renew} if key in known else {}
        known[key] = {**pins[key].numbers(), **reason}
    lines = [
        f"{json.dumps(key)}: {json.dumps(known[key], allow_nan=False, separators=(',', ':'))}"
        for key in pins
        if key in known
    ]
    file.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
