"""Loops of the restoring force, and the energy that they dissipate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import CONFIDENCE_TEXT, RELATIVE_CHANGE_NEGLIGIBLE
from rsgen.data.surface.response_surface import ResponseSurface, choose_levels
from rsgen.formula.names import remembers
from rsgen.formula.units import choose_scale, count_text, number_text, quantity_text
from rsgen.identification.results import Identification
from rsgen.law.numeric import compile_law
from rsgen.report.figures import drawing, equivalent

# ----------------------------------------------------------------------------
# The forces themselves: what springs and dampers do at each displacement and velocity.

_WIDEST_BAND = 0.5
"""Half width of a band, relative to the largest force, beyond which a point says nothing about the law."""


@drawing.in_style
def draw_forces(
    identification: Identification, truth: Mapping[str, float] | None = None, *, ax: drawing.GivenAxes = None
) -> drawing.Drawing:
    """Draw the stiffness force n(x, 0) and the damping force n(0, v) - n(0, 0) over the tested range.

    Parameters
    ----------
    identification
        Its refined estimates give the lines; the nonparametric restoring force gives the points.
    truth
        True value of every parameter, SI.
    ax
        One axes for the stiffness force, or two for both forces; None makes a figure.
    """
    high, curve = identification.amplitude_range[1], identification.curve
    # the largest response is at a resonance, not where the band ends
    speeds = 2 * np.pi * (curve.amplitude * curve.frequency)[curve.used]
    fast = float(np.nanmax(speeds, initial=0.0)) or high * 2 * np.pi * identification.frequency_range[1]
    law, restoring, zero = compile_law(identification.model.force), identification.restoring, np.zeros(401)
    laws: dict[str, tuple[Mapping[str, float], dict[str, Any]]]
    laws = {"refined": (equivalent.solution_of(identification), drawing.REFINED)}
    laws |= {} if truth is None else {"truth": (truth, drawing.TRUTH)}
    figure, panels = drawing.take_axes(ax, 2, (4.4, 4.6))
    kinds = (("stiffness", "displacement", high, "m"), ("damping", "velocity", fast, "m/s"))
    for axes, (what, motion, end, unit) in zip(panels, kinds, strict=False):
        place, still = np.linspace(-end, end, 401), unit == "m"
        lines = []
        for name, (values, look) in laws.items():
            point = law.ordered(values)
            if still:
                force = law.force(place, zero, point)
            else:
                force = law.force(zero, place, point) - law.force(zero, zero, point)
            lines.append((name, force, look))
        columns = (motion, f"{what}_force", f"{what}_band")
        points = None if restoring is None else [getattr(restoring, name) for name in columns]
        x, y = choose_scale(place, unit), choose_scale(lines[0][1], curve.units.of("N"))
        _draw_force(axes, (x.factor, y.factor), place, lines, points)
        axes.set_xlabel(x.label("Displacement x" if still else "Velocity v"))
        axes.set_ylabel(y.label(f"{what.capitalize()} force"))
    caption = "Forces of springs and of dampers over the tested range"
    if restoring is not None:
        caption += f", and the nonparametric restoring force where known (points, {CONFIDENCE_TEXT} band): "
        caption += "read as of motions without higher harmonics; strong ones move the points off the lines"
    return drawing.Drawing("forces", figure, f"{caption}.", ax is None)


def _draw_force(
    axes: Axes,
    scale: tuple[float, float],
    place: Array,
    lines: Sequence[tuple[str, Array, Mapping[str, Any]]],
    points: Sequence[Array] | None,
) -> None:
    """Draw forces (n,) by name at ``place`` (n,), and places, forces and half bands of points."""
    across, height = scale
    shown = [force / height for _, force, _ in lines]
    if points is not None:
        # a band wider than the force itself determines nothing: near rest, and at rare amplitudes
        narrow = points[2] < _WIDEST_BAND * np.nanmax(np.abs(lines[0][1]), initial=0.0)
        # a spring at rest has no force, whatever the others are
        narrow &= np.count_nonzero(narrow) > 1
        at, force, band = (column[narrow] for column in points)
        at, low, high = at / across, (force - band) / height, (force + band) / height
        axes.fill_between(at, low, high, color=drawing.BLUE, alpha=0.18, lw=0)
        few = np.unique(np.linspace(0, max(len(at) - 1, 0), min(len(at), 16)).astype(int))
        axes.plot(at[few], force[few] / height, label="nonparametric" if len(at) else None, **drawing.POINT)
        # a band that is wide for want of data must not make the forces flat
        shown.append(force / height)
    for name, force, look in lines:
        axes.plot(place / across, force / height, label=name, **look)
    equivalent.calm_limits(axes, shown)
    axes.legend(loc="upper left")


_LOOPS = 3
"""Of small, middle and largest level: more of them hide each other."""

_MARKS = 32
"""Points of a measured loop that are marked."""

_FEW_DECADES = 300.0
"""Ratio of the ends of an axis up to which three numbers a decade fit on it."""

_MEMORYLESS: dict[str, Any] = {"color": drawing.BLUE, "lw": 0.9, "ls": (0, (5, 2))}


def _peak_rows(surface: ResponseSurface) -> NDArray[np.intp]:
    """Choose the largest settled motion of a small, a middle and the largest level."""
    rows, moving = [], surface.settled & np.isfinite(surface.phase) & (surface.amplitude > 0)
    for level in choose_levels(surface, _LOOPS):
        there = np.flatnonzero((surface.level == level) & moving)
        if there.size:
            rows.append(int(there[np.argmax(surface.amplitude[there])]))
    return np.array(sorted(set(rows), key=lambda row: surface.amplitude[row]), dtype=np.intp)


def _chord(x: Array, force: Array, *, loop: bool = True) -> Array:
    """Return the straight line through the turning points of a loop, each the mean of both branches.

    The samples next to a turn lie on one branch each; that of the turn, where friction jumps, on either. A
    line that is no ``loop`` has ends.
    """
    around = np.array([-1, 1]) * loop
    sides = [(at + around) % len(x) for at in (int(np.argmin(x)), int(np.argmax(x)))]
    (left, low), (right, high) = ((x[at].mean(), force[at].mean()) for at in sides)
    return np.asarray(low + (high - low) / (right - left) * (x - left))


@drawing.in_style
def draw_loops(
    surface: ResponseSurface,
    identification: Identification | None = None,
    truth: Mapping[str, float] | None = None,
    *,
    ax: drawing.GivenAxes = None,
) -> drawing.Drawing:
    """Draw the restoring force over the displacement, as measured and as identified.

    The measured loops need no law: n(t) = f(t) - m a(t) along the measured motion. The mean of their two
    branches is the part without memory. The lower panel leaves out the chord between the turning points.

    Parameters
    ----------
    surface
        The test.
    identification
        Gives mass and loops of the model along the same motions; None: the measured loops alone, with a mass
        that is read from the points, with any smooth k(X).
    truth
        True value of every parameter, SI.
    ax
        One axes for the loops, or two for the loops and their openings; None makes a figure.

    Raises
    ------
    RsgenError
        No point settled, the phases are not known, or too few points settled to read a mass.
    """
    surface = equivalent.mode_surface(surface, identification)
    rows = _peak_rows(surface)
    if not rows.size:
        raise RsgenError("surface: no settled point with a phase; a loop needs force and motion")
    mass = equivalent.mass_of(surface) if identification is None else identification.mass
    loops = equivalent.measured_loops(surface, rows, mass)
    lines = [] if identification is None else _model_loops(identification, truth, loops)
    figure, panels = drawing.take_axes(ax, 2, (4.4, 5.2), sharex=True)
    unit = surface.units.of("N")
    x, y = choose_scale(loops.displacement, "m"), choose_scale(loops.force, unit)
    open_y = choose_scale(loops.force[-1] - _chord(loops.displacement[-1], loops.force[-1]), unit)
    for axes, scale, chord in zip(panels, (y, open_y), (False, True), strict=False):
        for i, (place, force) in enumerate(zip(loops.displacement, loops.force, strict=True)):
            shown = [("measured", drawing.POINT, place, force)]
            mean = equivalent.branch_mean(place, force)
            if mean is not None:
                shown.append(("mean of both branches", _MEMORYLESS, *mean))
            shown += [(name, style, place, line[i]) for name, style, line in lines]
            for name, style, at, value in shown:
                _draw_loop(axes, name if i == 0 else "", style, at / x.factor, value, scale.factor, chord)
        axes.set_ylabel(scale.label("Force less its chord" if chord else "Restoring force n"))
    drawing.label_abscissa(panels, ax, x.label("Displacement x"))
    panels[0].legend(loc="upper left")
    caption = _loops_caption(surface, identification, loops, mass)
    return drawing.Drawing("loops", figure, caption, ax is None)


def _model_loops(
    identification: Identification, truth: Mapping[str, float] | None, loops: equivalent.MeasuredLoops
) -> list[tuple[str, dict[str, Any], Array]]:
    """Return name, style and force of the model along the measured motions, identified and true."""
    known = (
        ("identified", drawing.REFINED, equivalent.solution_of(identification)),
        ("truth", drawing.TRUTH, truth),
    )
    return [
        (name, style, equivalent.loop_force(identification.model, values, loops.motion))
        for name, style, values in known
        if values is not None
    ]


def _loops_caption(
    surface: ResponseSurface,
    identification: Identification | None,
    loops: equivalent.MeasuredLoops,
    mass: float,
) -> str:
    """Say whose loops they are, with which mass, and what was not measured of them."""
    where = f"the largest motion of {count_text(len(loops.displacement), 'level')}"
    if identification is None or np.isfinite(identification.curve.units.kilogram):
        where += f", with a mass of {quantity_text(mass, 'kg', 4)}"
    caption = f"Loops of the restoring force at {where}: an open loop dissipates."
    if surface.harmonics.shape[1] <= 2:
        caption += " Only the fundamental was measured, so measured loops are ellipses whatever the law."
    else:
        caption += f" Measured loops have {surface.harmonics.shape[1] - 1} harmonics, which round corners."
    harmonics = np.abs(loops.motion.harmonics)
    # without even harmonics the motion of an odd law has no mean
    even = harmonics[:, 2:3] > RELATIVE_CHANGE_NEGLIGIBLE * harmonics[:, 1:2]
    symmetric = identification is not None and compile_law(identification.model.force).odd and not even.any()
    if not (symmetric or harmonics[:, 0].any()):
        caption += " The mean displacement was not measured: displacements are counted from it."
    return caption


def _draw_loop(
    axes: Axes, name: str, style: dict[str, Any], place: Array, force: Array, factor: float, chord: bool
) -> None:
    drawn = (force - _chord(place, force, loop=style is not _MEMORYLESS) if chord else force) / factor
    if style is drawing.POINT:
        few = np.unique(np.linspace(0, len(place), _MARKS, endpoint=False).astype(int))
        axes.plot(place[few], drawn[few], label=name or "_", **drawing.POINT)
        return
    closed = (
        (place, drawn) if style is _MEMORYLESS else (np.append(place, place[:1]), np.append(drawn, drawn[:1]))
    )
    axes.plot(*closed, label=name or "_", **style)


@drawing.in_style
def draw_energy(
    surface: ResponseSurface,
    identification: Identification,
    truth: Mapping[str, float] | None = None,
    *,
    ax: drawing.GivenAxes = None,
) -> drawing.Drawing:
    """Draw the energy dissipated in a cycle over amplitude.

    Parameters
    ----------
    surface
        Its points near resonance give the measured energy.
    identification
        Its refined estimates give the lines.
    truth
        True value of every parameter, SI.
    ax
        Axes to draw on; None makes a figure.
    """
    measured = equivalent.measured_energy(equivalent.mode_surface(surface, identification))
    found = equivalent.dissipated_energy(identification)
    figure, (top,) = drawing.take_axes(ax, 1, (4.4, 3.3))
    x = choose_scale(found.amplitude if found.amplitude.size else measured.amplitude, "m")
    y = choose_scale(np.concatenate([measured.energy, found.energy]), identification.curve.units.of("J"))
    top.plot(measured.amplitude / x.factor, measured.energy / y.factor, label="measured", **drawing.POINT)
    top.plot(found.amplitude / x.factor, found.energy / y.factor, label="refined", **drawing.REFINED)
    if truth is not None:
        true = equivalent.dissipated_energy(identification, truth)
        top.plot(true.amplitude / x.factor, true.energy / y.factor, label="truth", **drawing.TRUTH)
    if measured.energy.size or found.energy.size:
        for axis, set_scale in ((top.xaxis, top.set_xscale), (top.yaxis, top.set_yscale)):
            set_scale("log")
            _plain_ticks(axis)
    top.set_ylabel(y.label("Energy of a cycle D"))
    top.set_xlabel(x.label("Amplitude X"))
    top.legend(loc="upper left")
    caption = "Energy of a cycle: its slope is near 2 for viscous and structural damping, 1 for dry friction"
    if remembers(identification.model.force):
        caption += ", 2.2 to 3 in micro-slip, 1 in macro-slip"
    return drawing.Drawing("energy", figure, caption + ".", ax is None)


def _plain_ticks(axis: Axis) -> None:
    """Numbers as everywhere in the figures, at 1, 2 and 5 of every decade where there are few decades."""
    low, high = axis.get_view_interval()
    few = high < _FEW_DECADES * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: number_text(value, 3)))
