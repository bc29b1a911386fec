"""Numbers that figures draw: stiffness and damping over the amplitude, loops and energy; picture of a law."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import sympy
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import MISFIT_NEGLIGIBLE, NOISE_LIMIT_SIGMAS, POINTS_PER_KNOT, interval_sigmas
from rsgen.data.free_mode import estimate_mass, steady
from rsgen.data.oscillator import Model
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.describing.derivation import derive
from rsgen.describing.function import DescribingFunction, Equivalent
from rsgen.formula.names import remembers, symbol
from rsgen.formula.units import choose_scale, number_text
from rsgen.identification.prediction.amplitude_balance import balance_of
from rsgen.identification.results import Identification, MultisineIdentification, changed
from rsgen.law.memory import with_equations
from rsgen.law.motion import Motion, cycle_work, project
from rsgen.law.numeric import compile_law
from rsgen.report.figures.drawing import BLUE, POINTS, REFINED, Drawing, GivenAxes, in_style, take_axes


@dataclass(frozen=True, slots=True, eq=False)
class Backbone:
    """Equivalent properties along the resonance of a model; every array (n,).

    ``amplitude`` X [m], ``omega`` [rad/s], ``stiffness`` [N/m], ``damping`` [N s/m]; ``harmonics`` (n, K+1)
    [m] of the motions, None to first order.
    """

    amplitude: Array
    omega: Array
    stiffness: Array
    damping: Array
    mass: float
    harmonics: ComplexArray | None = None

    @property
    def frequency(self) -> Array:
        """(n,) resonance frequency [Hz]."""
        return self.omega / (2 * np.pi)

    @property
    def damping_ratio(self) -> Array:
        """(n,) c / (2 m omega_n) [1]."""
        return np.asarray(self.damping / (2 * self.mass * self.omega), dtype=np.float64)


def amplitudes_tested(identification: Identification, points: int = 160) -> Array:
    """Return amplitudes [m] that cover what was tested, none outside."""
    amplitude = identification.curve.amplitude
    amplitude = amplitude[np.isfinite(amplitude) & (amplitude > 0)]
    if not amplitude.size:
        return np.empty(0)
    low, high = float(amplitude.min()), float(amplitude.max())
    # breakpoints and friction show at small amplitudes: half of the points are spread by ratio
    return np.unique(
        np.concatenate([np.linspace(low, high, points // 2), np.geomspace(low, high, points // 2)])
    )


def solution_of(identification: Identification) -> dict[str, float]:
    """Return the refined values; where one is not identifiable, the value of the fit.

    The curve over what was tested is known also where single parameters are not.
    """
    names = sorted(identification.model.parameters)
    fitted = dict(zip(names, identification.solution.tolist(), strict=True))
    return {
        one.name: one.value if np.isfinite(one.value) else fitted.get(one.name, one.value)
        for one in (*identification.refined, *identification.fixed)
    }


def evaluated(
    law: DescribingFunction,
    amplitude: Array,
    omega: Array,
    values: Mapping[str, float],
    mean: Array | None = None,
) -> Equivalent:
    """Evaluate a describing function; NaN where the loop of a state does not close.

    Values that were fitted may be such; those of a case file were tried before. Figures and sentences of one
    report ask for the same loops many times.
    """
    rows = (amplitude, omega) if mean is None else (amplitude, omega, mean)
    return _evaluated(law, tuple(values.items()), len(amplitude), *(row.tobytes() for row in rows))


@lru_cache(maxsize=64)
def _evaluated(
    law: DescribingFunction, values: tuple[tuple[str, float], ...], count: int, *rows: bytes
) -> Equivalent:
    amplitude, omega, *mean = (np.frombuffer(row, dtype=np.float64, count=count) for row in rows)
    return law.evaluate(amplitude, omega, dict(values), *mean, closing=False)


def backbone(identification: Identification, values: Mapping[str, float], amplitude: Array) -> Backbone:
    """Evaluate the describing functions at m omega^2 = k(X), where the levels have their resonance.

    Parameters
    ----------
    identification
        Its model has the laws; its mass is used where ``values`` has no "m".
    values
        Every parameter of the laws, SI. A value that is not finite makes the result NaN.
    amplitude
        (n,) X [m], positive.
    """
    mass = values.get("m", identification.mass)
    missing = [name for name in identification.model.parameters if name not in values]
    if missing:
        raise RsgenError(f"truth: no value of {', '.join(missing)}; every parameter of the laws is needed")
    used = {name: values[name] for name in identification.model.parameters}
    unknown = np.full(amplitude.shape, np.nan)
    if not (amplitude.size and np.isfinite([mass, *used.values()]).all()):
        return Backbone(amplitude, unknown, unknown, unknown, mass)
    law = derive(identification.model.force)
    omega = np.full(amplitude.shape, 2 * np.pi * float(np.nanmedian(identification.curve.frequency)))
    for _ in range(3):  # the stiffness of most laws does not depend on omega: the first round is final
        result = evaluated(law, amplitude, omega, used)
        stiffness = result.stiffness
        update = np.sqrt(np.where((stiffness > 0) & (mass > 0), stiffness, np.nan) / mass)
        done = bool(np.allclose(update, omega, rtol=1e-9, equal_nan=True))
        omega = np.where(np.isfinite(update), update, omega)
        if done:
            break
    return Backbone(amplitude, omega, stiffness, result.damping, mass)


def backbone_with_harmonics(
    identification: Identification, amplitude: Array, values: Mapping[str, float] | None = None
) -> Backbone:
    """Return the backbone of the refined law, or of ``values``, with harmonics, as the motion of points has.

    They are as many as a prediction takes (``AmplitudeBalance._order``).

    A multisine has no motion of one amplitude: its modal table is of sines, as the describing functions are.
    Nor has a motion across two sensors that was not measured.
    """
    values = solution_of(identification) if values is None else values
    found, multisine = backbone(identification, values, amplitude), MultisineIdentification
    one_motion = not (isinstance(identification, multisine) or identification.model.sensors)
    if not (one_motion and np.isfinite(found.omega).all()):
        return found
    names = sorted(identification.model.parameters)
    solution = np.array([values[name] for name in names])
    balance, harmonics = balance_of(changed(identification, solution=solution)), None
    for _ in range(2):  # as above
        stiffness, damping, harmonics = balance.equivalent(amplitude, found.omega, harmonics)
        with np.errstate(invalid="ignore"):
            omega = np.sqrt(stiffness / found.mass)
        found = replace(found, omega=omega, stiffness=stiffness, damping=damping, harmonics=harmonics)
    return found


def smooth_backbone(
    identification: Identification, amplitude: Array, values: Mapping[str, float] | None = None
) -> Backbone:
    """Return ``backbone_with_harmonics``; to first order of a law that jumps or remembers.

    At small amplitudes such a law holds the mass for a part of the cycle at resonance, and off it, where the
    points of such amplitudes lie, it does not.
    """
    law = compile_law(identification.model.force)
    if not (law.jumps or law.remembers):
        return backbone_with_harmonics(identification, amplitude, values)
    return backbone(identification, solution_of(identification) if values is None else values, amplitude)


def share_along(force: sympy.Expr, values: Mapping[str, float], of: Backbone) -> Equivalent | None:
    """Return the share of a part of the law in a backbone with harmonics; None of one to first order."""
    if of.harmonics is None:
        return None
    law, motion = compile_law(force), Motion(of.omega, of.harmonics)
    share = project(law.along(motion, law.ordered(values), SAMPLES).force, 1) / of.amplitude
    return Equivalent(share.real, share.imag / of.omega, of.harmonics[:, 0].real)


def refined_band(identification: Identification, amplitude: Array) -> tuple[Backbone, Array, Array]:
    """Return the backbone of the refined model and half the 95 % bands of stiffness and damping.

    The covariance of the law's parameters is propagated linearly; a derivative is the difference over one
    standard error. The line is ``smooth_backbone``; the bands are those of the first order.
    """

    def evaluate(values: Mapping[str, float]) -> tuple[Backbone, Array]:
        model = backbone(identification, values, amplitude)
        return model, np.array([model.stiffness, model.damping])

    values, covariance = solution_of(identification), identification.covariance
    centre, model = evaluate(values)[1], smooth_backbone(identification, amplitude)
    count = len(identification.refined)
    if covariance.shape != (count, count):
        return model, *np.zeros(centre.shape)
    law = [(row, one) for row, one in enumerate(identification.refined) if one.name != "m"]
    if any(np.isinf(one.standard_error) and one.identifiable for _, one in law):
        # a fit that did not converge has no errors
        return model, *np.full(centre.shape, np.nan)
    moving = [(row, one) for row, one in law if np.isfinite(one.standard_error) and one.standard_error > 0]
    slopes = np.zeros((len(moving), *centre.shape))
    for slope, (_, one) in zip(slopes, moving, strict=True):
        _, moved = evaluate({**values, one.name: values[one.name] + one.standard_error})
        slope[...] = (moved - centre) / one.standard_error
    index = [row for row, _ in moving]
    variance = np.einsum("i...,ij,j...->...", slopes, covariance[np.ix_(index, index)], slopes)
    stiffness, damping = interval_sigmas() * np.sqrt(np.maximum(variance, 0.0))
    return model, stiffness, damping


def calm_limits(axes: Axes, values: Iterable[Array], least: float = 0.1) -> None:
    """Choose y limits that show change where there is some and no noise where there is none.

    The axis spans at least ``least`` of the largest value, so that a constant looks constant; outliers
    beyond the central 98 % of a cloud of over 50 points may leave the picture.
    """
    lows, highs = [], []
    for cloud in values:
        finite = cloud[np.isfinite(cloud)]
        if finite.size > 50:
            lows.append(float(np.percentile(finite, 1)))
            highs.append(float(np.percentile(finite, 99)))
        elif finite.size:
            lows.append(float(finite.min()))
            highs.append(float(finite.max()))
    if not lows:
        return
    low, high = min(lows), max(highs)
    span = max(high - low, least * max(abs(low), abs(high)), 1e-300)
    middle = (low + high) / 2
    axes.set_ylim(middle - 0.58 * span, middle + 0.58 * span)


# ----------------------------------------------------------------------------
# Loops of the restoring force, as measured and as identified, and the energy that they dissipate.
#
# A measured loop needs no law: along the measured motion n(t) = f(t) - m a(t), harmonic by harmonic
# n_h = F_h + m (h omega)^2 X_h. The energy of a cycle is pi Im(F conj X) [J], by the fundamental alone, for
# the force has no other harmonic.

SAMPLES = 512
"""Of a loop: no corner of it can be seen."""

_FEWEST_FOR_NOISE = 4
"""Harmonics from which on the last two are a measure of the noise: of fewer both may be signal."""

_MAX_STEPS_TO_MEAN = 20
"""Each leaves the share by which the stiffness at the mean differs from that between the turning points."""

_HALF_POWER = float(np.sqrt(0.5))
"""Least sine of the phase: between the half-power points an error of the phase changes the energy little."""


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
    """Return the surface without background, its forces with a mass that was given."""
    if identification is None:
        return surface
    if np.isfinite(identification.curve.units.kilogram):
        surface = surface.on_mass(identification.mass)
    background = identification.background
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
    """Take the harmonics of every motion above the noise, the smaller one of the last two recorded."""
    harmonics = np.nan_to_num(surface.harmonics)
    moves = harmonics[:, 1] != 0
    size: Array = np.zeros(harmonics.shape)
    size[moves] = np.abs(harmonics[moves]) / np.abs(harmonics[moves, 1:2])
    # points that did not settle say nothing of the noise
    recorded = np.flatnonzero(np.isfinite(surface.harmonics).any(axis=0))
    last = np.median(size[np.ix_(moves, recorded[-2:])], axis=0)
    noise = float(last.min()) if len(recorded) > _FEWEST_FOR_NOISE else 0.0
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
    """(n, s) force of a model along n motions [N]; NaN where its loop does not close.

    A mean displacement that was not measured (all are 0) is the one at which the force has no mean, as a
    measured loop has none: by steps with the stiffness between the turning points.
    """
    law = compile_law(model.force)
    point, harmonics = law.ordered(values), np.array(motion.harmonics)
    force = law.along(motion, point, SAMPLES).force
    for _ in range(0 if harmonics[:, 0].any() else _MAX_STEPS_TO_MEAN):
        mean, span = np.nan_to_num(force.mean(axis=1)), np.ptp(force, axis=1)
        off = np.abs(mean) > MISFIT_NEGLIGIBLE * span
        if not off.any():
            break
        harmonics[off, 0] -= (mean / span * np.ptp(motion.waveforms(SAMPLES)[0], axis=1))[off]
        force = law.along(replace(motion, harmonics=harmonics), point, SAMPLES).force
    return force


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
    """Return D(X) = pi omega c(X, omega) X^2 along the ``smooth_backbone``, over the tested amplitudes.

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
    found = smooth_backbone(identification, grid, values)
    energy = np.pi * found.omega * found.damping * grid**2
    known = np.isfinite(energy) & (energy > 0)
    return _fitted(grid[known], energy[known])


# ----------------------------------------------------------------------------
# The picture of a law: the force over a cycle, k(X) and c(X).

SHADES = ((0.3, "#8fb8d8"), (0.6, "#4a8ec2"), (1.0, BLUE))
"""Amplitudes of the cycles drawn, in parts of the largest, and their colours."""


@in_style
def draw_derivation(
    function: DescribingFunction,
    values: Mapping[str, float] | None = None,
    omega: float = 1.0,
    largest: float = 3.0,
    *,
    ax: GivenAxes = None,
) -> Drawing:
    """Draw a law and its equivalent stiffness and damping over amplitude.

    Parameters
    ----------
    function
        What was derived.
    values
        Parameters, SI; those that are missing are taken as 1. The caption says all.
    omega
        Angular frequency [rad/s].
    largest
        Largest amplitude [m]; the default shows how most laws change whose parameters are all 1.
    ax
        Axes for the law, and for stiffness, damping and mean as far as there are any; None makes a figure.
    """
    numbers = {name: (values or {}).get(name, 1.0) for name in function.parameters}
    X = np.linspace(largest / POINTS, largest, POINTS)
    found = function.evaluate(X, omega, numbers)
    curves = [
        ("Equivalent stiffness k", found.stiffness, "N/m"),
        ("Equivalent damping c", found.damping, "N*s/m"),
        ("Mean X0", found.mean, "m"),
    ]
    if function.remembered:
        curves.insert(2, ("Energy of a cycle D", np.pi * omega * X**2 * found.damping, "J"))
    shown = [c for c in curves if np.any(c[1] != 0) and np.any(np.isfinite(c[1]))] or curves[:1]
    figure, (law, *panels) = take_axes(ax, 1 + len(shown), (4.6, 2.3 * (1 + len(shown))))
    _draw_law(law, function, numbers, omega, largest, found.mean[-1])
    scale = choose_scale(X, "m")
    for axes, (what, curve, unit) in zip(panels, shown, strict=False):
        y = choose_scale(np.percentile(np.abs(curve[np.isfinite(curve)]), 99), unit)
        axes.plot(X / scale.factor, curve / y.factor, **REFINED)
        calm_limits(axes, [curve / y.factor])
        axes.set_ylabel(y.label(what))
        axes.set_xlim(0, largest / scale.factor)
    for axes in panels[-1:]:
        axes.set_xlabel(scale.label("Amplitude X"))
    said = [f"{name} = {number_text(number)}" for name, number in (numbers | {"omega": omega}).items()]
    caption = (
        f"The force {with_equations(function.force)}, and what it is to the fundamental of a vibration of "
        f"amplitude X; SI: {', '.join(said)}."
    )
    return Drawing("derivation", figure, caption, ax is None)


def _draw_law(
    axes: Axes,
    function: DescribingFunction,
    numbers: Mapping[str, float],
    omega: float,
    top: float,
    mean: float,
) -> None:
    """Draw the force along cycles: over displacement where it depends on it, otherwise over velocity."""
    x, v = symbol("x"), symbol("v")
    # along states every phase is an integration of its own
    phi = np.linspace(-np.pi / 2, 3 * np.pi / 2, POINTS if function.memory else 4 * POINTS)
    over_x = function.force.has(x) or not function.force.has(v) or bool(function.remembered)
    both = (function.force.has(x) and function.force.has(v)) or bool(function.remembered)
    middle = float(mean) if np.isfinite(mean) else 0.0
    span = top if over_x else omega * top
    place = choose_scale(span, "m" if over_x else "m/s")
    cycles = []
    for part, colour in SHADES if both else SHADES[-1:]:
        displacement = middle + part * top * np.sin(phi)
        velocity = omega * part * top * np.cos(phi)
        force = function.along(phi, part * top, omega, numbers, middle)
        cycles.append((displacement if over_x else velocity, force, colour))
    finite = [force[np.isfinite(force)] for _, force, _ in cycles]
    size = max((float(np.abs(force).max()) for force in finite if force.size), default=0.0)
    y = choose_scale(size, "N")
    for along, force, colour in cycles:
        axes.plot(along / place.factor, force / y.factor, color=colour, lw=1.3)
    axes.set_xlabel(place.label("Displacement x" if over_x else "Velocity v"))
    axes.set_ylabel(y.label("Force n"))
