"""Pins computed anew: ``python -m tests.pins --renew "reason" TABLE-ID ...``, with the ids of pytest.

The reason stands with each afterwards; pins that are new need none.
"""

import argparse
import json
from importlib import import_module
from pathlib import Path

from tests.pins.pinned import Pin, stored

NAMES = (
    "identifications", "ranking", "multisine", "controls", "histories", "joints", "observations",
    "predictions", "names",
)  # fmt: skip
TABLES: dict[str, dict[str, Pin]] = {name: import_module(f"tests.pins.{name}").PINS for name in NAMES}


def renew(table: str, ids: list[str], reason: str) -> None:
    pins, known = TABLES[table], stored(table)
    for key in ids:
        known[key] = {**pins[key].numbers(), **({"renewed": reason} if key in known else {})}
    lines = [
        f"{json.dumps(key)}: {json.dumps(known[key], allow_nan=False, separators=(',', ':'))}"
        for key in pins
        if key in known
    ]
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    Path(__file__).with_name(f"{table}.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--renew", metavar="REASON", required=True, help="why these numbers may change")
    allowed = [f"{table}-{key}" for table, pins in TABLES.items() for key in pins]
    parser.add_argument("ids", nargs="+", choices=allowed, metavar="TABLE-ID")
    arguments = parser.parse_args()
    for table in NAMES:
        ids = [one.removeprefix(f"{table}-") for one in arguments.ids if one.startswith(f"{table}-")]
        if ids:
            renew(table, ids, arguments.renew)
