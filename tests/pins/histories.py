"""Records with pinned numbers: what is tracked in swept and stepped sines, and what a decay says."""

from dataclasses import replace
from functools import cache

import numpy as np

import rsgen
from rsgen.data.history import SweepLaw, TimeHistory, from_free_decay, from_stepped_sine, from_swept_sine
from tests.history.test_decay import MASS, RATE, STIFFNESS, decay
from tests.history.test_stepped_sine import stepped
from tests.history.test_swept_sine import spoilt
from tests.oracles.swept import sweep
from tests.pins import trees
from tests.pins.pinned import SMOOTH, Pin, Tree

UP, DOWN = SweepLaw("linear", 9.0, 0.05), SweepLaw("linear", 11.0, -0.05)
OCTAVES = SweepLaw("logarithmic", 9.0, 0.008)
LAW = "k*x + kn*x**3 + c*v"
CUBIC = rsgen.Oscillator(MASS, LAW, {"k": STIFFNESS, "kn": -2e6, "c": 3.8})

INTEGRATED = replace(SMOOTH, value=1e-8)
"""Of records that are integrated by steps which round-off chooses: processors differ by 2e-9 of the root mean
square."""


@cache
def swept(law: SweepLaw, stop: float, level: float = 1.0) -> TimeHistory:
    return sweep(CUBIC, level, law, stop, 200.0)


def noisy(history: TimeHistory) -> TimeHistory:
    return replace(spoilt(history, 1e-3, np.random.default_rng(7)), level=history.level)


def _swept(*histories: TimeHistory, mass: float | None = None) -> Tree:
    return trees.surface(from_swept_sine(list(histories), points=30, harmonics=3, mass=mass))


def _acceleration() -> TimeHistory:
    """Second differences of the displacement; their slight error is the same in every run."""
    history = swept(UP, 11.0)
    response = np.gradient(np.gradient(np.asarray(history.response), 1 / 200.0), 1 / 200.0)
    return TimeHistory(history.rate, history.force, response, "acceleration")


def _identified_sweeps() -> Tree:
    records = [noisy(swept(UP, 11.0, level)) for level in (0.5, 1.0)]
    return trees.fitted(from_swept_sine(records, points=30, harmonics=3), LAW)


@cache
def _steps(dwell: float = 20.0) -> TimeHistory:
    force, x = stepped(np.linspace(9, 11, 9), np.full(9, 3.0), dwell)
    noise = np.random.default_rng(3).normal(size=(2, len(x)))
    return TimeHistory(RATE, force + 1e-3 * np.std(force) * noise[0], x + 1e-3 * np.std(x) * noise[1])


def _levels() -> Tree:
    force, x = stepped(np.full(3, 10.0), np.array([1.0, 2.0, 4.0]), 20.0)
    return trees.surface(from_stepped_sine(TimeHistory(RATE, force, x)))


@cache
def _tap(name: str, quantity: str = "displacement", noise: float = 0.0) -> TimeHistory:
    clean = decay(name, quantity, 10)
    drawn = np.random.default_rng(1).normal(size=len(clean))
    return TimeHistory(RATE, None, clean + noise * np.abs(clean).max() * drawn, quantity)


def _followed(name: str, quantity: str, noise: float, mass: float | None = MASS) -> Tree:
    found = rsgen.history.follow_decay(_tap(name, quantity, noise), mass=mass)
    # errors come from the scatter of neighbours, which is round-off where there is no noise
    errors = trees.parts(found, "", "stiffness_error damping_error", entries=2) if noise else {}
    return {
        **trees.parts(found, "", "time frequency damping_ratio stiffness damping"),
        **errors,
        "harmonics": trees.columns(np.nan_to_num(found.harmonics)),
        "findings": trees.findings(found.findings),
    }


def _decay_surface() -> rsgen.ResponseSurface:
    return from_free_decay(_tap("cubic", "displacement", 1e-3), mass=MASS)


PINS = {
    "swept/up": Pin(lambda: _swept(swept(UP, 11.0)), INTEGRATED),
    "swept/down": Pin(lambda: _swept(swept(DOWN, 9.0)), INTEGRATED),
    "swept/octaves": Pin(lambda: _swept(swept(OCTAVES, 11.0)), INTEGRATED),
    "swept/noisy": Pin(lambda: _swept(noisy(swept(UP, 11.0))), INTEGRATED),
    "swept/two-levels-given-mass": Pin(
        lambda: _swept(swept(UP, 11.0, 0.5), swept(UP, 11.0, 1.0), mass=MASS), INTEGRATED
    ),
    "swept/acceleration": Pin(lambda: _swept(_acceleration()), INTEGRATED),
    "swept/identified": Pin(_identified_sweeps),
    "stepped/frequencies": Pin(lambda: trees.surface(from_stepped_sine(_steps()))),
    "stepped/too-short": Pin(lambda: trees.surface(from_stepped_sine(_steps(3.0)))),
    "stepped/levels": Pin(_levels),
    "stepped/identified": Pin(lambda: trees.fitted(from_stepped_sine(_steps()), "k*x + c*v")),
    "decay/linear": Pin(lambda: _followed("linear", "displacement", 0.0), INTEGRATED),
    "decay/cubic": Pin(lambda: _followed("cubic", "displacement", 0.0), INTEGRATED),
    "decay/drag": Pin(lambda: _followed("drag", "displacement", 0.0), INTEGRATED),
    "decay/noisy": Pin(lambda: _followed("cubic", "displacement", 1e-3), INTEGRATED),
    "decay/acceleration": Pin(lambda: _followed("cubic", "acceleration", 1e-3), INTEGRATED),
    "decay/without-mass": Pin(lambda: _followed("drag", "velocity", 1e-3, None), INTEGRATED),
    "decay/surface": Pin(lambda: trees.surface(_decay_surface()), INTEGRATED),
    "decay/identified": Pin(lambda: trees.fitted(_decay_surface(), LAW, mass=MASS)),
}  # fmt: skip
