"""Attacks on the reading of texts: random and pathological force laws, each derived in a child process.

``python -m tests.attacks.expressions --count 20000 --seed 1`` prints counts. A text is a number: with the
seed it is the same on every machine, and ``--only NUMBER`` repeats it.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections import Counter
from collections.abc import Callable

import numpy as np

from rsgen.cli.derive_command import derive_command
from rsgen.errors import RsgenError
from rsgen.law.element import make_element
from rsgen.units import parameter_units
from tests.attacks.child import Outcome, attempts, measured, serve
from tests.attacks.texts import TEXTS, grown

__all__ = ["attack", "main", "run", "text_of"]

SECONDS = 5.0
"""Work allowed until a text has its answer."""
MEGABYTES = 1024.0
LONGEST = 10_000
"""Characters of a refusal, which may quote a formula of 2000 several times."""


def text_of(number: int, seed: int) -> tuple[str, str]:
    """Name and text of an attack: half grown at random, half made to be hard."""
    rng = np.random.default_rng([seed, number])
    make = grown if rng.random() < 0.5 else TEXTS[int(rng.integers(len(TEXTS)))]
    return make.__name__, make(rng)


def answer(text: str) -> str:
    """Derive a text as ``rsgen derive`` does, and find the units of its parameters."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            derive_command(text, (), None, (), None, json=False, latex=False)
            derive_command(text, (), None, (), None, json=True, latex=False)
            parameter_units(make_element("law", text).force)
        except RsgenError as fault:
            sentence = str(fault)
            plain = len(sentence) < LONGEST and sentence.replace("\n", " ").isprintable()
            return (
                f"refused: {sentence}"
                if plain
                else f"crash: a refusal that is no sentence: {sentence[:80]!r}"
            )
    return "result"


def attack(number: int, seed: int) -> Outcome:
    """Derive the text of an attack."""
    name, text = text_of(number, seed)
    outcome = measured(number, name, lambda: answer(text))
    if outcome.seconds > SECONDS:
        return Outcome(number, name, f"hang: {outcome.seconds} s", outcome.seconds, outcome.megabytes)
    if outcome.megabytes > MEGABYTES:
        return Outcome(number, name, "memory: over the bound", outcome.seconds, outcome.megabytes)
    return outcome


def run(count: int, seed: int, report: Callable[[Outcome], None] = lambda _: None) -> list[dict[str, str]]:
    """Derive texts and give the rows of the table: figure, asked, measured."""
    kinds: Counter[str] = Counter()
    slowest = largest = 0.0
    for outcome in attempts("tests.attacks.expressions", [str(seed)], range(count)):
        report(outcome)
        kinds[outcome.said.split()[0].rstrip(":")] += 1
        slowest, largest = max(slowest, outcome.seconds), max(largest, outcome.megabytes)
    return [
        {
            "figure": f"{count} random texts derived: crashes, over 5 s, over 1 GB",
            "asked": "0, 0, 0",
            "measured": f"{kinds['crash']}, {kinds['hang']}, {kinds['memory']} "
            f"({kinds['refused']} refused, slowest {slowest:.1f} s, at most {largest:.0f} MB)",
        }
    ]


def _show(outcome: Outcome, seed: int) -> None:
    if outcome.said.split()[0].rstrip(":") not in ("result", "refused"):
        print(
            f"{outcome.number}: {outcome.said}: {text_of(outcome.number, seed)}", file=sys.stderr, flush=True
        )


def main(argv: list[str]) -> int:
    """Run attacks from the command line; 1 where one of them got through."""
    parser = argparse.ArgumentParser(prog="python -m tests.attacks.expressions")
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int)
    parser.add_argument("--serve", type=int)
    chosen = parser.parse_args(argv)
    if chosen.serve is not None:
        return serve(lambda number: attack(number, chosen.serve))
    if chosen.only is not None:
        print(text_of(chosen.only, chosen.seed), attack(chosen.only, chosen.seed))
        return 0
    rows = run(chosen.count, chosen.seed, lambda outcome: _show(outcome, chosen.seed))
    print(json.dumps(rows, indent=1))
    return 0 if all(row["measured"].startswith(row["asked"]) for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
