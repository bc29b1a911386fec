"""Virtual sweeps and free decays: time histories by the kernel, read as measured ones are.

The kernel carries all levels from sample to sample under no force of its own. The generator of a sweep is
three states of the law instead, a phasor whose angular frequency w rises linearly or exponentially,

    Fc' = -w Fs,    Fs' = w Fc,    w' = a + b w,    m x'' + n(x, x') = Fc,

so that the force which is recorded is the one that acted. Noise is white and Gaussian.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, nan, pi
from typing import Annotated, Any, Literal

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.common.declaration import Rule, check, declare, documented
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import BRANCH_DISTANCE, RELATIVE_CHANGE_NEGLIGIBLE
from rsgen.data import history
from rsgen.data.oscillator import Oscillator
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.virtual_test import Progress, VirtualTest, declare_noise, declare_seed, level_grid
from rsgen.formula.reading import parse
from rsgen.law.memory import memory_form, with_memory

_STEPS = 16
"""Of integration from one sample to the next: 128 a period where a sweep has the fewest samples."""
_MIN_SAMPLES_OF_PERIOD = 8
"""Of a sweep: its third harmonic is resolved."""
_MAX_SAMPLES = 5_000_000
"""Of all records of a test, two minutes of work."""

_SAMPLES_PER_REPORT = 1 << 14
"""Samples between two reports of the progress: half a second or so."""

_COSINE, _SINE, _PACE = "generator_cosine", "generator_sine", "generator_pace"
_RAMP, _GROWTH = "generator_ramp", "generator_growth"
"""Fc, Fs [N] and w [rad/s], as states of a law; a [rad/s^2] and b [1/s], as parameters."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class HistoryTest(VirtualTest):
    """A virtual test whose displacement is recorded in time, all levels alike."""

    duration: Annotated[float, Rule("Of each record: a sweep, or a decay.", unit="s", above=0)]
    rate: Annotated[float, Rule("Samples per second.", unit="Hz", above=0)]
    noise_relative: float = declare_noise(
        "White noise of force and displacement: its standard deviation over the largest sample of a record."
    )
    seed: int = declare_seed("Of the noise.")

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        samples = self.duration * self.rate * len(self.level)
        if samples > _MAX_SAMPLES:
            yield "duration", f"{samples:.3g} samples of all records; at most {_MAX_SAMPLES}"

    @property
    def in_time(self) -> bool:
        """True if the law is integrated in time."""
        return True

    def summary(self) -> dict[str, Any]:
        """Return what the test is, without the extent of its records."""
        return {"kind": "simulated"}

    @abstractmethod
    def simulated(self, oscillator: Oscillator, progress: Progress = None) -> ResponseSurface:
        """Simulate the records of an oscillator, and read them."""

    def _samples(
        self,
        law: sympy.Expr,
        values: Mapping[str, float],
        mass: float,
        start: Mapping[str, Any],
        seen: Sequence[str],
        progress: Progress,
    ) -> Array:
        """Samples (s, n, l) of ``seen``, x or states of the law; what has no ``start`` begins with zero."""
        kernel = compile_kernel(law, values=values)
        memory = memory_form(law)
        names = ["x", "v", *(str(rate.symbol) for rate in (() if memory is None else memory.rates))]
        levels, rows = len(self.level), [names.index(name) for name in seen]
        state = np.zeros((kernel.rows.count, levels))
        for name, value in start.items():
            state[names.index(name)] = value
        points, omega = np.arange(levels), np.full(levels, 2 * pi * self.rate)
        ordered = np.array([values[name] for name in kernel.parameters])
        samples = np.empty((len(seen), int(self.duration * self.rate), levels))
        for number in range(samples.shape[1]):
            samples[:, number] = state[rows]
            if progress is not None and number % _SAMPLES_PER_REPORT == 0:
                progress(number / samples.shape[1])
            # a period of the kernel is the time from one sample to the next
            state = kernel.integrate(
                points, state, np.zeros((levels, 2)), omega, mass, ordered, steps=_STEPS, periods=1
            ).state
        if not np.isfinite(samples).all():
            raise RsgenError(
                "test.level: the motion grows without bound; check the signs of the values of the law first, "
                "then take more samples per second"
            )
        return samples

    def _noisy(self, clean: Array, *stream: int) -> Array:
        """Samples (n, l) with noise; the same seed and stream give the same noise."""
        noise = np.random.default_rng([self.seed, *stream]).standard_normal(clean.T.shape).T
        return np.asarray(clean + self.noise_relative * np.abs(clean).max(axis=0) * noise)


def largest_after_jump(
    oscillator: Oscillator, force: float, fold: float, way: str, start: complex, landing: float
) -> float:
    """Return the largest |displacement| [m] between leaving a branch at its fold and settling on another.

    It is left at a frequency a two-thousandth beyond the fold, slowly, as in a slow sweep. NaN where the
    motion does not come to the other branch and repeat within 4096 periods, and of laws with memory.

    Parameters
    ----------
    oscillator, force
        Under f(t) = F cos(omega t), F in [N].
    fold, way
        Frequency [Hz], and the sweep, "up" or "down", that leaves the branch there.
    start, landing
        Complex fundamental X_1 [m] at the fold, and |X_1| [m] once settled.
    """
    kernel = compile_kernel(oscillator.force, values=oscillator.values)
    if kernel.rows.count > 2:
        return nan
    state, largest = np.array([[start.real], [-start.imag]]), 0.0
    drive, omega = np.array([[force, 0.0]]), 2 * pi * fold * np.array([1.0005 if way == "up" else 0.9995])
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    for _ in range(4096):
        point, before = np.zeros(1, dtype=np.intp), state
        moved = kernel.integrate(
            point, before, drive, omega, oscillator.mass, values, steps=8 * _STEPS, periods=1, harmonics=1
        )
        state, size = moved.state, abs(moved.harmonics[0, 1])
        largest = max(largest, float(np.abs(moved.peak).max()))
        repeats = np.abs(state - before).max() < RELATIVE_CHANGE_NEGLIGIBLE / 10 * size
        if repeats and abs(size / landing - 1) < BRANCH_DISTANCE:
            return largest
    return nan


@documented
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SweepTest(HistoryTest):
    """A test in which a sine sweeps through a band, from rest at each level and direction.

    Raises RsgenError where a value is out of range or a choice unknown.
    """

    level: Annotated[Array, Rule("Force amplitudes.", unit="N")]
    band: Annotated[
        tuple[Annotated[float, Rule(unit="Hz", above=0)], Annotated[float, Rule(unit="Hz", above=0)]],
        Rule("Lowest and highest frequency of the force."),
    ]
    sweep: Literal["both", "up", "down"] = declare("both", "Directions; both: a record of each.")
    law: Literal["linear", "logarithmic"] = declare(
        "linear", "How the frequency changes: so many Hz, or octaves, in every second."
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", level_grid(self.level, "test.level", "N"))
        object.__setattr__(self, "band", tuple(map(float, self.band)))
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        low, high = self.band
        if low >= high:
            yield "band", f"{low:g} to {high:g} Hz; must be ascending"
        if self.rate < _MIN_SAMPLES_OF_PERIOD * high:
            yield "rate", f"{self.rate:g} Hz; at least {_MIN_SAMPLES_OF_PERIOD} times the highest frequency"
        yield from HistoryTest.faults(self)

    def known_mass(self, mass: float | None) -> float | None:
        """Return None: forces in N determine the mass."""
        return None

    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
        return self._origin(f"{self.law} sweep {self.sweep}, {self.duration:g} s, {self.rate:g} samples/s")

    def simulated(self, oscillator: Oscillator, progress: Progress = None) -> ResponseSurface:
        """Simulate the records of an oscillator, and read them."""
        histories: list[history.TimeHistory] = []
        ways = ("up", "down") if self.sweep == "both" else (self.sweep,)

        def report(share: float) -> None:
            if progress is not None:
                progress((len(histories) / len(self.level) + share) / len(ways))

        for number, way in enumerate(ways):
            histories += self._histories(oscillator, way, number, report)
        return replace(history.from_swept_sine(histories), origin="simulated")

    def _histories(
        self, oscillator: Oscillator, way: str, number: int, progress: Progress
    ) -> list[history.TimeHistory]:
        first, last = (2 * pi * f for f in (self.band if way == "up" else self.band[::-1]))
        equations = {_COSINE: f"-{_PACE}*{_SINE}", _SINE: f"{_PACE}*{_COSINE}"}
        equations[_PACE] = f"{_RAMP} + {_GROWTH}*{_PACE}"
        law = oscillator.force + with_memory(parse(f"-{_COSINE}"), equations)
        ramp, growth = (last - first) / self.duration, log(last / first) / self.duration
        pace = {_RAMP: ramp, _GROWTH: 0.0} if self.law == "linear" else {_RAMP: 0.0, _GROWTH: growth}
        values, start = {**oscillator.values, **pace}, {_COSINE: self.level, _PACE: first}
        samples = self._samples(law, values, oscillator.mass, start, (_COSINE, "x"), progress)
        force, x = (self._noisy(clean, number, stream) for stream, clean in enumerate(samples))
        return [
            history.TimeHistory(self.rate, f, y, level=level, label=f"sweep {way} at {level:g} N")
            for f, y, level in zip(force.T, x.T, self.level, strict=True)
        ]


@documented
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DecayTest(HistoryTest):
    """A test in which the mass is let go and swings freely; the mass must be known.

    Raises RsgenError where a value is out of range.
    """

    level: Annotated[
        Array, Rule("Displacements from which the mass is let go, without velocity or memory.", unit="m")
    ]

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", level_grid(self.level, "test.level", "m"))
        check(self)

    @property
    def planned_levels(self) -> Array:
        """(0,): each decay is a level, named by the largest force that is found."""
        return np.zeros(0)

    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
        return self._origin(f"free decays, {self.duration:g} s, {self.rate:g} samples/s")

    def simulated(self, oscillator: Oscillator, progress: Progress = None) -> ResponseSurface:
        """Simulate the records of an oscillator, and read them."""
        (clean,) = self._samples(
            oscillator.force, oscillator.values, oscillator.mass, {"x": self.level}, ("x",), progress
        )
        x = self._noisy(clean)
        histories = [
            history.TimeHistory(self.rate, None, y, label=f"decay from {level:g} m")
            for y, level in zip(x.T, self.level, strict=True)
        ]
        return replace(history.from_free_decay(histories, mass=oscillator.mass), origin="simulated")
