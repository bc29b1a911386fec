"""Attacks on the readers: tampered data and surface files of every format, each read in a child process.

``python -m tests.attacks readers=5000``. An attack is a number: with the seed
it makes the same file on every machine, and ``python -m tests.attacks.readers --only NUMBER`` repeats it.
"""

import warnings
from collections.abc import Callable
from functools import lru_cache
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rsgen import RsgenError, load_surface
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import propose
from tests.attacks.child import Outcome, attacked, command, judged, kind_of, measured
from tests.attacks.damage import CHECKED, DAMAGE
from tests.attacks.good_files import ENDINGS, good, history_plan, table_plan
from tests.attacks.traps import TRAPS
from tests.attacks.traps_hdf5 import SECRET

SECONDS = 10.0  # work allowed for a file under SMALL bytes
SMALL = 10_000_000
MEGABYTES = 1024.0  # memory allowed beyond twice the size of the file

Numbers = dict[str, bytes]


class _SurpriseError(Exception):
    """A reader gave what it must not."""


def _numbers(path: Path, form: str) -> tuple[Numbers, int, str]:
    """Read a file in every way: the numbers by reading, how many ways refused it, and the first refusal."""
    ways: dict[str, Callable[[], object]] = {
        "table": lambda: read_measurement(table_plan(path, form)),
        "history": lambda: read_measurement(history_plan(path, form)),
    }
    if form == "surface":
        ways = {"surface": lambda: load_surface(path)}
    found: Numbers = {}
    faults = []
    for name, way in ways.items():
        try:
            values = _flat(way())
        except RsgenError as fault:
            faults.append(_sentence(str(fault)))
            continue
        if np.any(values == SECRET):
            raise _SurpriseError("read outside of the file")
        found[name] = values.tobytes()
    return found, len(faults), faults[0] if faults else ""


def _flat(surface: object) -> np.ndarray:
    names = ("level", "frequency", "force", "harmonics")
    return np.concatenate([np.ravel(np.asarray(getattr(surface, name), dtype=complex)) for name in names])


def _sentence(text: str) -> str:
    if not text or len(text) > 1000 or not text.replace("\n", " ").isprintable():
        raise _SurpriseError(f"a refusal that is no sentence: {text[:80]!r}")
    return text


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
            trap = TRAPS[form][int(rng.integers(len(TRAPS[form])))]
            name, content = trap.__name__, trap(folder, rng)
            if draw > 0.7:
                other = DAMAGE[int(rng.integers(len(DAMAGE)))]
                name, content = f"{name}, {other.__name__}", other(content, rng) if content else content
        else:
            damages = CHECKED[form] if checked else DAMAGE
            damage = damages[int(rng.integers(len(damages)))]
            name, content = damage.__name__, damage(good(form, folder), rng)
        path = folder / f"a{ENDINGS[form]}"
        path.write_bytes(content)
        known = _undamaged(form) if checked else None
        size = len(content)
        del content

        def read() -> str:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                if form != "surface":
                    # list it and draft a case for it, as ``rsgen inspect`` does
                    try:
                        propose(list_contents(path))
                    except RsgenError as fault:
                        _sentence(str(fault))
                found, faults, first = _numbers(path, form)
            if known is not None and any(values != known[way] for way, values in found.items()):
                return "crash: other numbers after damage that a checksum shows"
            return f"refused: {first}" if faults and not found else "result"

        outcome = measured(number, f"{form}: {name}, {size} bytes", read)
    # each of three readings of a workbook may take as long
    seconds = (3 * SECONDS if form == "xlsx" else SECONDS) if size < SMALL else inf
    return judged(outcome, seconds, MEGABYTES + 2 * size / 2**20)


def _kind(outcome: Outcome) -> str:
    kinds = {"other numbers": "unsaid", "read outside": "outside"}
    return next((kind for words, kind in kinds.items() if words in outcome.said), kind_of(outcome))


def run(count: int, seed: int) -> list[dict[str, str]]:
    figure = "tampered data and surface files: crashes, hangs, reads outside, over 1 GB"
    row, found = attacked("readers", count, seed, figure, _kind)
    unsaid = "other numbers after damage in a part that the format checks, unsaid"
    return [row, {"figure": unsaid, "asked": "0", "measured": str(found["unsaid"])}]


if __name__ == "__main__":
    command(attack)
