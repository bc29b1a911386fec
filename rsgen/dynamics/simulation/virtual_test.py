"""What a virtual test measures, and how."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import pi
from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.declaration import Rule, check, declare, documented, given
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Oscillator
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.columns import BASE_UNITS, below_acceleration
from rsgen.dynamics.steady_state import SteadyStates
from rsgen.dynamics.steady_state.solver import ACCURACY, HARMONICS, USUAL_ACCURACY, USUAL_HARMONICS
from rsgen.law.numeric import compile_law

__all__ = [
    "Progress",
    "SimulatedTest",
    "add_noise",
    "free_mean_fault",
    "grid_of",
    "in_parts",
    "level_grid",
    "swept",
]


_RESONANT = 0.2
"""Lags within 11 degrees of a quarter period say nothing of the mass: k - m omega^2 is nearly zero."""


def level_grid(values: ArrayLike, name: str, unit: str) -> Array:
    """Check the values of a grid: one or more, positive, each once."""
    try:
        array = np.array(values, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise RsgenError(f"test.{name}: {values!r:.60}; must be numbers [{unit}]") from None
    if array.ndim != 1 or not array.size:
        raise RsgenError(f"test.{name}: must be one or more values in {unit}")
    if not np.all(np.isfinite(array) & (array > 0)):
        raise RsgenError(f"test.{name}: must be positive and finite everywhere [{unit}]")
    if len(set(array.tolist())) != len(array):
        raise RsgenError(f"test.{name}: a value occurs more than once; every value must be unique")
    array.flags.writeable = False
    return array


@documented
@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTest:
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
    noise_relative: float = declare(
        0.0,
        "Complex Gaussian noise on force and response: standard deviation over amplitude.",
        at_least=0,
        at_most=1,
        key="noise.relative",
        required=True,
    )
    seed: int = declare(1, "Of the noise.", at_least=0, at_most=2**63 - 1, key="noise.seed")
    method: Literal["time", "harmonic-balance"] = declare(
        "time",
        "time: time integration, as exact as asked. harmonic-balance: as exact as its harmonics are many, "
        "unstable motions included.",
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
    base: Literal["displacement", "velocity", "acceleration"] | None = declare(
        None,
        "What of the motion of a shaken base the levels are amplitudes of, instead of a force. The response "
        "is the motion relative to the base.",
        key="base.quantity",
    )

    def __post_init__(self) -> None:
        unit = self.level_unit
        object.__setattr__(self, "level", level_grid(self.level, "level", unit))
        object.__setattr__(self, "frequency", level_grid(self.frequency, "frequency", "Hz"))
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
        """Whether levels are amplitudes of the response, and the force is what the test finds."""
        return self.control in ("response", "continuation")

    @property
    def per_level(self) -> int:
        """Points of each level: frequencies, or lags of a phase-locked loop."""
        return len(self.lags if self.control == "phase" else self.frequency)

    @property
    def determines_mass(self) -> bool:
        """Whether the mass follows from the test: not from a shaken base, nor at phase resonance alone."""
        resonant = all(abs(lag + self.phase_error - pi / 2) < _RESONANT for lag in self.lags)
        return self.base is None and not (self.control == "phase" and resonant)

    def drive(self, mass: float, level: Array, frequency: Array) -> ComplexArray:
        """(n,) complex force [N] on the mass [kg] at levels and frequencies [Hz]: -m a_b of a shaken base.

        The motion of the base has phase zero.
        """
        if self.base is None:
            return np.asarray(level, dtype=np.complex128)
        derivatives = below_acceleration(self.base)
        return np.asarray(-mass * (2j * np.pi * frequency) ** derivatives * level)


# ----------------------------------------------------------------------------
# Virtual tests whose mean displacement nothing determines.


def free_mean_fault(oscillator: Oscillator, test: SimulatedTest) -> str:
    """Say why a test cannot be simulated in time for want of a spring; empty where it can."""
    law = compile_law(oscillator.force)
    if test.method != "time" or not law.mean_free:
        return ""
    return (
        "no spring holds the mean displacement: the law depends on x through its memory only, so that the "
        "mass drifts and stays where the start left it; a spring beside the loop, however soft, is needed, "
        'or method = "harmonic-balance", which keeps the mean at zero'
    )


# ----------------------------------------------------------------------------
# The grid of a virtual test: in parts, or frequency by frequency as a sweep passes them.

States = TypeVar("States", bound=SteadyStates)
Progress = Callable[[float], None] | None
"""Called with the share that is done, from 0 to 1."""

_PART = 65536
"""Points between two reports of the progress: a second or so."""


def grid_of(test: SimulatedTest) -> tuple[Array, Array]:
    """Level and frequency (n,) of every point, level by level."""
    return np.repeat(test.level, len(test.frequency)), np.tile(test.frequency, len(test.level))


def in_parts(solve: Callable[[Array, Array], States], test: SimulatedTest, progress: Progress) -> States:
    """Solve the grid part by part, by ``solve(levels, frequencies)``."""
    level, frequency = grid_of(test)
    parts = []
    for low in range(0, len(level), _PART):
        part = slice(low, low + _PART)
        parts.append(solve(level[part], frequency[part]))
        if progress is not None:
            progress(min(low + _PART, len(level)) / len(level))
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
