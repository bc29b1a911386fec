"""Attacks on the reading of texts: random and pathological laws, each derived in a child process."""

from collections.abc import Sequence

import numpy as np

from rsgen import make_element
from rsgen.app.cli.derive_command import derive_command, read_memory
from rsgen.formula.unit_deduction import parameter_units
from tests.attacks.child import Outcome, attacked, judged, measured, said_of
from tests.attacks.program import Row
from tests.attacks.texts import TEXTS, grown, pick

SECONDS = 5.0  # work allowed until a text has its answer, on the machine of ``allowed``
MEGABYTES = 1024.0


def text_of(number: int, seed: int) -> tuple[str, str]:
    """Name and text of an attack: half grown at random, half made to be hard."""
    rng = np.random.default_rng([seed, number])
    make = grown if rng.random() < 0.5 else pick(rng, TEXTS)
    return make.__name__, make(rng)


def law_of(number: int, seed: int) -> tuple[str, str, tuple[str, ...]]:
    """Name, force and equations of an attack: a fifth are virgin curves, or rates of a state."""
    name, text = text_of(number, seed)
    if number % 10 == 3:
        return f"virgin curve: {name}", f"k*x + masing(x*({text}) + Min(kt*x, Fs))", ()
    if number % 10 == 8:
        return f"state: {name}", "k*x + c*v + z", (f"z = v - ({text})*z",)
    return name, text, ()


def answer(text: str, memory: Sequence[str] = ()) -> str:
    """Derive a text as ``rsgen derive`` does, and find the units of its parameters."""

    def derived() -> None:
        derive_command(text, [*memory])
        parameter_units(make_element("law", text, read_memory(memory)).force)

    return said_of(derived)


def attack(number: int, seed: int) -> Outcome:
    name, text, memory = law_of(number, seed)
    outcome = measured(number, f"{name}: {text[:2000]!a}", lambda: answer(text, memory))
    return judged(outcome, SECONDS, MEGABYTES)


def run(count: int, seed: int) -> list[Row]:
    return [attacked("expressions", count, seed, "random texts derived: crashes, over 5 s, over 1 GB")[0]]
