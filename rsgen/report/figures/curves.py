"""Resonance, equivalent stiffness and damping over amplitude, and the collapse of all points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import sympy
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from rsgen.common.arrays import Array
from rsgen.common.tolerances import CONFIDENCE_TEXT
from rsgen.formula import symbol
from rsgen.formula.names import remembers
from rsgen.formula.units import Scale, choose_scale
from rsgen.identification.modal_result import MODAL_COLUMNS, ModalTable
from rsgen.identification.results import EquivalentCurve, Identification
from rsgen.report.figures.drawing import (
    FIRST_ORDER,
    POINT,
    POINTS,
    REFINED,
    TRUTH,
    Drawing,
    GivenAxes,
    colour_bar,
    in_style,
    label_abscissa,
    level_colours,
    take_axes,
)
from rsgen.report.figures.equivalent import (
    Backbone,
    amplitudes_tested,
    backbone,
    calm_limits,
    refined_band,
    solution_of,
    values_of,
)

# ----------------------------------------------------------------------------
# The modal table as a figure: resonance frequency and damping over the amplitude, without a law.


_LABELS = {
    "frequency": "Resonance frequency",
    "damping_ratio": "Damping ratio",
    "damping": "Damping c",
}
"""Panels: damping ratio where it is known, else the damping itself."""


@in_style
def draw_modal(
    table: ModalTable, identification: Identification | None = None, *, ax: GivenAxes = None
) -> Drawing:
    """Draw resonance frequency and damping ratio over the amplitude, with 95 % bands.

    Parameters
    ----------
    table
        From ``rsgen.modal_table``; no law is in it.
    identification
        Its refined model is drawn over it: a law that is right lies within the bands.
    ax
        Axes for frequency and damping; None makes a figure.
    """
    grid = np.geomspace(table.amplitude[0], table.amplitude[-1], POINTS if len(table) > 1 else 1)
    fine = table.at(grid)
    names = ["frequency", "damping_ratio" if "damping_ratio" in table.known else "damping"]
    names = [name for name in names if name in table.known]
    figure, panels = take_axes(ax, len(names), (4.4, 1.95 * len(names)), sharex=True)
    x = choose_scale(grid, "m")
    model = None
    if identification is not None and len(grid) > 1:
        model = backbone(identification, solution_of(identification), grid)
    for axes, name in zip(panels, names, strict=False):
        value, low, high = (getattr(fine, f"{name}{end}") for end in ("", "_lower", "_upper"))
        unit = MODAL_COLUMNS[name]
        scale = choose_scale(value, unit) if unit else Scale(0.01, "%")
        factor = scale.factor
        axes.fill_between(grid / x.factor, low / factor, high / factor, color="#0072B2", alpha=0.2, lw=0)
        axes.plot(
            grid / x.factor,
            value / factor,
            color=POINT["mec"],
            lw=1.3,
            label=f"without a law, {CONFIDENCE_TEXT} band",
        )
        shown = [value / factor]
        if model is not None:
            line = getattr(model, name) / factor
            shown.append(line)
            axes.plot(
                grid / x.factor, line, label="refined model", **{**REFINED, "lw": 1.1, "ls": (0, (5, 2))}
            )
        calm_limits(axes, shown, least=0.01 if name == "frequency" else 0.2)
        axes.set_ylabel(scale.label(_LABELS[name]))
    label_abscissa(panels, ax, x.label("Amplitude X"))
    panels[0].legend(loc="best")
    caption = (
        "Modal table: what the points near resonance say of the mode at each amplitude, whatever the law."
    )
    return Drawing("modal", figure, caption, ax is None)


def _say_empty(axes: Axes, drawn: Sequence[Array]) -> None:
    """Say in an empty panel that nothing is known."""
    if not any(np.isfinite(values).any() for values in drawn):
        axes.text(0.5, 0.5, "not known", ha="center", va="center", transform=axes.transAxes)


@in_style
def draw_resonance(identification: Identification, *, ax: GivenAxes = None) -> Drawing:
    """Draw resonance frequency and damping ratio of every level against amplitude, and the refined model.

    Parameters
    ----------
    identification
        Its resonances are the points, its refined estimates the line. A law that acts across two sensors has
        no line: what the motion across is at an amplitude of the response is not known.
    ax
        Axes for frequency and damping ratio; None makes a figure.
    """
    points = sorted(identification.resonances, key=lambda point: point.amplitude)
    amplitude = np.array([point.amplitude for point in points])
    frequency = np.array([point.frequency for point in points])
    ratio = np.array([point.damping_ratio for point in points])
    figure, panels = take_axes(ax, 2, (4.4, 3.9), sharex=True)
    scale = choose_scale(amplitude, "m")
    grid = amplitudes_tested(identification)
    if identification.model.sensors:
        grid = grid[:0]
    if len(amplitude) > 1:
        # on the flanks below the resonances the damping ratio of friction leaves any axes
        grid = grid[(grid >= amplitude[0]) & (grid <= amplitude[-1])]
    model = backbone(identification, solution_of(identification), grid)
    parts = (
        ("Resonance frequency [Hz]", frequency, model.frequency, [frequency, model.frequency], 0.01),
        ("Damping ratio [%]", 100 * ratio, 100 * model.damping_ratio, [100 * ratio], 0.2),
    )
    for axes, (label, read, line, limits, least) in zip(panels, parts, strict=False):
        axes.plot(amplitude / scale.factor, read, label="one level each", **POINT)
        if np.isfinite(line).any():
            axes.plot(grid / scale.factor, line, label="refined model", **REFINED)
        calm_limits(axes, limits, least=least)
        axes.set_ylabel(label)
        _say_empty(axes, [read, line])
    label_abscissa(panels, ax, scale.label("Amplitude X"))
    panels[0].legend(loc="best")
    caption = "Resonance of each level: the shift with amplitude is what identification reads."
    return Drawing("resonance", figure, caption, ax is None)


@in_style
def draw_stiffness(
    identification: Identification, truth: Mapping[str, float] | None = None, *, ax: GivenAxes = None
) -> Drawing:
    """Draw the equivalent stiffness k(X): levels, fits, and the derivation with the true values where known.

    Parameters
    ----------
    identification
        Points and estimates.
    truth
        True value of every parameter, SI; "m" may be among them.
    ax
        Axes to draw on; None makes a figure.
    """
    return _draw_equivalent("stiffness", identification, truth, ax)


@in_style
def draw_damping(
    identification: Identification, truth: Mapping[str, float] | None = None, *, ax: GivenAxes = None
) -> Drawing:
    """Draw the equivalent damping c(X) along the resonance; see `draw_stiffness`."""
    return _draw_equivalent("damping", identification, truth, ax)


_KINDS = {
    "stiffness": ("Spring", "N/m", "k(X)"),
    "damping": ("Damper", "N*s/m", "c(X)"),
    "loss stiffness": ("Joint", "N/m", "ωc(X)"),
}
"""Name, unit and symbol of each equivalent property."""

_LEVELS = {"N": "Level F", "m": "Level X"}
"""Name of levels by their unit; those of a base are levels."""


def _draw_equivalent(
    what: Literal["stiffness", "damping"],
    identification: Identification,
    truth: Mapping[str, float] | None,
    ax: GivenAxes,
) -> Drawing:
    name, unit, symbol = _KINDS[what]
    points = sorted(identification.resonances, key=lambda point: point.amplitude)
    amplitude = np.array([point.amplitude for point in points])
    measured = np.array([getattr(point, what) for point in points])
    grid = amplitudes_tested(identification)
    model, *halves = refined_band(identification, grid)
    half = halves[list(_KINDS).index(what)]
    refined: Array = getattr(model, what)
    first: Array = getattr(backbone(identification, values_of(identification.first_order), grid), what)
    lines = [refined, first]
    x, y = (
        choose_scale(grid, "m"),
        choose_scale(np.concatenate([measured, refined]), identification.curve.units.of(unit)),
    )
    figure, (axes,) = take_axes(ax, 1, (4.4, 3.3))
    low, high = (refined - half) / y.factor, (refined + half) / y.factor
    axes.fill_between(grid / x.factor, low, high, color="#D55E00", alpha=0.18, lw=0)
    axes.plot(amplitude / x.factor, measured / y.factor, label="levels at resonance", **POINT)
    if np.isfinite(first).any():
        axes.plot(grid / x.factor, first / y.factor, label="first-order fit, all points", **FIRST_ORDER)
    axes.plot(grid / x.factor, refined / y.factor, label=f"refined fit, {CONFIDENCE_TEXT} band", **REFINED)
    if truth is not None:
        true: Array = getattr(backbone(identification, truth, grid), what)
        lines.append(true)
        axes.plot(grid / x.factor, true / y.factor, label=f"derived {symbol}, true values", **TRUTH)
    calm_limits(axes, [measured / y.factor, *(line / y.factor for line in lines)], least=0.06)
    axes.set_xlabel(x.label("Amplitude X"))
    axes.set_ylabel(y.label(f"Equivalent {what} {symbol}"))
    axes.legend(loc="best")
    caption = f"{name}: equivalent {what}; points as read at resonance, lines as fitted and derived."
    return Drawing(what, figure, caption, ax is None)


@dataclass(frozen=True, slots=True, eq=False)
class _Collapse:
    """Points (``place``, ``cloud``) and the ``line`` of the model over ``course``, SI."""

    what: str
    cloud: Array
    line: Array
    place: Array
    course: Array
    scale: Scale


@in_style
def draw_collapse(identification: Identification, *, ax: GivenAxes = None) -> Drawing:
    """Draw every test point as equivalent stiffness and damping: with the right law they fall on one curve.

    Parameters
    ----------
    identification
        Its curve gives the points, coloured by level; its refined estimates the line.
    ax
        One axes for the stiffness, or two for stiffness and damping; None makes a figure.
    """
    curve = identification.curve
    grid = amplitudes_tested(identification)
    model = backbone(identification, solution_of(identification), grid)
    x = choose_scale(curve.amplitude, "m")
    force = choose_scale(curve.level, curve.level_unit)
    colours = level_colours()
    norm = Normalize(0, float(np.max(curve.level, initial=0.0)) / force.factor or 1.0)
    # a damper that acts on the velocity alone has one curve over its amplitude omega X, and none over X
    joint = remembers(identification.model.force)
    speed = not joint and _acts_on_velocity(identification.model.force)
    figure, panels = take_axes(ax, 2, (4.4, 4.6), sharex=not speed)
    rate = choose_scale(curve.amplitude * 2 * np.pi * curve.frequency, "m/s")
    parts = _collapses(curve, model, grid, (x, rate), joint=joint, speed=speed)
    for axes, part, least in zip(panels, parts, (0.06, 0.2), strict=False):
        y = choose_scale(part.line if part.line.size else part.cloud, curve.units.of(_KINDS[part.what][1]))
        cloud, line = part.cloud / y.factor, part.line / y.factor
        axes.scatter(
            part.place / part.scale.factor,
            cloud,
            c=curve.level / force.factor,
            cmap=colours,
            norm=norm,
            s=7,
            linewidths=0,
            rasterized=len(cloud) > 300,
        )
        course = part.course / part.scale.factor
        axes.plot(course, line, label="refined model at resonance", **{**REFINED, "lw": 1.1})
        calm_limits(axes, [cloud, line], least=least)
        _say_empty(axes, [cloud, line])
        axes.set_ylabel(y.label(f"{part.what.capitalize()} {_KINDS[part.what][2].removesuffix('(X)')}"))
    panels[0].legend(loc="best")
    if speed or len(panels) == 1:
        panels[0].set_xlabel(x.label("Amplitude X"))
    for axes in panels[1:]:
        axes.set_xlabel(rate.label("Velocity amplitude ωX") if speed else x.label("Amplitude X"))
    colour_bar(figure, panels, norm, force.label(_LEVELS.get(curve.level_unit, "Level")), 35)
    caption = (
        "Every test point, coloured by level: with the right law all fall on one curve, but for what the "
        "higher harmonics add."
    )
    if any(f.code == "not-recorded" and f.names["signal"] == "phase" for f in identification.findings):
        caption += " Phases were not recorded: each point has the one that the identified law predicts."
    return Drawing("collapse", figure, caption, ax is None)


def _collapses(
    curve: EquivalentCurve,
    model: Backbone,
    grid: Array,
    scales: tuple[Scale, Scale],
    *,
    joint: bool,
    speed: bool,
) -> tuple[_Collapse, _Collapse]:
    """Return the values of one curve: k over X; and of a joint omega c, of a drag c over omega X, else c."""
    x, rate = scales
    omega = 2 * np.pi * curve.frequency
    stiffness = _Collapse("stiffness", curve.stiffness, model.stiffness, curve.amplitude, grid, x)
    if joint:
        loss, line = curve.damping * omega, model.damping * model.omega
        return stiffness, _Collapse("loss stiffness", loss, line, curve.amplitude, grid, x)
    if speed:
        velocity, course = curve.amplitude * omega, grid * model.omega
        return stiffness, _Collapse("damping", curve.damping, model.damping, velocity, course, rate)
    return stiffness, _Collapse("damping", curve.damping, model.damping, curve.amplitude, grid, x)


def _acts_on_velocity(force: sympy.Expr) -> bool:
    """Find whether the force has a part that is not linear in v and does not depend on x."""
    v = symbol("v")
    damper = force - force.subs(v, 0)
    # evaluated as text is enough: an x that would cancel leaves the axis as it is
    if damper.has(symbol("x")):
        damper = sympy.expand(damper)
    return not damper.has(symbol("x")) and sympy.diff(damper, v, 2) != 0
