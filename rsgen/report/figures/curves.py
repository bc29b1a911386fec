"""The modal table as a figure, and the collapse of all points: stiffness and damping over amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
        axes.plot(
            grid / x.factor,
            value / factor,
            color=drawing.POINT["mec"],
            lw=1.3,
            label=f"without a law, {CONFIDENCE_TEXT} band",
        )
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


def _say_empty(axes: Axes, drawn: Sequence[Array]) -> None:
    """Say in an empty panel that nothing is known."""
    if not any(np.isfinite(values).any() for values in drawn):
        axes.text(0.5, 0.5, "not known", ha="center", va="center", transform=axes.transAxes)


_LEVELS = {"N": "Level F", "m": "Level X"}
"""Name of levels by their unit; those of a base are levels."""

_QUANTILES_IN_PICTURE = (MAX_SHARE_OF_OUTLIERS_BY_CHANCE / 2, 1 - MAX_SHARE_OF_OUTLIERS_BY_CHANCE / 2)
"""Quantiles of the points that stand in the picture in any case."""

_FORMULA: dict[str, Any] = {"color": "#009E73", "lw": 1.1, "ls": (0, (5, 2))}

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
    # a damper that acts on the velocity alone has one curve over its amplitude omega X, and none over X
    joint = remembers(law)
    speed = not joint and _acts_on_velocity(law)

    def places(amplitude: Array, omega: Array, stiffness: Array, damping: Array) -> tuple[_Place, _Place]:
        """Return k over X; and of a joint omega c, of a drag c over omega X, else c."""
        along = amplitude * omega if speed else amplitude
        return (amplitude, stiffness), (along, damping * omega if joint else damping)

    grid = equivalent.amplitudes_tested(identification)
    model, *halves = equivalent.refined_band(identification, grid)
    omega = 2 * np.pi * curve.frequency
    clouds = places(curve.amplitude, omega, curve.stiffness, curve.damping)
    levels = places(*_at_resonances(identification))
    lines, bands = (places(grid, model.omega, *of) for of in ((model.stiffness, model.damping), halves))
    first = equivalent.backbone(identification, equivalent.solution_of(identification), grid)
    formulas = places(grid, first.omega, first.stiffness, first.damping)
    force = choose_scale(curve.level, curve.level_unit)
    norm = Normalize(0, float(np.max(curve.level, initial=0.0)) / force.factor or 1.0)
    figure, panels = drawing.take_axes(ax, 2, (4.4, 4.6), sharex=not speed)
    x = choose_scale(curve.amplitude, "m")
    scales = (x, choose_scale(curve.amplitude * omega, "m/s") if speed else x)
    damper = ("Loss stiffness ωc", "N/m", 0.2) if joint else ("Damping c", "N*s/m", 0.2)
    kinds = (("Stiffness k", "N/m", 0.06), damper)
    pairs = zip(lines, formulas, kinds, strict=True)
    differs = any(_differs(line, formula, least) for (_, line), (_, formula), (*_, least) in pairs)
    others = [(formulas, "describing function", _FORMULA)] * differs
    if truth is not None:
        true = equivalent.smooth_backbone(identification, grid, truth)
        truths = places(grid, true.omega, true.stiffness, true.damping)
        others.append((truths, "derived, true values", drawing.TRUTH))
    for i, (axes, (name, unit, least)) in enumerate(zip(panels, kinds, strict=False)):
        (place, cloud), (course, line), wide = clouds[i], lines[i], scales[i].factor
        y = choose_scale(line if line.size else cloud, curve.units.of(unit))
        _draw_points(axes, place / wide, cloud / y.factor, curve.level / force.factor, norm)
        at, heights = levels[i]
        name_of_levels = "levels at resonance" if at.size else None
        axes.plot(at / wide, heights / y.factor, label=name_of_levels, **drawing.POINT)
        curve_name = "refined model" if differs else "describing function"
        _draw_model(axes, course / wide, line / y.factor, bands[i][1] / y.factor, curve_name)
        drawn = [_range_shown(cloud) / y.factor, heights / y.factor, line / y.factor]
        for of, label, look in others:
            course, line = of[i]
            axes.plot(course / wide, line / y.factor, label=label, **look)
            drawn.append(line / y.factor)
        equivalent.calm_limits(axes, drawn, least=least)
        _say_empty(axes, drawn)
        axes.set_ylabel(y.label(name))
    # above the panel nothing is hidden
    above: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "ncols": 2, "columnspacing": 1}
    panels[0].legend(**(above if ax is None else {"loc": "best"}))
    if speed or len(panels) == 1:
        panels[0].set_xlabel(x.label("Amplitude X"))
    for axes in panels[1:]:
        axes.set_xlabel(scales[1].label("Velocity amplitude ωX" if speed else "Amplitude X"))
    drawing.colour_bar(panels[0], norm, force.label(_LEVELS.get(curve.level_unit, "Level")))
    caption = _collapse_caption(identification, harmonics=model.harmonics is not None, differs=differs)
    return drawing.Drawing("collapse", figure, caption, ax is None)


def _at_resonances(identification: Identification) -> tuple[Array, Array, Array, Array]:
    """Return amplitude, omega, stiffness and damping of the levels that reach resonance, by amplitude."""
    reached = [point for point in identification.resonances if point.reached]
    read = sorted(reached, key=lambda point: point.amplitude)
    names = ("amplitude", "frequency", "stiffness", "damping")
    amplitude, frequency, stiffness, damping = (np.array([getattr(p, name) for p in read]) for name in names)
    return amplitude, 2 * np.pi * frequency, stiffness, damping


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


def _draw_points(axes: Axes, place: Array, height: Array, level: Array, norm: Normalize) -> None:
    """Draw test points, coloured by level."""
    axes.scatter(
        place,
        height,
        c=level,
        cmap=drawing.level_colours(),
        norm=norm,
        s=7,
        linewidths=0,
        rasterized=len(height) > 300,
    )


def _differs(line: Array, formula: Array, least: float) -> bool:
    """Decide whether two curves of a panel, which spans ``least`` of its values, can be told."""
    span = max(np.ptp(line), least * np.abs(line).max()) if line.size else np.inf
    return bool(np.any(np.abs(formula - line) > RELATIVE_CHANGE_NEGLIGIBLE * span))


def _draw_model(axes: Axes, place: Array, height: Array, half: Array, name: str) -> None:
    """Draw the curve of the refined model with its band."""
    axes.fill_between(place, height - half, height + half, color=drawing.ORANGE, alpha=0.18, lw=0)
    look = {**drawing.REFINED, "lw": 1.1}
    axes.plot(place, height, label=f"{name}, {CONFIDENCE_TEXT} band", **look)


def _acts_on_velocity(force: sympy.Expr) -> bool:
    """Find whether the force has a part that is not linear in v and does not depend on x."""
    v = symbol("v")
    damper = force - force.subs(v, 0)
    # evaluated as text is enough: an x that would cancel leaves the axis as it is
    if damper.has(symbol("x")):
        damper = sympy.expand(damper)
    return not damper.has(symbol("x")) and sympy.diff(damper, v, 2) != 0
