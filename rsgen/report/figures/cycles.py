"""Cycles of the restoring force: loops as measured and as identified, and the energy that they dissipate.

A measured loop needs no law: along the measured motion n(t) = f(t) - m a(t), harmonic by harmonic
n_h = F_h + m (h omega)^2 X_h. The energy of a cycle is pi Im(F conj X) [J], by the fundamental alone, for the
force has no other harmonic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import MISFIT_NEGLIGIBLE, NOISE_LIMIT_SIGMAS, POINTS_PER_KNOT
from rsgen.data.free_mode import estimate_mass, steady
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.describing import derive
from rsgen.formula.names import remembers
from rsgen.identification.results import Identification
from rsgen.law.motion import Motion, cycle_work
from rsgen.law.numeric import compile_law
from rsgen.report.figures.equivalent import (
    amplitudes_tested,
    backbone,
    evaluated,
    solution_of,
)

SAMPLES = 512
"""Of a loop: no corner of it can be seen."""

_FEWEST_FOR_NOISE = 4
"""Harmonics from which on the last two are a measure of the noise: of fewer both may be signal."""

_HALF_POWER = float(np.sqrt(0.5))
"""Least sine of the phase: between the half-power points an error of the phase changes the energy little."""

_AT_REST = (1e-9, 1e-8)
"""Shares of the smallest amplitude at which the stiffness at rest is read: Segalman's law comes as X**0.5."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredLoops:
    """Restoring force along measured motions, without any law.

    Parameters
    ----------
    motion
        The n motions, with the harmonics that rise above the noise.
    displacement, force
        (n, s) over one period [m], [N].
    """

    motion: Motion
    displacement: Array
    force: Array


def shows_loops(surface: ResponseSurface, model: Model) -> bool:
    """Decide whether loops belong into a report: of a law with memory, and of a test with harmonics.

    With the fundamental alone every loop is an ellipse, which shows nothing that k(X) and c(X) do not.
    """
    if not np.any(surface.settled & np.isfinite(surface.phase) & (surface.amplitude > 0)):
        return False
    return remembers(model.force) or (
        surface.origin == "measured" and bool(np.any(np.abs(surface.harmonics[:, 2:]) > 0))
    )


def mode_surface(surface: ResponseSurface, identification: Identification | None) -> ResponseSurface:
    """Return the surface without the background that was identified."""
    background = None if identification is None else identification.background
    if background is None:
        return surface
    return background.shape(surface.omega, surface.force).subtract(surface, background.values)


def mass_of(surface: ResponseSurface) -> float:
    """Read the mass [kg] without a law, from Re F/X = k(X) - m omega^2 with any smooth k(X).

    Raises
    ------
    RsgenError
        Too few points settled.
    """
    chosen = surface.select(surface.settled & (surface.amplitude > 0) & np.isfinite(surface.phase))
    found = estimate_mass(*steady(chosen.force, chosen.harmonics[:, 1], chosen.omega))
    if found is None:
        few = 2 * POINTS_PER_KNOT
        raise RsgenError(f"mass: is missing; {few} settled points with phases are needed to read it")
    return found.mass


def _above_noise(surface: ResponseSurface) -> Motion:
    """Take the harmonics of every motion that rise above the noise, the smaller one of the last two."""
    harmonics = np.nan_to_num(surface.harmonics)
    moves = harmonics[:, 1] != 0
    size: Array = np.zeros(harmonics.shape)
    size[moves] = np.abs(harmonics[moves]) / np.abs(harmonics[moves, 1:2])
    # points that did not settle say nothing of the noise
    last = np.median(size[moves, -2:], axis=0)
    noise = float(last.min()) if size.shape[1] > _FEWEST_FOR_NOISE else 0.0
    kept = size > NOISE_LIMIT_SIGMAS * noise
    kept[:, 1] = True
    return Motion(surface.omega, np.where(kept, harmonics, 0))


def measured_loops(surface: ResponseSurface, rows: NDArray[np.intp], mass: float) -> MeasuredLoops:
    """Draw the restoring force along measured motions.

    Parameters
    ----------
    surface
        Without background.
    rows
        (n,) points of it.
    mass
        m [kg].
    """
    chosen = surface.select(rows)
    motion = _above_noise(surface).select(rows)
    force = mass * (motion.omega[:, None] * motion.orders) ** 2 * motion.harmonics
    force[:, 1] += chosen.force
    sampled = Motion(motion.omega, force).waveforms(SAMPLES)[0]
    return MeasuredLoops(motion, motion.waveforms(SAMPLES)[0], sampled)


def loop_force(model: Model, values: Mapping[str, float], motion: Motion) -> Array:
    """(n, s) force of a model along n motions [N]; NaN where its loop does not close."""
    law = compile_law(model.force)
    return law.along(motion, law.ordered(values), SAMPLES).force


def branch_mean(displacement: Array, force: Array) -> tuple[Array, Array] | None:
    """Return the mean of the rising and the falling branch of one loop (s,): its part without memory.

    Returns
    -------
    tuple of arrays or None
        Displacements [m], ascending, and forces [N]; None where the motion turns more than twice.
    """
    rising = np.roll(displacement, -1) >= displacement
    if np.count_nonzero(rising != np.roll(rising, 1)) != 2:
        return None
    low, high = int(np.argmin(displacement)), int(np.argmax(displacement))
    place = np.linspace(displacement[low], displacement[high], 2 * 64 + 1)
    branches = []
    for start, stop in ((low, high), (high, low)):
        path = (start + np.arange((stop - start) % len(displacement) + 1)) % len(displacement)
        path = path if start == low else path[::-1]
        branches.append(np.interp(place, displacement[path], force[path]))
    return place, (branches[0] + branches[1]) / 2


@dataclass(frozen=True, slots=True, eq=False)
class Energy:
    """Energy dissipated in a cycle over amplitude, and the exponent of its growth.

    Parameters
    ----------
    amplitude, energy
        (n,) X [m] and D [J], ascending in X.
    exponent
        Slope of log D over log X, by least squares; NaN where it is not known.
    error
        Standard error of the exponent; NaN where it is not known.
    """

    amplitude: Array
    energy: Array
    exponent: float
    error: float

    @property
    def course(self) -> Array:
        """(n,) local slope of log D over log X."""
        return np.asarray(np.gradient(np.log(self.energy), np.log(self.amplitude)))


def _fitted(amplitude: Array, energy: Array) -> Energy:
    order = np.argsort(amplitude, kind="stable")
    amplitude, energy = amplitude[order], energy[order]
    # as many distinct places as a line and its error need
    if len(np.unique(amplitude)) < 3:
        return Energy(amplitude, energy, float("nan"), float("nan"))
    place = np.log(amplitude) - np.log(amplitude).mean()
    height = np.log(energy)
    spread = float(place @ place)
    exponent = float(place @ height) / spread
    rest = height - height.mean() - exponent * place
    error = float(np.sqrt(rest @ rest / (len(place) - 2) / spread))
    return Energy(amplitude, energy, exponent, error)


def measured_energy(surface: ResponseSurface) -> Energy:
    """Return D = pi |F| |X| sin(phase) of the points between the half-power points of their levels.

    Parameters
    ----------
    surface
        Without background.
    """
    used = surface.settled & (surface.amplitude > 0) & (np.sin(surface.phase) >= _HALF_POWER)
    work = cycle_work(surface.force[used], surface.harmonics[used, 1])
    return _fitted(surface.amplitude[used], work)


def dissipated_energy(identification: Identification, values: Mapping[str, float] | None = None) -> Energy:
    """Return D(X) = pi omega c(X, omega) X^2 along the resonance of a model, over the tested amplitudes.

    Parameters
    ----------
    identification
        Its model and its tested range.
    values
        Every parameter of the laws, SI; None: the refined ones.
    """
    tested = amplitudes_tested(identification)
    none = np.zeros(0)
    if not tested.size or tested[0] == tested[-1]:
        return _fitted(none, none)
    grid = np.geomspace(tested[0], tested[-1], len(tested))
    found = backbone(identification, solution_of(identification) if values is None else values, grid)
    energy = np.pi * found.omega * found.damping * grid**2
    known = np.isfinite(energy) & (energy > 0)
    return _fitted(grid[known], energy[known])


def small_stiffness(identification: Identification, values: Mapping[str, float]) -> float:
    """Return k(0) [N/m], the stiffness for small amplitudes; NaN where there is none or it is infinite."""
    tested = amplitudes_tested(identification, 2)
    if not tested.size:
        return float("nan")
    amplitude = tested[0] * np.array(_AT_REST)
    omega = np.full(2, 2 * np.pi * float(np.median(identification.curve.frequency)))
    used = {name: values[name] for name in identification.model.parameters}
    with np.errstate(all="ignore"):
        result = evaluated(derive(identification.model.force), amplitude, omega, used)
    near, far = np.broadcast_to(np.asarray(result.stiffness, dtype=np.float64), (2,))
    settled = np.isfinite(near) and near > 0 and abs(far / near - 1) <= MISFIT_NEGLIGIBLE
    return float(near) if settled else float("nan")


def stiffness_ratio(
    identification: Identification, values: Mapping[str, float] | None = None
) -> tuple[Array, Array]:
    """Return amplitudes [m] and k(X)/k(0) along the resonance of a model; NaN where k(0) is not known."""
    values = solution_of(identification) if values is None else values
    grid = amplitudes_tested(identification)
    return grid, backbone(identification, values, grid).stiffness / small_stiffness(identification, values)
