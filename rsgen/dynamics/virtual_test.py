"""Virtual tests: what they measure and how, with a sine that steps or with a periodic multisine.

A stepped sine drives at levels F and frequencies f, f(t) = Re F exp(i omega t); a shaken base of motion a_b
drives the relative motion by -m a_b. A random-phase multisine (R. Pintelon and J. Schoukens, System
Identification, 2012, Ch. 5) of period T and level s (root mean square) has the force lines

    F_h = s sqrt(2/E) exp(2 pi i u_h),    f_h = h/T,

for E excited lines with phases u_h uniform in 0 to 1. Its periodic response is solved with twice as many
lines until the recorded ones stay (``periodic_response``). Noise is white, complex and Gaussian.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.declaration import Rule, check, declare, documented, given
from rsgen.common.errors import RsgenError
from rsgen.common.text_table import Brief
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Oscillator
from rsgen.data.record_set import BASE_UNITS, PlannedTest, below_acceleration
from rsgen.data.surface.plausibility import MAX_RESONANT_LAG
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.settling import SteadyStates
from rsgen.dynamics.steady_state import ACCURACY, HARMONICS, MAX_BATCH_POINTS, USUAL_ACCURACY, USUAL_HARMONICS
from rsgen.law.numeric import compile_law


def level_grid(values: ArrayLike, name: str, unit: str) -> Array:
    """Check values that are asked for: one or more, positive, each once."""
    try:
        array = np.array(values, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise RsgenError(f"{name}: {values!r:.60}; must be numbers [{unit}]") from None
    if array.ndim != 1 or not array.size:
        raise RsgenError(f"{name}: must be one or more values in {unit}")
    if not np.all(np.isfinite(array) & (array > 0)):
        raise RsgenError(f"{name}: must be positive and finite everywhere [{unit}]")
    if len(set(array.tolist())) != len(array):
        raise RsgenError(f"{name}: a value occurs more than once; every value must be unique")
    array.flags.writeable = False
    return array


class VirtualTest(Brief, PlannedTest):
    """A test that is simulated."""

    __slots__ = ()
    level: Array
    noise_relative: float
    seed: int
    base: str | None

    @property
    def level_unit(self) -> str:
        """SI unit of the levels."""
        return BASE_UNITS[self.base or ""]

    def drive(self, mass: float, level: Array | ComplexArray, frequency: Array) -> ComplexArray:
        """(n,) complex force [N] on the mass [kg] at levels and frequencies [Hz]: -m a_b of a shaken base.

        The level has the phase of the force, or that of the motion of the base.
        """
        if self.base is None:
            return np.asarray(level, dtype=np.complex128)
        return np.asarray(-mass * (2j * np.pi * frequency) ** below_acceleration(self.base) * level)

    @property
    def planned_levels(self) -> Array:
        """(l,) levels that are tested; none where they are faulty."""
        return np.zeros(0) if self.level is None else self.level

    @property
    def noise_seed(self) -> int | None:
        """Seed of the noise; None without noise."""
        return self.seed if self.noise_relative > 0 else None

    def _origin(self, made: str) -> dict[str, str]:
        noise = f"{self.noise_relative:g} relative, seed {self.seed}"
        return {"Simulation": made, "Noise": noise if self.noise_relative else "none"}


declare_noise = partial(declare, 0.0, at_least=0, at_most=1, key="noise.relative")
"""Declares the noise of a virtual test, in the words of the help."""

declare_seed = partial(declare, 1, at_least=0, at_most=2**63 - 1, key="noise.seed")
"""Declares the seed of the noise."""

_Base = Annotated[
    Literal["displacement", "velocity", "acceleration"] | None,
    Rule(
        "What of the motion of a shaken base the levels are amounts of, instead of a force. The response is "
        "the motion relative to the base.",
        key="base.quantity",
    ),
]


@documented
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SimulatedTest(VirtualTest):
    """A stepped-sine test on a grid of levels and frequencies.

    Raises RsgenError where a value is out of range or a choice unknown.
    """

    level: Annotated[
        Array,
        Rule(
            "Force amplitudes F; amplitudes X of the displacement [m] under response control and in a "
            "continuation; of the motion of a base as [test.base] says.",
            unit="N",
        ),
    ]
    frequency: Annotated[Array, Rule("Frequencies.", unit="Hz")]
    sweep: Literal["rest", "up", "down"] = declare(
        "rest", "rest: every point from rest. up, down: the state is carried from frequency to frequency."
    )
    harmonics: Annotated[int, HARMONICS] = USUAL_HARMONICS
    accuracy: Annotated[float, ACCURACY] = USUAL_ACCURACY
    noise_relative: float = declare_noise(
        "Complex Gaussian noise on force and response: standard deviation over amplitude.", required=True
    )
    seed: int = declare_seed("Of the noise.")
    method: Literal["time", "harmonic-balance"] = declare(
        "time",
        "time: time integration, as exact as asked. harmonic-balance: as exact as its harmonics are many, "
        "unstable motions included. Other controls than force are the latter, with at least 31 harmonics (of "
        "joints 15) under time.",
    )
    control: Literal["force", "response", "phase", "continuation"] = declare(
        "force",
        "force: constant F. response: constant X, the force follows. phase: constant F, the frequency "
        "follows between the lowest and the highest one, until the response lags as the loop wants it. "
        "continuation: X rises from level to level at each frequency, through folds, the force follows.",
    )
    lags: tuple[Annotated[float, Rule(unit="rad", above=0, below=pi)], ...] = declare(
        (pi / 2,),
        "Lags of the displacement that the loop holds at each level; a quarter period, 90 deg, is resonance.",
        key="phase.lags",
        fewest=1,
        most=100,
    )
    phase_error: float = declare(
        0.0,
        "By which the lag is larger than the loop wants it.",
        unit="rad",
        key="phase.error",
        at_least=-0.5,
        at_most=0.5,
    )
    base: _Base = None

    def __post_init__(self) -> None:
        unit = self.level_unit
        object.__setattr__(self, "level", level_grid(self.level, "test.level", unit))
        object.__setattr__(self, "frequency", level_grid(self.frequency, "test.frequency", "Hz"))
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        if self.control != "force" and self.base is not None:
            yield "base", f"is shaken, but a force controls the {self.control}; leave one of them out"
        if self.control != "phase" and given(self, "lags", "phase_error"):
            yield "lags", "and phase_error are of a phase-locked loop; leave them out, or set control 'phase'"
        if self.control == "phase" and self.sweep != "rest":
            yield "sweep", f"{self.sweep!r}, but a phase-locked loop finds its frequency; leave it out"
        for lag in self.lags:
            if not 0 < lag + self.phase_error < pi:
                yield "phase_error", f"makes a lag of {lag + self.phase_error:.4g} rad; must be 0 to pi"

    @property
    def level_unit(self) -> str:
        """SI unit of the levels."""
        return "m" if self.response_held else BASE_UNITS[self.base or ""]

    @property
    def response_held(self) -> bool:
        """True if levels are amplitudes of the response and the force follows from them."""
        return self.control in ("response", "continuation")

    @property
    def per_level(self) -> int:
        """Points of each level: frequencies, or lags of a phase-locked loop."""
        return len(self.lags if self.control == "phase" else self.frequency)

    @property
    def in_time(self) -> bool:
        """True if the law is integrated in time."""
        return self.method == "time" and self.control == "force"

    def known_mass(self, mass: float | None) -> float | None:
        """Return the mass [kg] of a shaken base or at phase resonance alone, where the test tells none."""
        resonant = all(abs(lag + self.phase_error - pi / 2) < MAX_RESONANT_LAG for lag in self.lags)
        return mass if self.base is not None or (self.control == "phase" and resonant) else None

    def planned(self) -> ResponseSurface:
        """Return the grid of the test, as if every point had settled: with the response held, or 1 m."""
        # a phase-locked loop finds its frequency: any in the band stands for it
        frequencies = np.resize(self.frequency, self.per_level)
        level, frequency = np.meshgrid(self.level, frequencies, indexing="ij")
        response = level if self.control in ("response", "continuation") else np.ones(level.shape)
        return ResponseSurface(
            level.ravel(),
            frequency.ravel(),
            1.0,
            response.ravel().astype(complex),
            sweep=self.sweep,
            control=self.control,
            base=self.base or "",
        )

    def summary(self) -> dict[str, Any]:
        """Return what the test is, without the extent of its records."""
        return {"kind": "simulated", "frequencies": self.per_level, "control": self.control}

    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
        held = f"{self.base} of the base" if self.base else f"{self.control} control"
        return self._origin(f"{self.method}, {held}, sweep {self.sweep}, accuracy {self.accuracy:g}")


# ----------------------------------------------------------------------------
# Virtual tests whose mean displacement nothing determines.


def free_mean_fault(oscillator: Oscillator, test: PlannedTest) -> str:
    """Say why a test cannot be simulated in time for want of a spring; empty where it can."""
    law = compile_law(oscillator.force)
    if not (test.in_time and law.mean_free):
        return ""
    return (
        "no spring holds the mean displacement: the law depends on x through its memory only, so that the "
        "mass drifts and stays where the start left it; a spring parallel to the loop, however soft, is "
        'needed, or method = "harmonic-balance", which keeps the mean at zero'
    )


# ----------------------------------------------------------------------------
# The grid of a virtual test: in parts, or frequency by frequency as a sweep passes them.

States = TypeVar("States", bound=SteadyStates)
Progress = Callable[[float], None] | None
"""Called with the share that is done, from 0 to 1."""

_POINTS_PER_REPORT = 4 * MAX_BATCH_POINTS
"""Points between two reports of the progress: a second or so."""


def grid_of(test: SimulatedTest) -> tuple[Array, Array]:
    """Level and frequency (n,) of every point, level by level."""
    return np.repeat(test.level, len(test.frequency)), np.tile(test.frequency, len(test.level))


def in_parts(solve: Callable[[Array, Array], States], test: SimulatedTest, progress: Progress) -> States:
    """Solve the grid part by part, by ``solve(levels, frequencies)``."""
    level, frequency = grid_of(test)
    parts = []
    for low in range(0, len(level), _POINTS_PER_REPORT):
        part = slice(low, low + _POINTS_PER_REPORT)
        parts.append(solve(level[part], frequency[part]))
        if progress is not None:
            progress(min(low + _POINTS_PER_REPORT, len(level)) / len(level))
    return type(parts[0]).joined(parts)


def swept(
    solve: Callable[[Array, SteadyStates | None], SteadyStates], test: SimulatedTest, progress: Progress
) -> SteadyStates:
    """Solve the grid frequency by frequency in the order of the sweep, all levels at once.

    ``solve(frequency, last)`` takes the frequency (levels,) and the states at the one before, None at first.
    """
    order = np.argsort(test.frequency)[:: 1 if test.sweep == "up" else -1]
    parts: list[SteadyStates] = []
    for column in order:
        frequency = np.full(len(test.level), test.frequency[column])
        parts.append(solve(frequency, parts[-1] if parts else None))
        if progress is not None:
            progress(len(parts) / len(order))
    # the parts are in the order of the sweep, the grid is level by level
    rank, levels = np.argsort(order), len(test.level)
    return SteadyStates.joined(parts, (rank[None, :] * levels + np.arange(levels)[:, None]).ravel())


# ----------------------------------------------------------------------------
# Measurement noise of a virtual test.


def add_noise(surface: ResponseSurface, relative: float, seed: int) -> ResponseSurface:
    """Add complex Gaussian noise to force and response, independent of each other.

    The standard deviation of the complex noise is ``relative`` |F| on the force and ``relative`` |X1| on
    every harmonic: real and imaginary part have 1/sqrt(2) of it each, and so have the mean and the peaks,
    which are real. The same seed gives the same noise; zero leaves the surface as it is.
    """
    if relative == 0:
        return surface
    # separate streams: another number of harmonics does not change the noise of the force
    of_force, of_harmonics, of_peak = (np.random.default_rng([seed, stream]) for stream in range(3))
    deviation = relative / np.sqrt(2)
    F, X = np.abs(surface.force), surface.amplitude

    def complex_noise(generator: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
        # point by point: more points do not change the noise of the first ones
        parts = generator.standard_normal((*shape, 2))
        return np.asarray(parts[..., 0] + 1j * parts[..., 1])

    on_harmonics = complex_noise(of_harmonics, surface.harmonics.shape)
    on_harmonics[:, 0] = on_harmonics[:, 0].real
    return replace(
        surface,
        force=surface.force + deviation * F * complex_noise(of_force, F.shape),
        harmonics=surface.harmonics + deviation * X[:, None] * on_harmonics,
        peak=surface.peak + deviation * X[:, None] * of_peak.standard_normal(surface.peak.shape),
    )


# ----------------------------------------------------------------------------
# A virtual test with random-phase multisines.

_MAX_SAMPLES = 50_000_000
"""Complex numbers that force and response of a test may have: 0.8 GB each."""


@documented
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MultisineTest(VirtualTest):
    """A virtual test with a random-phase multisine: every level and realisation is a record.

    Raises RsgenError where a value is out of range.
    """

    level: Annotated[
        Array,
        Rule(
            "Root mean square of the force of each level; of the motion of a base as [test.base] says.",
            unit="N",
        ),
    ]
    band: Annotated[
        tuple[Annotated[float, Rule(unit="Hz", at_least=0)], Annotated[float, Rule(unit="Hz", above=0)]],
        Rule("Lowest and highest excited frequency."),
    ]
    period: Annotated[
        float, Rule("Of the multisine; its inverse is the spacing of the lines.", unit="s", above=0)
    ]
    lines: Literal["all", "odd"] = declare(
        "odd", "Which lines are excited: the even ones that odd leaves out show even distortion."
    )
    realisations: int = declare(1, "Records a level, each with phases of its own.", at_least=1, at_most=100)
    periods: int = declare(8, "Periods of each record, after the transient.", at_least=1, at_most=10_000)
    recorded: float = declare(
        4.0, "Highest recorded line over the highest excited one.", at_least=1, at_most=100
    )
    noise_relative: float = declare_noise(
        "White noise of each period on force and response: its rms over that of the signal."
    )
    seed: int = declare_seed("Of phases and noise.")
    base: _Base = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", level_grid(self.level, "test.level", self.level_unit))
        object.__setattr__(self, "band", tuple(map(float, self.band)))
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        low, high = self.band
        # a float, which may be larger than any number of lines
        size = len(self.level) * self.realisations * self.periods * (self.recorded * high * self.period + 1)
        if not 0 <= low < high:
            yield "band", f"{low:g} to {high:g} Hz; must be ascending"
        elif size > _MAX_SAMPLES:
            yield "periods", f"{size:.3g} lines of all periods; at most {_MAX_SAMPLES}"
        elif not self.excited.size:
            yield "band", f"no line of a period of {self.period:g} s is in it; a longer one is needed"

    @property
    def many_lines(self) -> bool:
        """True if the force has many lines, that is, is a multisine."""
        return True

    def known_mass(self, mass: float | None) -> float | None:
        """Return the mass [kg] of a shaken base; forces in N determine it."""
        return None if self.base is None else mass

    def planned(self) -> MultisineSpectra:
        """Return the records of the test, as if every excited line had the same force and response."""
        level = np.repeat(self.level, self.realisations)
        lines = np.zeros((len(level), int(self.excited[-1]) + 1), complex)
        lines[:, self.excited] = 1.0
        return MultisineSpectra(level, 2 * np.pi / self.period, lines, lines, base=self.base or "")

    def summary(self) -> dict[str, Any]:
        """Return what the test is, without the extent of its records."""
        return {"kind": "simulated", "periods": self.periods}

    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
        records = f"{self.realisations} realisation{'s' if self.realisations > 1 else ''} a level"
        return self._origin(f"multisine, {self.lines} lines, {records}")

    @property
    def excited(self) -> NDArray[np.intp]:
        """(e,) numbers of the excited lines."""
        low, high = self.band
        chosen = np.arange(max(1, int(np.ceil(low * self.period - 1e-9))), int(high * self.period + 1e-9) + 1)
        return chosen[chosen % 2 == 1] if self.lines == "odd" else chosen

    @property
    def highest(self) -> int:
        """Number of the highest recorded line."""
        return int(np.ceil(self.recorded * self.band[1] * self.period))
