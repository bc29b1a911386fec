"""Resonance, equivalent stiffness and damping over amplitude, and the collapse of all points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import sympy
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from rsgen.expression import symbol
from rsgen.figures.drawing import Drawing, GivenAxes, in_style, take_axes
from rsgen.figures.equivalent import (
    Backbone,
    amplitudes_tested,
    backbone,
    calm_limits,
    refined_band,
    solution_of,
    values_of,
)
from rsgen.figures.overview import level_colours
from rsgen.figures.scale import Scale, choose_scale, number_text, quantity_text
from rsgen.identification import Identification

__all__ = [
    "FIRST_ORDER",
    "POINT",
    "REFINED",
    "TRUTH",
    "draw_collapse",
    "draw_damping",
    "draw_resonance",
    "draw_stiffness",
]

# Okabe and Ito's colours, which colour-blind readers tell apart; line styles tell them apart in grey
POINT: dict[str, Any] = {"marker": "o", "ls": "none", "mfc": "none", "mec": "#0072B2", "mew": 1.1, "ms": 4.5}
REFINED: dict[str, Any] = {"color": "#D55E00", "lw": 1.5, "ls": "-"}
FIRST_ORDER: dict[str, Any] = {"color": "#009E73", "lw": 1.2, "ls": (0, (6, 1.5, 1, 1.5))}
TRUTH: dict[str, Any] = {"color": "#1b1c1e", "lw": 1.2, "ls": (0, (1, 1.6))}

Floats = NDArray[np.float64]


def _span(values: Floats, unit: str) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "not known"
    scale = choose_scale(finite, unit)
    return f"{number_text(finite[0] / scale.factor)} to {number_text(finite[-1] / scale.factor)} {scale.unit}"


def _plot(axes: Axes, x: Floats, y: Floats, style: Mapping[str, Any], label: str) -> None:
    axes.plot(x, y, label=label, **style)


@in_style
def draw_resonance(identification: Identification, *, ax: GivenAxes = None) -> Drawing:
    """Draw resonance frequency and damping ratio of every level against amplitude, and the refined model.

    Parameters
    ----------
    identification
        Its resonances are the points, its refined estimates the line.
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
    model = backbone(identification, solution_of(identification), grid)
    parts = (
        ("Resonance frequency [Hz]", frequency, model.frequency, [frequency, model.frequency], 0.01),
        ("Damping ratio [%]", 100 * ratio, 100 * model.damping_ratio, [100 * ratio], 0.2),
    )
    for axes, (label, read, line, limits, least) in zip(panels, parts, strict=False):
        _plot(axes, amplitude / scale.factor, read, POINT, "one level each")
        _plot(axes, grid / scale.factor, line, REFINED, "refined model")
        calm_limits(axes, limits, least=least)
        axes.set_ylabel(label)
    for axes in panels[-1:] if ax is None else panels:
        axes.set_xlabel(scale.label("Amplitude X"))
    panels[0].legend(loc="best")
    text = "No level has a resonance that could be read."
    if len(points) == 1:
        text = (
            f"One resonance: at the amplitude {quantity_text(amplitude[0], 'm', 3)} the resonance "
            f"frequency is {quantity_text(frequency[0], 'Hz')} and the damping ratio "
            f"{number_text(100 * ratio[0], 3)} %."
        )
    elif points:
        text = (
            f"{len(points)} resonances. From the smallest amplitude, "
            f"{quantity_text(amplitude[0], 'm', 3)}, to the largest, "
            f"{quantity_text(amplitude[-1], 'm', 3)}, the resonance frequency goes from "
            f"{_span(frequency, 'Hz')} "
            f"({100 * (frequency[-1] / frequency[0] - 1):+.2f} %) and the damping ratio from "
            f"{number_text(100 * ratio[0], 3)} to {number_text(100 * ratio[-1], 3)} %."
        )
    caption = "Resonance of each level: the shift with amplitude is what identification reads."
    return Drawing("resonance", figure, caption, text, ax is None)


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


def _draw_equivalent(
    what: Literal["stiffness", "damping"],
    identification: Identification,
    truth: Mapping[str, float] | None,
    ax: GivenAxes,
) -> Drawing:
    unit, symbol = ("N/m", "k(X)") if what == "stiffness" else ("N*s/m", "c(X)")

    def pick(model: Backbone) -> Floats:
        return model.stiffness if what == "stiffness" else model.damping

    points = sorted(identification.resonances, key=lambda point: point.amplitude)
    amplitude = np.array([point.amplitude for point in points])
    measured = np.array([point.stiffness if what == "stiffness" else point.damping for point in points])
    grid = amplitudes_tested(identification)
    refined, *halves = refined_band(identification, grid)
    half = halves[0] if what == "stiffness" else halves[1]
    first = backbone(identification, values_of(identification.first_order), grid)
    lines = [pick(refined), pick(first)]
    x, y = choose_scale(grid, "m"), choose_scale(np.concatenate([measured, pick(refined)]), unit)
    figure, (axes,) = take_axes(ax, 1, (4.4, 3.3))
    axes.fill_between(
        grid / x.factor,
        (pick(refined) - half) / y.factor,
        (pick(refined) + half) / y.factor,
        color="#D55E00",
        alpha=0.18,
        lw=0,
    )
    _plot(axes, amplitude / x.factor, measured / y.factor, POINT, "levels at resonance")
    if np.isfinite(pick(first)).any():
        _plot(axes, grid / x.factor, pick(first) / y.factor, FIRST_ORDER, "first-order fit, all points")
    _plot(axes, grid / x.factor, pick(refined) / y.factor, REFINED, "refined fit, 95 % band")
    if truth is not None:
        true = pick(backbone(identification, truth, grid))
        lines.append(true)
        _plot(axes, grid / x.factor, true / y.factor, TRUTH, f"derived {symbol}, true values")
    calm_limits(axes, [measured / y.factor, *(line / y.factor for line in lines)], least=0.06)
    axes.set_xlabel(x.label("Amplitude X"))
    axes.set_ylabel(y.label(f"Equivalent {what} {symbol}"))
    axes.legend(loc="best")
    text = _equivalent_words(what, grid, pick(refined), measured, y)
    known = np.isfinite(pick(refined) - lines[-1])
    if truth is not None and known.any():
        scale = float(np.max(np.abs(lines[-1][known]))) or 1.0
        off = float(np.max(np.abs(pick(refined) - lines[-1])[known])) / scale
        text += f" The refined fit departs from the truth by at most {number_text(100 * off, 2)} %."
    name = "Spring" if what == "stiffness" else "Damper"
    caption = f"{name}: equivalent {what}; points as read at resonance, lines as fitted and derived."
    return Drawing(what, figure, caption, text, ax is None)


def _equivalent_words(what: str, grid: Floats, fitted: Floats, measured: Floats, y: Scale) -> str:
    if not grid.size:
        return f"No amplitude was tested, so there is no equivalent {what} to show."
    read = measured[np.isfinite(measured)]
    shown = (
        [f"{number_text(value / y.factor)} {y.unit}" for value in (read.min(), read.max())]
        if read.size
        else []
    )
    if not shown:
        levels = "No level could be read at resonance."
    elif len(read) == 1:
        levels = f"The one level that could be read at resonance has {shown[0]}."
    else:
        levels = f"{len(read)} levels read at resonance lie between {shown[0]} and {shown[1]}."
    if not np.isfinite(fitted[[0, -1]]).all():
        return f"The refined equivalent {what} is not known over the tested amplitudes. {levels}"
    if len(grid) == 1:
        at = quantity_text(grid[0], "m", 3)
        return (
            f"The refined equivalent {what} is {number_text(fitted[0] / y.factor)} {y.unit} at {at}. {levels}"
        )
    change = f" ({100 * (fitted[-1] / fitted[0] - 1):+.1f} %)" if fitted[0] else ""
    return (
        f"The refined equivalent {what} goes from {number_text(fitted[0] / y.factor)} {y.unit} at "
        f"{quantity_text(grid[0], 'm', 3)} to {number_text(fitted[-1] / y.factor)} {y.unit} at "
        f"{quantity_text(grid[-1], 'm', 3)}{change}. {levels}"
    )


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
    speed = _acts_on_velocity(identification.model.force)
    figure, panels = take_axes(ax, 2, (4.4, 4.6), sharex=not speed)
    rate = choose_scale(curve.amplitude * 2 * np.pi * curve.frequency, "m/s")
    over_amplitude = (curve.amplitude / x.factor, grid / x.factor)
    over_velocity = (
        curve.amplitude * 2 * np.pi * curve.frequency / rate.factor,
        grid * model.omega / rate.factor,
    )
    parts = (
        ("k", "N/m", curve.stiffness, model.stiffness, 0.06, over_amplitude),
        ("c", "N*s/m", curve.damping, model.damping, 0.2, over_velocity if speed else over_amplitude),
    )
    for axes, (letter, unit, cloud, line, least, (place, course)) in zip(panels, parts, strict=False):
        y = choose_scale(line if line.size else cloud, unit)
        axes.scatter(
            place,
            cloud / y.factor,
            c=curve.level / force.factor,
            cmap=colours,
            norm=norm,
            s=7,
            linewidths=0,
            rasterized=len(cloud) > 300,
        )
        _plot(axes, course, line / y.factor, {**REFINED, "lw": 1.1}, "refined model at resonance")
        calm_limits(axes, [cloud / y.factor, line / y.factor], least=least)
        axes.set_ylabel(y.label(f"{'Stiffness' if letter == 'k' else 'Damping'} {letter}"))
    panels[0].legend(loc="best")
    if speed or len(panels) == 1:
        panels[0].set_xlabel(x.label("Amplitude X"))
    if len(panels) > 1:
        panels[1].set_xlabel(rate.label("Velocity amplitude ωX") if speed else x.label("Amplitude X"))
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=list(panels), pad=0.02, aspect=35)
    bar.set_label(force.label("Level F" if curve.level_unit == "N" else "Level X"))
    bar.outline.set_visible(False)
    if bar.solids is not None:
        bar.solids.set_rasterized(True)
    caption = (
        "Every test point, coloured by level: with the right law all fall on one curve, but for what the "
        "higher harmonics add."
    )
    words = _collapse_words(identification, grid, model, speed)
    return Drawing("collapse", figure, caption, words, ax is None)


def _acts_on_velocity(force: sympy.Expr) -> bool:
    """Find whether the force has a part that is not linear in v and does not depend on x."""
    v = symbol("v")
    damper = force - force.subs(v, 0)
    # evaluated as text is enough: an x that would cancel leaves the axis as it is
    if damper.has(symbol("x")):
        damper = sympy.expand(damper)
    return not damper.has(symbol("x")) and sympy.diff(damper, v, 2) != 0


def _collapse_words(identification: Identification, grid: Floats, model: Backbone, speed: bool) -> str:
    curve = identification.curve
    if not grid.size:
        return "No test point could be used."
    words = []
    velocity = curve.amplitude * 2 * np.pi * curve.frequency
    over_amplitude = (curve.amplitude, grid)
    for what, cloud, line, (place, course) in (
        ("stiffness", curve.stiffness, model.stiffness, over_amplitude),
        (
            "damping",
            curve.damping,
            model.damping,
            (velocity, grid * model.omega) if speed else over_amplitude,
        ),
    ):
        order = np.argsort(course)
        expected = np.interp(place, course[order], line[order])
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.abs(cloud / expected - 1)
        off = off[np.isfinite(off)]
        if off.size:
            words.append(
                f"half of the points lie within {number_text(100 * float(np.median(off)), 2)} % and 95 "
                "% within "
                f"{number_text(100 * float(np.percentile(off, 95)), 2)} % of the {what} of the refined model"
            )
    return f"{len(curve.amplitude)} points over {_span(grid, 'm')}: {'; '.join(words)}."
