"""Attacks on laws with memory: random virgin curves, states and lags, each derived in a child process.

``python -m tests.attacks loops=3000``; ``python -m tests.attacks.loops --only NUMBER`` repeats one.
"""

import re
from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from tests.attacks.child import Outcome, attacked, command, judged, measured
from tests.attacks.expressions import MEGABYTES, SECONDS, answer
from tests.attacks.texts import NAMES, STATES, TEXTS, _pick, grown, no_language

KNOWN = ("Min(kt*x, Fs)", "kt*x - R*x**2", "Fs*(1 - exp(-kt*x/Fs))", "K*x/(1 + x/b)", "Fs*tanh(kt*x/Fs)",
         "R*x**0.5", "b*x*Max(1 - x/a, 0)", "jenkins")  # fmt: skip
"""Virgin curves as a person writes them."""

RATES = ("v - b*abs(v)*z", "A*v - b*abs(v)*z - a*v*abs(z)", "s*(v - abs(v)*z/g)", "w0*(x - z)", "v",
         "-z", "sign(v - z)", "v*z**3", "exp(z) + v", "v/z", "(x - z)/0", "z",
         "v*(1 - sign(v*z)*z**2)")  # fmt: skip
"""Equations of states as a person writes them, and with mistakes."""

HARD = tuple(make for make in TEXTS if make is not no_language)


_VELOCITY = re.compile(r"\bv\b")


def _any_text(rng: Generator) -> str:
    make = grown if rng.random() < 0.7 else HARD[int(rng.integers(len(HARD)))]
    return make(rng)[:600]


def virgin(rng: Generator) -> tuple[str, tuple[str, ...]]:
    """Masing laws of known, changed and random virgin curves, beside other forces or within them."""
    curves = []
    for _ in range(int(rng.integers(1, 4))):
        curve = _pick(rng, KNOWN) if rng.random() < 0.4 else _any_text(rng)
        if rng.random() < 0.8:
            # a virgin curve is zero at zero, and knows no velocity
            curve = f"{_pick(rng, NAMES)}*x*({_VELOCITY.sub('x', curve)}) + {_pick(rng, KNOWN[:5])}"
        curves.append(f"masing({curve})")
    around = (
        "k*x + {}", "{}", "abs({})", "k*x + {}*{}", "x*{}", "masing({})",
        "Piecewise(({}, x > b), (0, True))",
    )  # fmt: skip
    law = around[0 if rng.random() < 0.6 else int(rng.integers(len(around)))]
    return law.replace("{}", " + ".join(curves)), ()


def states(rng: Generator) -> tuple[str, tuple[str, ...]]:
    """One state or several, with known and random equations, used in a force or not."""
    names = ("z", "y", "w")[: 1 + int(rng.random() < 0.3) + int(rng.random() < 0.1)]
    rates = []
    for name in names:
        rate = _pick(rng, RATES) if rng.random() < 0.5 else _any_text(rng)
        if rng.random() < 0.5:
            rate = f"{rate} - {_pick(rng, (*NAMES, *STATES))}*{_pick(rng, names)}"
        rates.append(f"{name} = {rate.replace('z', name)}")
    if rng.random() < 0.1:
        rates.append(_pick(rng, ("z = v", "x = v", "q", "= v", "k = v", "abs = v", "z' = v", "")))
    shown = _pick(rng, ("k*x + {}", "{}", "k*x + c*v + a*{}", "k*x*{}", "sign({})", "k*x"))
    used = _pick(rng, names) if rng.random() < 0.1 else f"({' + '.join(names)})"
    return shown.replace("{}", used), tuple(rates)


def lagging(rng: Generator) -> tuple[str, tuple[str, ...]]:
    """Structural damping of something, alone or beside a loop."""
    stiffness = _pick(rng, ("h", "k*eta", "0", "-h", "h*x", "h**2", "1/h", "structural(h)", "1e300*h"))
    return f"k*x + structural({stiffness}) + {virgin(rng)[0]}" if rng.random() < 0.4 else (
        f"{_pick(rng, ('k*x + ', '', '-', 'x*'))}structural({stiffness})"
    ), ()  # fmt: skip


WAYS: tuple[Callable[[Generator], tuple[str, tuple[str, ...]]], ...] = (
    virgin, virgin, states, states, lagging,
)  # fmt: skip


def law_of(number: int, seed: int) -> tuple[str, str, tuple[str, ...]]:
    rng = np.random.default_rng([seed, number])
    make = WAYS[int(rng.integers(len(WAYS)))]
    return make.__name__, *make(rng)


def attack(number: int, seed: int) -> Outcome:
    name, text, memory = law_of(number, seed)
    outcome = measured(number, name, lambda: answer(text, memory, json=bool(number % 2)))
    return judged(outcome, SECONDS, MEGABYTES)


def run(count: int, seed: int) -> list[dict[str, str]]:
    return [
        attacked("loops", count, seed, "random laws with memory derived: crashes, over 5 s, over 1 GB")[0]
    ]


if __name__ == "__main__":
    command(attack, law_of)
