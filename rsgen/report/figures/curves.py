"""The modal table as a figure, and the collapse of all points: stiffness and damping over amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import sympy
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from rsgen.common.arrays import Array
from rsgen.common.tolerances import (
    CONFIDENCE_TEXT,
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    RELATIVE_CHANGE_NEGLIGIBLE,
)
from rsgen.formula.names import remembers, symbol
from rsgen.formula.units import Scale, choose_scale, number_text
from rsgen.identification.modal_result import MODAL_COLUMNS, ModalTable
from rsgen.identification.results import Identification
from rsgen.law.numeric import compile_law
from rsgen.report.figures import drawing, equivalent

# ----------------------------------------------------------------------------
# The modal table as a figure: resonance frequency and damping over the amplitude, without a law.


_LABELS = {"frequency": "Resonance frequency", "damping_ratio": "Damping ratio", "damping": "Damping c"}
"""Panels: damping ratio where it is known, else the damping itself."""


@drawing.in_style
def draw_modal(
    table: ModalTable, identification: Identification | None = None, *, ax: drawing.GivenAxes = None
) -> drawing.Drawing:
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
    grid = np.geomspace(table.amplitude[0], table.amplitude[-1], drawing.POINTS if len(table) > 1 else 1)
    fine = table.at(grid)
    names = ["frequency", "damping_ratio" if "damping_ratio" in table.known else "damping"]
    names = [name for name in names if name in table.known]
    figure, panels = drawing.take_axes(ax, len(names), (4.4, 1.95 * len(names)), sharex=True)
    x = choose_scale(grid, "m")
    model = None
    if identification is not None and len(grid) > 1:
        model = equivalent.backbone_with_harmonics(identification, grid)
    for axes, name in zip(panels, names, strict=False):
        value, low, high = (getattr(fine, f"{name}{end}") for end in ("", "_lower", "_upper"))
        unit = MODAL_COLUMNS[name]
        scale = choose_scale(value, unit) if unit else Scale(0.01, "%")
        factor = scale.factor
        axes.fill_between(grid / x.factor, low / factor, high / factor, color=drawing.BLUE, alpha=0.2, lw=0)
        look = {"color": drawing.POINT["mec"], "lw": 1.3}
        if len(grid) == 1:
            axes.vlines(grid / x.factor, low / factor, high / factor, drawing.BLUE)
            look = drawing.POINT
        label = f"without a law, {CONFIDENCE_TEXT} band"
        axes.plot(grid / x.factor, value / factor, label=label, **look)
        shown = [value / factor]
        if model is not None:
            line = getattr(model, name) / factor
            shown.append(line)
            axes.plot(
                grid / x.factor,
                line,
                label="refined model",
                **{**drawing.REFINED, "lw": 1.1, "ls": (0, (5, 2))},
            )
        equivalent.calm_limits(axes, shown, least=0.01 if name == "frequency" else 0.2)
        axes.set_ylabel(scale.label(_LABELS[name]))
    drawing.label_abscissa(panels, ax, x.label("Amplitude X"))
    panels[0].legend(loc="best")
    caption = (
        "Modal table: what the points near resonance say of the mode at each amplitude, whatever the law."
    )
    return drawing.Drawing("modal", figure, caption, ax is None)


_LEVELS = {"N": "Level F", "m": "Level X"}
"""Name of levels by their unit; those of a base are levels."""

_QUANTILES_IN_PICTURE = (MAX_SHARE_OF_OUTLIERS_BY_CHANCE / 2, 1 - MAX_SHARE_OF_OUTLIERS_BY_CHANCE / 2)
"""Quantiles of the points that stand in the picture in any case."""

_FORMULA: dict[str, Any] = {"color": "#009E73", "lw": 1.1, "ls": (0, (5, 2))}

_ABOVE: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "ncols": 2, "columnspacing": 1}
"""Place of a legend above its panel, where it hides nothing."""

_Place = tuple[Array, Array]
"""Abscissae and ordinates in a panel."""


@drawing.in_style
def draw_collapse(
    identification: Identification, truth: Mapping[str, float] | None = None, *, ax: drawing.GivenAxes = None
) -> drawing.Drawing:
    """Draw every test point as equivalent stiffness and damping: with the right law they fall on one curve.

    Parameters
    ----------
    identification
        Its curve gives the points, coloured by level, its resonances the circles, its refined estimates the
        line with its band.
    truth
        True value of every parameter, SI; "m" may be among them.
    ax
        One axes for the stiffness, or two for stiffness and damping; None makes a figure.
    """
    curve, law = identification.curve, identification.model.force
    joint = remembers(law)
    # a damper that acts on the velocity alone has one curve over its amplitude omega X, and none over X
    speed = not joint and _acts_on_velocity(law)

    def places(of: equivalent.Backbone) -> tuple[_Place, _Place]:
        """Return k over X; and of a joint omega c, of a drag c over omega X, else c."""
        along = of.amplitude * of.omega if speed else of.amplitude
        return (of.amplitude, of.stiffness), (along, of.damping * of.omega if joint else of.damping)

    grid = equivalent.amplitudes_tested(identification)
    model, half_stiffness, half_damping = equivalent.refined_band(identification, grid)
    lines, bands = places(model), places(replace(model, stiffness=half_stiffness, damping=half_damping))
    tested = equivalent.Backbone(
        curve.amplitude, 2 * np.pi * curve.frequency, curve.stiffness, curve.damping, identification.mass
    )
    clouds, levels = places(tested), places(_at_resonances(identification))
    formulas = places(equivalent.backbone(identification, equivalent.solution_of(identification), grid))
    damper = ("Loss stiffness ωc", "N/m", 0.2) if joint else ("Damping c", "N*s/m", 0.2)
    kinds = (("Stiffness k", "N/m", 0.06), damper)
    triples = zip(lines, formulas, kinds, strict=True)
    differs = any(_differs(line, formula, least) for line, formula, (*_, least) in triples)
    name = "refined model" if differs else "describing function"
    drawn = [(lines, f"{name}, {CONFIDENCE_TEXT} band", {**drawing.REFINED, "lw": 1.1})]
    drawn += [(formulas, "describing function", _FORMULA)] * differs
    if truth is not None:
        true = equivalent.smooth_backbone(identification, grid, truth)
        drawn.append((places(true), "derived, true values", drawing.TRUTH))
    force = choose_scale(curve.level, curve.level_unit)
    norm = Normalize(0, float(np.max(curve.level, initial=0.0)) / force.factor or 1.0)
    points = {"c": curve.level / force.factor, "cmap": drawing.level_colours(), "norm": norm}
    figure, panels = drawing.take_axes(ax, 2, (4.4, 4.6), sharex=not speed)
    x = choose_scale(curve.amplitude, "m")
    scales = (x, choose_scale(tested.amplitude * tested.omega, "m/s") if speed else x)
    for i, (axes, x, (name, unit, least)) in enumerate(zip(panels, scales, kinds, strict=False)):
        curves = [(of[i], label, look) for of, label, look in drawn]
        y = choose_scale(lines[i][1] if grid.size else clouds[i][1], curve.units.of(unit))
        _draw_panel(axes, (x, y), clouds[i], points, levels[i], curves, bands[i][1], least)
        axes.set_ylabel(y.label(name))
        if speed or ax is not None or axes is panels[-1]:
            axes.set_xlabel(x.label("Velocity amplitude ωX" if speed and i else "Amplitude X"))
    panels[0].legend(**(_ABOVE if ax is None else {"loc": "best"}))
    drawing.colour_bar(panels[0], norm, force.label(_LEVELS.get(curve.level_unit, "Level")))
    caption = _collapse_caption(identification, harmonics=model.harmonics is not None, differs=differs)
    return drawing.Drawing("collapse", figure, caption, ax is None)


def _draw_panel(
    axes: Axes,
    scales: tuple[Scale, Scale],
    cloud: _Place,
    points: Mapping[str, Any],
    levels: _Place,
    curves: Sequence[tuple[_Place, str, Mapping[str, Any]]],
    half: Array,
    least: float,
) -> None:
    """Draw test points, levels at resonance and curves, the first with half the width of its band."""

    def scaled(place: Array, height: Array) -> tuple[Array, Array]:
        return place / scales[0].factor, height / scales[1].factor

    axes.scatter(*scaled(*cloud), s=7, linewidths=0, rasterized=len(cloud[0]) > 300, **points)
    axes.plot(*scaled(*levels), label="levels at resonance" if levels[0].size else None, **drawing.POINT)
    place, line = curves[0][0]
    (place, low), (_, high) = scaled(place, line - half), scaled(place, line + half)
    axes.fill_between(place, low, high, color=drawing.ORANGE, alpha=0.18, lw=0)
    heights = [scaled(*levels)[1], _range_shown(cloud[1]) / scales[1].factor]
    for of, label, look in curves:
        axes.plot(*scaled(*of), label=label, **look)
        heights.append(scaled(*of)[1])
    equivalent.calm_limits(axes, heights, least=least)
    if not any(np.isfinite(values).any() for values in heights):
        axes.text(0.5, 0.5, "not known", ha="center", va="center", transform=axes.transAxes)


def _at_resonances(identification: Identification) -> equivalent.Backbone:
    """Return the levels that reach resonance, by amplitude."""
    reached = [point for point in identification.resonances if point.reached]
    read = sorted(reached, key=lambda point: point.amplitude)
    names = ("amplitude", "frequency", "stiffness", "damping")
    amplitude, frequency, stiffness, damping = (np.array([getattr(p, name) for p in read]) for name in names)
    return equivalent.Backbone(amplitude, 2 * np.pi * frequency, stiffness, damping, identification.mass)


def _range_shown(cloud: Array) -> Array:
    """Return the range of the points that are shown: not those next to a jump that no law explains."""
    finite = cloud[np.isfinite(cloud)]
    return np.quantile(finite, _QUANTILES_IN_PICTURE) if finite.size else cloud


def _collapse_caption(identification: Identification, *, harmonics: bool, differs: bool) -> str:
    """Return the caption of the collapse, whose line has the harmonics of the motion or not, so that it
    differs from the describing function or not.
    """
    caption = (
        "Every test point, coloured by level: with the right law all fall on one curve, but for what the "
        f"higher harmonics add{' far from the resonance' if harmonics else ''}."
        f"{' The band is of first order.' if harmonics else ''}"
        f"{' The describing function, with the refined values, has no harmonics.' if differs else ''}"
    )
    masses = [one.stiffness / (2 * np.pi * one.frequency) ** 2 for one in identification.resonances]
    off = float(np.median(masses)) / identification.mass - 1 if masses else 0.0
    if abs(off) > RELATIVE_CHANGE_NEGLIGIBLE:
        caption += f" Levels at resonance are read with a mass of their own, {number_text(100 * off, 2)} % "
        caption += "off, and so is their stiffness."
    if any(f.code == "not-recorded" and f.names["signal"] == "phase" for f in identification.findings):
        caption += " Phases were not recorded: each point has the one that the identified law predicts."
    law = identification.model.force
    if not (harmonics or remembers(law) or compile_law(law).odd):
        caption += " The law is not the same on both sides: its second harmonic, which the line has not, "
        caption += "moves the points to one side of it."
    return caption


def _differs(line: _Place, formula: _Place, least: float) -> bool:
    """Decide whether two curves of a panel, which spans ``least`` of its values, can be told."""
    height = line[1]
    span = max(np.ptp(height), least * np.abs(height).max()) if height.size else np.inf
    return bool(np.any(np.abs(formula[1] - height) > RELATIVE_CHANGE_NEGLIGIBLE * span))


def _acts_on_velocity(force: sympy.Expr) -> bool:
    """Find whether the force has a part that is not linear in v and does not depend on x."""
    v = symbol("v")
    damper = force - force.subs(v, 0)
    # evaluated as text is enough: an x that would cancel leaves the axis as it is
    if damper.has(symbol("x")):
        damper = sympy.expand(damper)
    return not damper.has(symbol("x")) and sympy.diff(damper, v, 2) != 0
