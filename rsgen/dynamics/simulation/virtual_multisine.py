"""A virtual test with a periodic multisine: an oscillator's periodic responses, line by line, with noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.declaration import Rule, check, declare, documented
from rsgen.common.errors import RsgenError
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.multisine.spectra import rms
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.periodic_response import periodic_response
from rsgen.dynamics.simulation.virtual_test import level_grid
from rsgen.law.numeric import ForceLaw, compile_law

__all__ = ["MultisineTest", "simulate_multisine"]


_EXACT = 1e-9
"""Relative change of the recorded lines at which more lines of the motion no longer matter: a smooth law."""
_SWITCHED = 1e-5
"""The same of a law with switches: the next doubling would change half as much or less."""
_MOST_LINES = 1 << 15
"""Lines of a motion at most: its waveforms have four times as many samples."""
_MOST_SAMPLES = 50_000_000
"""Complex numbers that force and response of a test may have: 0.8 GB each."""


@documented
@dataclass(frozen=True, slots=True, eq=False)
class MultisineTest:
    """A virtual test with a random-phase multisine: every level and realisation is a record.

    Raises RsgenError where a value is out of range.
    """

    level: Annotated[Array, Rule("Root mean square of the force of each level.", unit="N")]
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
    noise_relative: float = declare(
        0.0,
        "White noise of each period on force and response: its rms over that of the signal.",
        at_least=0,
        at_most=1,
        key="noise.relative",
    )
    seed: int = declare(1, "Of phases and noise.", at_least=0, at_most=2**63 - 1, key="noise.seed")

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", level_grid(self.level, "level", "N"))
        object.__setattr__(self, "band", tuple(map(float, self.band)))
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        low, high = self.band
        # a float, which may be larger than any number of lines
        size = len(self.level) * self.realisations * self.periods * (self.recorded * high * self.period + 1)
        if not 0 <= low < high:
            yield "band", f"{low:g} to {high:g} Hz; must be ascending"
        elif size > _MOST_SAMPLES:
            yield "periods", f"{size:.3g} lines of all periods; at most {_MOST_SAMPLES}"
        elif not self.excited.size:
            yield "band", f"no line of a period of {self.period:g} s is in it; a longer one is needed"

    @property
    def determines_mass(self) -> bool:
        """Whether such a test determines the mass: forces are in N."""
        return True

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


def simulate_multisine(oscillator: Oscillator, test: MultisineTest) -> MultisineSpectra:
    """Compute the periodic response of every record.

    Raises
    ------
    RsgenError
        A record has no periodic response that Newton's method finds, as where dry friction holds the mass.
    """
    law = compile_law(oscillator.force)
    values = law.ordered(oscillator.values)
    phases = np.random.default_rng([test.seed, 0])
    levels = np.repeat(test.level, test.realisations)
    excited = test.excited
    forces, responses = [], []
    for level in levels:
        force = np.zeros(test.highest + 1, dtype=complex)
        force[excited] = level * np.sqrt(2 / len(excited))
        force[excited] *= np.exp(2j * np.pi * phases.random(len(excited)))
        found = _respond(law, values, oscillator.mass, 2 * np.pi / test.period, force)
        if found is None:
            raise RsgenError(
                f"test.level: {level:g} N: no periodic response was found; where dry friction holds the mass "
                "for a while, or several motions are possible, test at higher levels"
            )
        forces.append(force)
        responses.append(found)
    return MultisineSpectra(
        level=levels,
        omega0=2 * np.pi / test.period,
        force=_noisy(np.array(forces), test, 1),
        response=_noisy(np.array(responses), test, 2),
        origin="simulated",
    )


def _respond(
    law: ForceLaw, values: Array, mass: float, omega0: float, force: ComplexArray
) -> ComplexArray | None:
    """The recorded lines (H+1,) of the motion, with as many lines as they need; None without convergence."""
    count = len(force)
    before: ComplexArray | None = None
    start: ComplexArray | None = None
    enough = _SWITCHED if law.switched else _EXACT
    lines = count - 1
    while True:
        drive = np.zeros(lines + 1, dtype=complex)
        drive[:count] = force
        found = periodic_response(law, values, mass, omega0, drive, start)
        if not found.converged:
            return None
        recorded = found.spectrum[:count]
        if before is not None:
            change = float(np.linalg.norm(recorded - before)) / float(np.linalg.norm(recorded))
            if change < enough or 2 * lines > _MOST_LINES:
                return recorded
        before = recorded
        lines *= 2
        start = np.zeros(lines + 1, dtype=complex)
        start[: len(found.spectrum)] = found.spectrum


def _noisy(clean: ComplexArray, test: MultisineTest, stream: int) -> ComplexArray:
    """(r, p, H+1) periods of spectra (r, H+1) with white noise; the mean of a record is real."""
    periods = np.repeat(clean[:, None], test.periods, axis=1)
    if test.noise_relative == 0:
        return periods
    generator = np.random.default_rng([test.seed, stream])
    size = test.noise_relative * rms(clean)[:, None, None] / np.sqrt(clean.shape[1] - 1)
    drawn = generator.standard_normal((*periods.shape, 2))
    noise = drawn[..., 0] + 1j * drawn[..., 1]
    noise[..., 0] = noise[..., 0].real
    return np.asarray(periods + size * noise)
