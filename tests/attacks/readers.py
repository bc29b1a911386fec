"""Attacks on the readers: tampered data and surface files of every format, each read in a child process."""

from collections.abc import Callable
from functools import lru_cache, partial
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rsgen import load_surface
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import propose
from tests.attacks.child import Outcome, attacked, judged, kind_of, measured, said_of
from tests.attacks.damage import CHECKED, DAMAGE
from tests.attacks.good_files import ENDINGS, good, history_plan, table_plan
from tests.attacks.program import Row
from tests.attacks.texts import pick
from tests.attacks.traps import TRAPS
from tests.attacks.traps_hdf5 import SECRET

SECONDS = 10.0  # work allowed for a file under SMALL bytes
SMALL = 10_000_000
MEGABYTES = 1024.0  # memory allowed beyond twice the size of the file

Numbers = dict[str, bytes]


def _numbers(path: Path, form: str) -> tuple[Numbers, list[str]]:
    """Read a file in every way: the numbers by reading, and what each way came to."""
    ways: dict[str, Callable[[], object]] = {
        "table": lambda: read_measurement(table_plan(path, form)),
        "history": lambda: read_measurement(history_plan(path, form)),
    }
    if form == "surface":
        ways = {"surface": lambda: load_surface(path)}
    found: Numbers = {}

    def read(name: str) -> None:
        surface = ways[name]()
        columns = (getattr(surface, one) for one in ("level", "frequency", "force", "harmonics"))
        values = np.concatenate([np.ravel(np.asarray(column, dtype=complex)) for column in columns])
        if np.any(values == SECRET):
            raise ValueError("read outside of the file")
        found[name] = values.tobytes()

    return found, [said_of(partial(read, name), 1000) for name in ways]


@lru_cache(maxsize=8)
def _undamaged(form: str) -> Numbers:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"good{ENDINGS[form]}"
        path.write_bytes(good(form, Path(folder)))
        return _numbers(path, form)[0]


def attack(number: int, seed: int, forms: tuple[str, ...] = tuple(ENDINGS)) -> Outcome:
    """Make the file of an attack and read it: formats in turn, damage, checked parts and traps at random."""
    rng = np.random.default_rng([seed, number])
    form = forms[number % len(forms)]
    draw = rng.random()
    with TemporaryDirectory(prefix="rsgen-attack-") as text:
        folder = Path(text)
        checked = draw > 0.8 and form in CHECKED
        if draw > 0.4 and not checked:
            trap = pick(rng, TRAPS[form])
            name, content = trap.__name__, trap(folder, rng)
            if draw > 0.7:
                other = pick(rng, DAMAGE)
                name, content = f"{name}, {other.__name__}", other(content, rng) if content else content
        else:
            damage = pick(rng, CHECKED[form] if checked else DAMAGE)
            name, content = damage.__name__, damage(good(form, folder), rng)
        path = folder / f"a{ENDINGS[form]}"
        path.write_bytes(content)
        known = _undamaged(form) if checked else None
        size = len(content)
        del content

        def read() -> str:
            # list it and draft a case for it, as ``rsgen inspect`` does
            listed = "" if form == "surface" else said_of(lambda: propose(list_contents(path)), 1000)
            found, said = _numbers(path, form)
            if known is not None and any(values != known[way] for way, values in found.items()):
                return "crash: other numbers after damage that a checksum shows"
            faults = [one for one in (listed, *said) if one.startswith("crash")]
            return [*faults, "result" if found else said[0]][0]

        outcome = measured(number, f"{form}: {name}, {size} bytes", read)
    # each of three readings of a workbook may take as long
    seconds = (3 * SECONDS if form == "xlsx" else SECONDS) if size < SMALL else inf
    return judged(outcome, seconds, MEGABYTES + 2 * size / 2**20)


def _kind(outcome: Outcome) -> str:
    kinds = {"other numbers": "unsaid", "read outside": "outside"}
    return next((kind for words, kind in kinds.items() if words in outcome.said), kind_of(outcome))


def run(count: int, seed: int) -> list[Row]:
    figure = "tampered data and surface files: crashes, hangs, reads outside, over 1 GB"
    row, found = attacked("readers", count, seed, figure, _kind)
    unsaid = "other numbers after damage in a part that the format checks, unsaid"
    return [row, (unsaid, [found["unsaid"]], "")]
