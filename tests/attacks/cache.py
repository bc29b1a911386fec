"""The cache of machine code damaged, and code of strangers planted in it; each is tried by a new process.

``python -m tests.attacks cache``
"""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

from rsgen.dynamics.kernel import compile_source
from rsgen.dynamics.kernel_source import generate
from rsgen.formula.reading import parse
from tests.attacks.program import HANG_SECONDS, Row, environment, row, temporary
from tests.kernel.test_store import DAMAGES, WAYS, WAYS_OF_ROOT, Planted
from tests.programs import python

LAW, OTHER_LAW = "c*v + k*x", "c*v + 3*k*x"
# a period of one oscillator, by a kernel from the cache if one can be trusted there
PROGRAM = f"""
import numpy as np
from rsgen.formula.reading import parse
from rsgen.dynamics.kernel import compile_kernel
kernel = compile_kernel(parse({LAW!r}))
state = kernel.integrate(
    np.array([0]), np.zeros((2, 1)), np.array([[1.0, 0.0]]), np.array([6.0]), 1.0, np.array([0.3, 40.0]),
    steps=32, periods=1,
).state
print(state.tobytes().hex())
"""


def _numbers(place: Path) -> str:
    """Integrate in a new process; return the bits of the result, or what came instead."""
    try:
        done = python("-c", PROGRAM, timeout=HANG_SECONDS, env=environment(place))
    except subprocess.TimeoutExpired:
        return "hung"
    return done.stdout if done.returncode == 0 else f"ended with {done.returncode}: {done.stderr[-200:]}"


def _entry(cache: Path) -> Path:
    (entry,) = [path for path in cache.iterdir() if not path.name.startswith(".")]
    return entry


def _full_folder(entry: Path) -> None:
    """A folder that cannot be taken away has the name of the entry."""
    entry.unlink()
    (entry / "more").mkdir(parents=True)


# what a new compilation cannot mend in the cache; it works without
FURTHER: dict[str, Callable[[Path], object]] = {"folder that is not empty": _full_folder}


def damage(kind: str, compiled: Path, expected: str) -> str:
    """Damage a cache in one way; say what is wrong with the numbers of the next two processes."""
    with temporary() as place:
        shutil.copytree(compiled / "cache", place / "cache")
        (DAMAGES | FURTHER)[kind](_entry(place / "cache"))
        found = {_numbers(place) for _ in range(2)}
    return "" if found == {expected} else f"{kind}: {'; '.join(sorted(found - {expected}))}"


def plant(attack: Callable[[Planted], object], compiled: Path, content: bytes, expected: str):
    """Plant code in one way; return whether it was executed, and what else went wrong."""
    with temporary() as place:
        shutil.copytree(compiled / "cache", place / "cache")
        attack(Planted(place / "cache", content))
        found = _numbers(place)
    executed = found != expected and not found.startswith(("hung", "ended"))
    return executed, "" if found == expected or executed else found


def run(count: int, seed: int) -> list[Row]:
    """Try ``count`` damages, spread over all kinds, and as many ways to plant; nothing is left to chance."""
    kinds = [*DAMAGES, *FURTHER]
    kinds = kinds[:: max(1, len(kinds) // count)][:count]
    ways = dict([*WAYS.items(), *(WAYS_OF_ROOT.items() if os.geteuid() == 0 else ())][:count])
    with temporary() as compiled:
        expected = _numbers(compiled)
        if expected.startswith(("hung", "ended")):
            raise RuntimeError(f"an undisturbed program {expected}")
        wrong = [text for text in (damage(kind, compiled, expected) for kind in kinds) if text]
        name = f"rsgen_kernel_{_entry(compiled / 'cache').name}"
        code, symbol = compile_source(generate(parse(OTHER_LAW)), name)
        content = symbol.encode() + b"\0" + code
        # by the user's own program: this is executed, or an attack that is would not be seen
        if not plant(Planted.written, compiled, content, expected)[0]:
            raise RuntimeError("code with the right digest is not executed, so these attacks show nothing")
        found = {name: plant(way, compiled, content, expected) for name, way in ways.items()}
    executed = [name for name, (ran, _) in found.items() if ran]
    wrong_ways = [f"{name}: {text}" for name, (_, text) in found.items() if text]
    shown = [f" ({'; '.join(which[:5])})" if which else "" for which in (wrong, [*executed, *wrong_ways])]
    count, same = len(kinds), "the same numbers from two new processes"
    right = f"{count - len(wrong)} of {count}{shown[0]}"
    ran = f"{len(executed)} of {len(ways)}{shown[1]}"
    return [
        row(f"damaged cache entries, {count} kinds: {same}", f"{count} of {count}", right),
        row(f"machine code planted in the cache, {len(ways)} ways: executed", "0", ran),
    ]
