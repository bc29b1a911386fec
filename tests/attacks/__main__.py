"""All attacks, at the counts of the table or at those given: ``reports/attacks.md``.

``python -m tests.attacks`` runs everything, which takes hours; ``python -m tests.attacks kills=100 cases=20``
runs those modules, and leaves the other rows of the table as they are; ``python -m tests.attacks cases --only
7`` repeats one attack, which is the same everywhere.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rsgen.common.output import write_atomic
from tests.attacks.program import Row

# the modules, in the order of the table, and how often each attack is made
COUNTS = {
    "kills": 300, "readers": 5000, "expressions": 20_000, "cases": 10_000, "surroundings": 60,
}  # fmt: skip
TABLE = Path(__file__).parents[2] / "reports" / "attacks.md"

HEAD = """\
# Attacks

What was tried to make rsgen lie, lose a file, run a stranger's code, hang or end with a traceback, and what
came of it. `make attack` renews this file; `python -m tests.attacks kills=100` renews the rows of one module.
Each row says how often the attack was made. What is promised stands in [SECURITY.md](../SECURITY.md), the
attacks in `tests/attacks/`.

"""


def sections(text: str) -> dict[str, str]:
    return {part.partition("\n")[0].split(":")[0]: part for part in text.split("\n## ")[1:]}


def section(module: str, rows: Sequence[Row], seed: int, minutes: float) -> str:
    about = (import_module(f"tests.attacks.{module}").__doc__ or "").strip().splitlines()[0]
    text = f"{module}: {about[0].lower()}{about[1:]}\n\nSeed {seed}; {minutes:.1f} minutes.\n\n"
    text += "| figure | asked | measured |\n| --- | --- | --- |\n"
    for figure, counts, more in rows:
        asked, measured = (", ".join(map(str, numbers)) for numbers in ([0] * len(counts), counts))
        said = f"{measured}{more}".replace("|", "/").replace("\n", " ")
        text += f"| {figure} | {asked} | {said} |\n"
    return text


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("modules", nargs="*", default=list(COUNTS), metavar="MODULE[=COUNT]")
    parser.add_argument("--only", type=int, metavar="NUMBER")
    chosen, code = parser.parse_args(argv), 0
    for module, _, count in (word.partition("=") for word in chosen.modules):
        attacks, started = import_module(f"tests.attacks.{module}"), time.monotonic()
        if chosen.only is not None:
            print(attacks.attack(chosen.only, seed=1))
            continue
        rows = attacks.run(int(count or COUNTS[module]), seed=1)
        text = section(module, rows, seed=1, minutes=(time.monotonic() - started) / 60)
        for row in rows:
            print(*row, flush=True)
        code |= any(any(counts) for _, counts, _ in rows)
        # each at once: an attack that ends the machine leaves what was known before
        found = sections(TABLE.read_text(encoding="utf-8") if TABLE.exists() else "") | {module: text}
        ordered = [found[name].rstrip() for name in COUNTS if name in found]
        write_atomic(TABLE, HEAD + "\n".join(f"## {part}\n" for part in ordered))
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
