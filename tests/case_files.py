"""Case files for tests: a small virtual test, and changes of it by the dotted path of a key."""

import copy
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Changes = dict[str, Any]
"""Values by the dotted path of their key; entries of lists count from 1."""

GONE = object()
"""In place of a value: the key is left out."""

SMALL: dict[str, Any] = {
    "schema": 1, "name": "small", "title": "Small", "system": {"mass": 1.5},
    "element": [{"name": "law", "force": "k*x + c*v"}], "truth": {"k": 5920.0, "c": 8.0},
    "test": {
        "kind": "simulated", "level": {"values": [1, 2]}, "frequency": {"start": 8, "stop": 12, "count": 21},
    },
}  # fmt: skip
CUBIC: Changes = {
    "element": [{"name": "spring", "force": "k*x + kn*x**3"}, {"name": "damper", "force": "c*v"}],
    "truth": {"k": 5920.0, "kn": 2.2e5, "c": 8.0}, "accept": {"k": 1e-2},
    "test.level": {"start": 2, "stop": 10, "count": 3}, "test.harmonics": 3, "test.accuracy": 1e-5,
}  # fmt: skip
"""Changes that make the small case nonlinear, with a verdict."""

MEASURED: Changes = {"system": GONE, "truth": GONE, "test": {"kind": "measured", "file": "a.csv"}}
"""Changes that make the small case one of a file; what it reads stands in further keys of "test"."""


@dataclass(frozen=True)
class Literal:
    """A value that stands in the file as it is."""

    text: str


def toml(value: Any) -> str:
    if isinstance(value, Literal):
        return value.text
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    # JSON and TOML agree in texts, numbers and truth values
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def changed(case: dict[str, Any], changes: Changes) -> str:
    tree = copy.deepcopy(case)
    for path, value in changes.items():
        *parents, key = path.split(".")
        place: Any = tree
        for parent in parents:
            place = place[int(parent) - 1] if isinstance(place, list) else place.setdefault(parent, {})
        if value is GONE:
            place.pop(key, None)
        else:
            place[key] = copy.deepcopy(value)
    return "".join(f"{key} = {toml(value)}\n" for key, value in tree.items())


def write_small(folder: Path, name: str = "small", changes: Changes | None = None, **more: Any) -> Path:
    """Write the small case, named as its file, with changes; ``more`` are those without a dot."""
    path = folder / f"{name}.toml"
    text = changed(SMALL, {"name": name, **(changes or {}), **more})
    path.write_text(text, encoding="utf-8")
    return path


def law(*forces: str, **truth: float | str) -> Changes:
    """Return the changes that give the small case another law, an element a force, with its values."""
    return {
        "element": [{"name": f"part{i}", "force": force} for i, force in enumerate(forces)],
        "truth": truth,
    }


def corpus(name: str) -> list[dict[str, Any]]:
    """Return the entries of a reviewed corpus; inputs of ``@@PY:`` are expressions: repetitions and joins."""
    entries = json.loads(Path(__file__).with_name("corpus").joinpath(name).read_text(encoding="utf-8"))
    for entry in entries:
        text = entry.get("input", "")
        if text.startswith("@@PY:"):
            entry["input"] = eval(text.removeprefix("@@PY:"), {"__builtins__": {"range": range}})
    return list(entries)
