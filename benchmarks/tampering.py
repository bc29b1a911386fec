"""What goes wrong with tests: a tampering does one thing to a laboratory's test, and names its finding."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.laboratory import EVERY, Laboratory, Record, load, recorded, stepped

SENSE = frozenset(
    {
        "not-passive", "structure-feeds-exciter", "mass-negative", "curve-negative", "another-quantity",
        "phase-turned",
    }
)  # fmt: skip
"""Force and response cannot belong together in this sense: power, mass or phase are wrong."""

MISFIT = frozenset({"law-does-not-fit", "misfit-large"})
BACKGROUND = MISFIT | {"background-missing"}
POINTS = MISFIT | {"points-excluded", "parts-disagree", "level-deviates", "range-reached"}
NOMINAL = frozenset({"levels-disagree", "levels-swapped", "levels-of-one-force", "run-repeated"})
LEVELS = POINTS | NOMINAL
SIZE = frozenset({"size-impossible"})
UNIT = SIZE | {"unit-contradicts-title"}
WAVE = frozenset({"not-a-steady-sine", "power-not-at-lines", "points-excluded", "decay-not-free"})
"""The record is no steady sine, no sweep or no decay."""

MATTERING = {
    "bilinear": ("k6*x", "c5*v"), "combined": ("k8*x + kn8*x**3", "c6*v"), "coulomb": ("k3*x", "c3*v"),
    "cubic": ("k1*x", "c1*v"), "cubic-hardening": ("k1*x", "c1*v"), "joint": ("a1*x", "d1*v"),
    "piecewise": ("k4*x", "c4*v"), "quintic": ("k2*x", "c2*v"),
}  # fmt: skip
"""The law of each case without the term that decides."""

OTHER_WRONG = {
    "bilinear": ("k6*x + kn*x**3", "c5*v*abs(v)"), "combined": ("k8*x", "c6*v + cn6*v*abs(v)"),
    "coulomb": ("k3*x", "c3*v*abs(v)"), "cubic": ("k1*x + kn1*x**5", "c1*v"),
    "cubic-hardening": ("k1*x", "c1*v + cn*v**3"), "joint": ("a1*x + a3*x**3", "d1*v + d2*v*abs(v)"),
    "piecewise": ("k4*x", "c4*v + Ff*sign(v)"), "quintic": ("k2*x + kn2*x**3", "c2*v"),
}  # fmt: skip
"""A law as somebody might guess it wrongly."""

LINEAR_FUNDAMENTALS = (
    "a spring with one stiffness a side is as stiff at every amplitude: without mean and harmonics the "
    "fundamentals are those of a linear one"
)
UNSEEN_OF = {
    ("bilinear", "law without the decisive term"): LINEAR_FUNDAMENTALS,
    ("joint", "response in mm/s^2, read as m/s^2"): (
        "6 g that move by 50 mm at 45 Hz under 10 N are unusual and possible"
    ),
}
"""What the test of one case cannot show, though that of the others does."""

Test = Laboratory | Record


@dataclass(frozen=True)
class Tampering:
    """One thing wrong with a test, in words; one of the codes in ``right`` must decide."""

    name: str
    right: frozenset[str]
    # what is done to the stepped sine of any laboratory; None where the test is no such one
    change: Callable[[Laboratory], Laboratory] | None = None
    build: Callable[[str], Test] | None = None  # the tampered test of a case otherwise
    refusal: str = ""  # part of a sentence of refusal that is as right as a finding
    corrected: str = ""  # code of a finding that says that the mistake was seen and mended
    unseen: str = ""  # why the data cannot show it; "" where they can

    def make(self, name: str, every: int = EVERY) -> Test:
        """Tamper with the test of this name; of a stepped sine with every n-th frequency."""
        if self.build is not None:
            return self.build(name)
        assert self.change is not None
        return self.change(stepped(name, every=every))


G = 9.80665
"""m/s^2"""


def _responds(test: Laboratory, response: np.ndarray) -> Laboratory:
    return replace(test, response=response)


def _along(test: Laboratory) -> np.ndarray:
    """Places of the rows in the file, 0 the first, 1 the last."""
    return np.linspace(0, 1, len(test.response))


def _level(test: Laboratory, share: float) -> float:
    """The level this far up the list, 0 the lowest, 1 the highest."""
    return float(test.levels[round(share * (len(test.levels) - 1))])


def _generator(test: Laboratory) -> np.random.Generator:
    return np.random.default_rng(len(test.level))


def scaled(factor: complex | Callable[[Laboratory], np.ndarray]) -> Callable[[Laboratory], Laboratory]:
    """Multiply the response by a number, or by one a row."""
    return lambda test: _responds(test, test.response * (factor(test) if callable(factor) else factor))


def _in_level(test: Laboratory, share: float, inside: float, outside: float = 1.0) -> np.ndarray:
    """Give one number to the rows of a level, another to all others."""
    return np.where(test.level == _level(test, share), inside, outside)


def radians(column: str) -> Callable[[Laboratory], Laboratory]:
    """Write the frequency in rad/s, in a column of this name."""

    def change(test: Laboratory) -> Laboratory:
        heads = (test.heads[0], column, *test.heads[2:])
        shown = replace(test, frequency=2 * np.pi * test.frequency, heads=heads)
        return shown.reading("frequency", column=column)

    return change


def delayed(test: Laboratory) -> np.ndarray:
    # half a radian over the band, whatever it is at the resonance
    late = 0.5 / (2 * np.pi * float(np.ptp(test.frequency)))
    return 0.8 * np.exp(-2j * np.pi * test.frequency * late)


def swapped_levels(test: Laboratory) -> Laboratory:
    low, high = _level(test, 0.3), _level(test, 0.8)
    level = np.where(test.level == low, high, np.where(test.level == high, low, test.level))
    return replace(test, level=level, force=test.force * level / test.level)


def labels(test: Laboratory) -> Laboratory:
    chosen = np.unique([_level(test, share) for share in (0.0, 0.1, 0.3, 0.55, 1.0)])
    part = test.keep(np.flatnonzero(np.isin(test.level, chosen)))
    part = replace(part, level=1.0 + np.searchsorted(chosen, part.level))
    return replace(part, test={**part.test, "force": {"nominal": True}})


def level_twice(test: Laboratory) -> Laboratory:
    source, other = _level(test, 0.9), _level(test, 0.5)
    both = test.keep(np.concatenate([np.flatnonzero(test.level != other), test.at(source)]))
    copied = np.arange(len(both.level)) >= np.count_nonzero(test.level != other)
    force = np.where(copied, both.force * other / source, both.force)
    return replace(both, force=force, level=np.where(copied, other, both.level))


def half_of_another(test: Laboratory) -> Laboratory:
    here, there = test.at(_level(test, 0.7)), test.at(_level(test, 0.2))
    here, there = (rows[test.frequency[rows] > test.natural_frequency] for rows in (here, there))
    response = test.response.copy()
    for row in here:
        response[row] = test.response[there[np.argmin(np.abs(test.frequency[there] - test.frequency[row]))]]
    return _responds(test, response)


def half_noise(test: Laboratory) -> Laboratory:
    rows = test.at(_level(test, 0.7))[::2]
    parts = _generator(test).standard_normal((len(rows), 2)) @ np.array([1, 1j])
    response = test.response.copy()
    response[rows] = np.sqrt(np.mean(np.abs(response[rows]) ** 2) / 2) * parts
    return _responds(test, response)


def outlying_block(test: Laboratory) -> np.ndarray:
    factor, count = np.ones(len(test.level)), len(test.level) // 10
    factor[len(factor) // 2 :][:count] = 1.5 + 0.3 * _generator(test).standard_normal(count)
    return factor


def overloaded(test: Laboratory) -> np.ndarray:
    size = np.abs(test.response)
    return np.minimum(1, 0.5 * size.max() / size)


def stepped_in_level(test: Laboratory) -> np.ndarray:
    rows, factor = test.at(_level(test, 0.7)), np.ones(len(test.level))
    factor[rows[len(rows) // 2 :]] = 1.2
    return factor


def shifted_in_line(test: Laboratory) -> Laboratory:
    size = np.abs(_receptance(test))[test.at(test.levels[0])]
    frequency = np.sort(test.frequency[test.at(test.levels[0])][size > size.max() / np.sqrt(2)])
    width = float(np.ptp(frequency)) or float(np.median(np.diff(np.unique(test.frequency))))
    return replace(test, frequency=test.frequency + _in_level(test, 0.6, 0.5 * width, 0.0))


def _receptance(test: Laboratory) -> np.ndarray:
    return -test.response / (2 * np.pi * test.frequency) ** 2 / test.force


def _seen_with(test: Laboratory, receptance: np.ndarray | complex) -> Laboratory:
    """Add a motion that follows the force."""
    w = 2 * np.pi * test.frequency
    return _responds(test, test.response - w**2 * receptance * test.force)


def second_mode(test: Laboratory) -> Laboratory:
    above = float(test.frequency.max()) - test.natural_frequency
    w, w2 = 2 * np.pi * test.frequency, 2 * np.pi * (test.natural_frequency + 0.3 * above)
    peak, loss = np.abs(_receptance(test)).max(), 2 * np.pi * 0.15 * above / w2
    return _seen_with(test, 0.5 * peak * loss * w2**2 / (w2**2 - w**2 + 1j * loss * w2 * w))


def constant_background(test: Laboratory) -> Laboratory:
    return _seen_with(test, 0.07 * np.abs(_receptance(test)).max() * np.exp(0.4j))


# ---- histories


def _rate(name: str) -> float:
    return 32 * stepped(name).natural_frequency


def _drive(name: str, periods: float) -> np.ndarray:
    return 6.0 * np.sin(2 * np.pi / 32 * np.arange(int(32 * periods)))


def driven_first(name: str) -> Test:
    return recorded(name, np.concatenate([_drive(name, 150), np.zeros(32 * 250)]), _rate(name), "ring-down")


def driven_throughout(name: str) -> Test:
    record = recorded(name, _drive(name, 400), _rate(name), "ring-down")
    return replace(record, further={"test.time.start": 200 / stepped(name).natural_frequency})


def noise_as(excitation: str) -> Callable[[str], Test]:
    def make(name: str) -> Test:
        force = 6.0 * np.random.default_rng(1).standard_normal(32 * 150)
        return recorded(name, force, _rate(name), excitation)

    return make


_REVERSIBLE = (
    "scaled alike, the law scales with it: stiffness, damping and mass are those of another structure"
)

TAMPERINGS = (
    Tampering("sign of the response reversed", SENSE, scaled(-1)),
    Tampering(
        "phase in the wrong sense (conjugate)", SENSE,
        lambda test: test.reading("response", phase_sense="lag"),
    ),
    Tampering("response in mm/s^2, read as m/s^2", SIZE, scaled(1e3)),
    Tampering("force in kN, read as N", SIZE | NOMINAL, lambda test: replace(test, force=1e-3 * test.force)),
    Tampering("one level in g, read as m/s^2", LEVELS, scaled(lambda test: _in_level(test, 0.6, 1 / G))),
    Tampering(
        "response in g, read as m/s^2; mass known", MISFIT | SIZE,
        lambda test: replace(
            scaled(1 / G)(test), further={"system": {"mass": load(test.name).oscillator.mass}}
        ),
        refusal="follows none of",
    ),
    Tampering("rad/s read as Hz, column called omega", UNIT, radians("omega_rad_s")),
    Tampering(
        "Hz read as rad/s, column called f_Hz", UNIT, lambda test: test.reading("frequency", unit="rad/s")
    ),
    Tampering("Hz read as kHz", UNIT, lambda test: test.reading("frequency", unit="kHz")),
    Tampering(
        "acceleration read as displacement", SENSE,
        lambda test: test.reading("response", quantity="displacement"),
    ),
    Tampering(
        "acceleration read as velocity", SENSE | MISFIT,
        lambda test: test.reading("response", quantity="velocity"), refusal="follows none of",
    ),
    Tampering("another sensor's channel, with a delay", MISFIT | SENSE, scaled(delayed)),
    Tampering("two levels swapped", LEVELS, swapped_levels),
    Tampering("labels 1, 2, 3, ... for the forces", LEVELS, labels, refusal="follows none of"),
    Tampering(
        "the same force at every level", LEVELS,
        lambda test: replace(test, force=np.full(len(test.force), 5.0)),
    ),
    Tampering("one level twice, once under another force", LEVELS, level_twice),
    Tampering("half of a level's points from another level", LEVELS, half_of_another),
    Tampering("half of a level's points noise", POINTS, half_noise),
    Tampering("10 % outliers in one block", POINTS, scaled(outlying_block)),
    Tampering(
        "frequencies of one level 2 % too high", LEVELS,
        lambda test: replace(test, frequency=test.frequency * _in_level(test, 0.6, 1.02)),
    ),
    Tampering("sensor overloaded at half of the largest response", POINTS, scaled(overloaded)),
    Tampering(
        "gain of the sensor 1.3 times from the middle on", POINTS,
        scaled(lambda test: np.where(_along(test) < 0.5, 1.0, 1.3)),
    ),
    Tampering("gain of the sensor drifts by 15 %", POINTS, scaled(lambda test: 1 + 0.15 * _along(test))),
    Tampering("gain of the sensor 1.2 times from the middle of a level on", POINTS, scaled(stepped_in_level)),
    Tampering("frequencies of one level shifted by half of a line's width", LEVELS, shifted_in_line),
    Tampering("response turned by 30 degrees", SENSE | MISFIT, scaled(np.exp(1j * np.pi / 6))),
    Tampering("a second mode in the band", BACKGROUND, second_mode),
    Tampering("a constant background left out", BACKGROUND, constant_background),
    Tampering("a phase error of 0.2 rad left out", BACKGROUND, scaled(np.exp(-0.2j))),
    Tampering("law without the decisive term", MISFIT, lambda test: replace(test, laws=MATTERING[test.name])),
    Tampering("a law guessed wrongly", MISFIT, lambda test: replace(test, laws=OTHER_WRONG[test.name])),
    Tampering(
        "free decay with its drive before it", WAVE | MISFIT, build=driven_first, refusal="decay",
        corrected="decay-taken",
    ),
    Tampering(
        "free decay that is driven throughout", WAVE | MISFIT, build=driven_throughout, refusal="decay"
    ),
    Tampering("noise taken as a swept sine", WAVE | MISFIT, build=noise_as("swept-sine"), refusal="sine"),
    Tampering("noise taken as a stepped sine", WAVE | MISFIT, build=noise_as("stepped-sine"), refusal="sine"),
)  # fmt: skip
"""Every case of ``cases/`` has to stand each of them."""

UNSEEN = (
    Tampering("response in g, read as m/s^2; mass unknown", SIZE, scaled(1 / G), unseen=_REVERSIBLE),
    Tampering("rad/s read as Hz, no name says so", SIZE, radians("x"), unseen=_REVERSIBLE),
)  # fmt: skip
"""Of one case each: what one test cannot show by itself."""
