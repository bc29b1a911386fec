"""Attacks on case files: tampered ones of every kind, each loaded in a child process."""

import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.random import Generator

from rsgen import load_case
from tests.attacks.child import Outcome, attacked, judged, measured, said_of
from tests.attacks.damage import DAMAGE
from tests.attacks.program import Row
from tests.attacks.texts import pick

SECONDS = 10.0
MEGABYTES = 1024.0
ROOT = Path(__file__).parents[2] / "cases"
CASES = tuple(sorted([*ROOT.glob("*.toml"), *(ROOT / "formats").glob("*.toml")]))
VALUES = (
    "0", "-1", "1e999", "nan", "inf", "9" * 400, "true", '""', '"x"', "[]", "{}", "[[[[]]]]", "1979-05-27",
    "'1 kg'", "'5 N/m/m/m/m'", "'1e400 kg'", "'" + "m" * 3000 + "'", "'../../etc/passwd'", "'/dev/zero'",
    '"\\u202e"', "[1, 'a']", "{ start = 1, stop = 2, count = 1000000000 }",
    "{ start = 1, stop = 2, step = 1e-300 }", "[" * 900 + "]" * 900, "'m^999999'", "'kg**1e9'",
    "'" + "(" * 3000 + "'",
)  # fmt: skip


def other_value(text: str, rng: Generator) -> str:
    lines = text.split("\n")
    places = [number for number, line in enumerate(lines) if "=" in line]
    place = pick(rng, places)
    lines[place] = f"{lines[place].split('=')[0]}= {pick(rng, VALUES)}"
    return "\n".join(lines)


def line_gone(text: str, rng: Generator) -> str:
    lines = text.split("\n")
    line = lines.pop(int(rng.integers(len(lines))))
    for _ in range(int(rng.integers(0, 3))):
        lines.insert(int(rng.integers(len(lines))), line)
    return "\n".join(lines)


def many_tables(text: str, rng: Generator) -> str:
    """Thousands of tables or keys, or a key of great depth."""
    count = int(10 ** rng.uniform(1, 4))
    element, deep = '\n[[element]]\nname = "e{0}"\nforce = "k{0}*x"\n', ".".join(["a"] * count)
    return (
        text + "".join(map(element.format, range(min(count, 2000)))),
        text + "\n[truth]\n" + "".join(f"p{i} = {i}\n" for i in range(count)),
        f"{text}\n[{deep}]\n",
        f"{deep} = 1\n{text}",
    )[int(rng.integers(4))]


def damaged(text: str, rng: Generator) -> bytes:
    return pick(rng, DAMAGE)(text.encode(), rng)


WAYS: tuple[Callable[[str, Generator], str | bytes], ...] = (
    other_value, other_value, line_gone, many_tables, damaged, damaged,
)  # fmt: skip


def attack(number: int, seed: int) -> Outcome:
    rng = np.random.default_rng([seed, number])
    source, way = pick(rng, CASES), pick(rng, WAYS)
    content = way(source.read_text(encoding="utf-8"), rng)
    with TemporaryDirectory(prefix="rsgen-attack-") as folder:
        path = Path(folder) / source.name
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
        for file in source.parent.iterdir() if source.parent.name == "formats" else ():
            if file.suffix not in (".toml", ".py") and file.is_file():
                shutil.copy(file, folder)
        name = f"{source.name}: {way.__name__}"
        outcome = measured(number, name, lambda: said_of(lambda: load_case(path)))
    return judged(outcome, SECONDS, MEGABYTES)


def run(count: int, seed: int) -> list[Row]:
    return [attacked("cases", count, seed, "tampered case files: crashes, over 10 s, over 1 GB")[0]]
