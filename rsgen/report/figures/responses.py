"""Responses, tested and predicted: to sines at each level, and to multisines line by line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgba
from matplotlib.ticker import FuncFormatter

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import RELATIVE_CHANGE_NEGLIGIBLE
from rsgen.data.record_set import level_name
from rsgen.data.surface.response_surface import ResponseSurface, choose_levels, typical_amounts, within
from rsgen.formula.units import SWEEPS, Scale, choose_scale, number_text, quantity_text
from rsgen.identification.prediction import HeldOutLevel, Prediction, ResonanceCurve
from rsgen.identification.results import MultisineIdentification
from rsgen.report.figures.drawing import (
    BLUE,
    ORANGE,
    Drawing,
    GivenAxes,
    in_style,
    label_abscissa,
    level_colours,
    level_word,
    take_axes,
)

_MARKERS = {"rest": "o", "up": "^", "down": "v"}
_SHADE: dict[str, Any] = {"color": "0.5", "alpha": 0.15, "lw": 0, "zorder": 0}
"""Of what was not tested."""
_SPREAD_OF_LEVEL = 0.1
"""Of the force at the points of a level: a curve at a force that is farther off belongs to no level."""


def _draw_curve(
    axes: Axes, curve: ResonanceCurve, factor: float, colour: object, label: str | None = None
) -> None:
    """Draw a curve, dashed where it is unstable; parts share their end point, so that no gap shows."""
    changes = np.flatnonzero(np.diff(curve.stable)) + 1
    for part, (start, stop) in enumerate(pairwise([0, *changes.tolist(), len(curve.frequency)])):
        axes.plot(
            curve.frequency[start : stop + 1],
            curve.amplitude[start : stop + 1] / factor,
            color=colour,
            ls="-" if curve.stable[start] else (0, (2.5, 1.8)),
            lw=1.1,
            label=f"_{label}" if part and label else label,
        )


def _draw_predicted(axes: Axes, item: HeldOutLevel, factor: float, colour: object, label: str | None) -> None:
    """Join what is predicted at the measured force of each point."""
    axes.plot(item.frequency, np.abs(item.predicted) / factor, "-", color=colour, lw=1.1, label=label)


@in_style
def draw_responses(surface: ResponseSurface, prediction: Prediction, *, ax: GivenAxes = None) -> Drawing:
    """Draw frequency responses of at most six levels: measured points, predicted lines with their folds.

    Parameters
    ----------
    surface
        The points.
    prediction
        The lines; levels without a predicted curve show their points alone.
    ax
        Axes to draw on; None makes a figure.
    """
    surface = within(surface, prediction.observed)
    held, drawn = surface.response_held, [curve for curve in prediction.curves if len(curve.frequency)]
    predicted = {curve.level: curve for curve in drawn} if held else _curves_of(drawn, surface)
    levels, shown = _shown_levels(surface, predicted)
    scale = choose_scale(shown.amplitude, "m")
    colours = level_colours()(np.linspace(0, 1, len(levels)))
    figure, (axes,) = take_axes(ax, 1, (4.4, 3.7))
    curves = list[ResonanceCurve]()
    changing = _group(tuple(o for o in (*prediction.fitted, *prediction.held_out) if o.changes))
    for level, colour in zip(levels, colours, strict=True):
        _draw_measured(axes, shown, level, scale.factor, colour)
        curve = predicted.get(level)
        for item in changing.get(level, ()):
            name = item.name if item is changing[level][0] else None
            _draw_predicted(axes, item, scale.factor, colour, name)
        if curve is not None and level not in changing:
            name = curve.name if held else level_name(level, surface.level_unit, surface.label_of(level))
            forces = [quantity_text(size, curve.level_unit, 3) for size in (curve.level, level)]
            if not held and forces[0] != forces[1]:
                name += f" at {forces[0]}"
            _draw_curve(axes, curve, scale.factor, colour, name)
            curves.append(curve)
    untested = [] if held else [one for one in drawn if not any(one is of for of in predicted.values())]
    for curve in untested:
        nominal = np.isclose(surface.levels, curve.level).any()
        name = f"{curve.name}, {'held constant' if nominal else 'not tested'}"
        _draw_curve(axes, curve, scale.factor, "0.5", name)
    curves += untested
    tested = surface.select(surface.settled)
    inside = curves if prediction.band else untested
    beyond = _limit(axes, shown, tested, scale.factor, prediction.band, inside)
    axes.set_xlabel("Frequency [Hz]")
    axes.set_ylabel(scale.label("Amplitude X"))
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        title = "Force F" if held else level_word(surface)
        axes.legend(handles[::-1], labels[::-1], title=title, title_fontsize=7.5, loc="best")
    caption = _responses_caption(
        surface, shown, {v: predicted[v] for v in {*predicted} - {*changing}}, curves
    )
    if changing and not held:
        caption += " Where the force of a level changes, a line joins what the model predicts for each point."
    caption += " Shaded: beyond the tested frequencies or amplitudes, by the law alone." if beyond else ""
    return Drawing("responses", figure, caption, ax is None)


def _draw_measured(axes: Axes, shown: ResponseSurface, level: float, factor: float, colour: object) -> None:
    """Draw the measured points of a level, by the direction of their sweep."""
    style: dict[str, Any] = {
        "ms": 3.2,
        "mew": 0,
        "alpha": 0.75,
        "zorder": 1.5,
        "rasterized": len(shown) > 400,
    }
    for sweep, marker in _MARKERS.items():
        frequency, amplitude = _tested(shown, level, sweep)
        if len(frequency):
            axes.plot(frequency, amplitude / factor, marker, color=colour, **style)


def _responses_caption(
    surface: ResponseSurface,
    shown: ResponseSurface,
    predicted: Mapping[float, ResonanceCurve],
    lines: Sequence[ResonanceCurve],
) -> str:
    """Say what points and lines are, and at which forces lines are where those of points change."""
    unstable = "dashed parts are unstable"
    if all(np.isnan(curve.multiplier).all() for curve in lines):
        unstable += "; a doubling of the period is not looked for"
    if surface.response_held:
        return (
            "Frequency responses at constant force: points read off the test, which held X, lines as "
            f"predicted by the refined model; {unstable}."
        )
    if surface.decays:
        return (
            f"Frequency responses under one force, as predicted by the refined model; {unstable}. Points of "
            "a free decay lie on no line: each has its own force, the one that would have held its motion."
        )
    sweeps = [SWEEPS[name] for name in _MARKERS if np.any(shown.sweep == name)]
    symbols = {"from rest": "●", "sweep up": "▲", "sweep down": "▼"}
    caption = (
        f"Frequency responses: points as tested ({', '.join(f'{symbols[s]} {s}' for s in sweeps)})"
        f"{f', lines as predicted by the refined model; {unstable}' if lines else ''}."
    )
    forces = [(curve.level, level) for level, curve in predicted.items() if not surface.base]
    force, level = max(forces, key=lambda pair: abs(pair[0] / pair[1] - 1), default=(1.0, 1.0))
    names = [quantity_text(size, surface.level_unit, 3) for size in (force, level)]
    if names[0] != names[1]:
        caption += (
            f" A line has the force at the largest motion of its level, such as {names[0]} at level "
            f"{names[1]}; other points had another one."
        )
    return caption


def _shown_levels(
    surface: ResponseSurface, predicted: Mapping[float, ResonanceCurve]
) -> tuple[Sequence[float], ResponseSurface]:
    """Return at most six levels, those with a curve if any has one, and their points; of held X, forces."""
    levels = [*predicted]
    if surface.response_held:
        return levels[:: -(-len(levels) // 6) or 1], surface.select(surface.settled)
    levels = choose_levels(surface.select(np.isin(surface.level, levels)) if levels else surface)
    return levels, surface.select(np.isin(surface.level, levels) & surface.settled)


def _tested(shown: ResponseSurface, level: float, sweep: str) -> tuple[Array, Array]:
    """Return frequency and amplitude of the points at a force; where X was held, between neighbours."""
    if not shown.response_held:
        part = shown.select((shown.level == level) & (shown.sweep == sweep))
        return part.frequency, part.amplitude
    found: list[tuple[float, float]] = []
    for held in shown.levels:
        part = shown.select((shown.level == held) & (shown.sweep == sweep))
        order = np.argsort(part.frequency)
        f, over = part.frequency[order], np.abs(part.force)[order] - level
        at = np.flatnonzero(over[:-1] * over[1:] < 0)
        slope = (over[at + 1] - over[at]) / (f[at + 1] - f[at])
        found += [(float(place), float(held)) for place in f[at] - over[at] / slope]
    return np.array([f for f, _ in found]), np.array([a for _, a in found])


def _limit(
    axes: Axes,
    shown: ResponseSurface,
    tested: ResponseSurface,
    factor: float,
    band: tuple[float, float] | None,
    curves: Sequence[ResonanceCurve],
) -> bool:
    """Show some points, the band asked for and some curves; shade what lies beyond the tested points."""
    if not len(shown):
        return False
    low, high = float(tested.frequency.min()), float(tested.frequency.max())
    margin, largest = 0.02 * (high - low), float(tested.amplitude.max()) / factor
    left, right = (low, high) if band is None else (min(low, band[0]), max(high, band[1]))
    inside = (c.amplitude[(c.frequency >= left) & (c.frequency <= right)] for c in curves)
    highest = max((float(np.max(a, initial=0.0)) / factor for a in inside), default=0.0)
    for start, stop in ((left, low), (high, right)):
        axes.axvspan(start, stop, **_SHADE)
    if highest > largest:
        axes.axhspan(largest, 1.12 * highest, **_SHADE)
    axes.set_xlim(left - margin, right + margin)
    axes.set_ylim(0, 1.12 * max(float(shown.amplitude.max()) / factor, highest))
    return highest > largest or (left, right) != (low, high)


def _curves_of(curves: Sequence[ResonanceCurve], surface: ResponseSurface) -> dict[float, ResonanceCurve]:
    """Return the curve at each level that has one: at the nearest of the forces at the largest motions."""
    found = dict[float, tuple[float, ResonanceCurve]]()
    levels, forces = surface.levels, typical_amounts(surface)
    for curve in curves:
        # of a driven base the level is a force per unit mass
        off = np.abs(forces - (curve.level if surface.per_mass else curve.force))
        near = int(np.argmin(np.nan_to_num(off, nan=np.inf)))
        level, away = float(levels[near]), float(off[near])
        if away <= _SPREAD_OF_LEVEL * forces[near] and away < found.get(level, (np.inf,))[0]:
            found[level] = away, curve
    return {level: curve for level, (_, curve) in found.items()}


def _level_text(item: HeldOutLevel) -> str:
    """Name the level: a force, or the amplitude where that was held."""
    # a force that was held has no number, and a length next to a force is that of a base
    held = {"N": "F", "m": "X"} if np.isnan(item.force) else {"N": "F"}
    symbol = held.get(item.level_unit, "base")
    name = f"{symbol} = {item.name}"
    if abs(item.force - item.level) > RELATIVE_CHANGE_NEGLIGIBLE * item.level:
        name += f" ({quantity_text(item.force, item.force_unit, 3)} at the largest motion)"
    return name


def _group(held_out: tuple[HeldOutLevel, ...]) -> dict[float, list[HeldOutLevel]]:
    levels = sorted({item.level for item in held_out})
    return {level: [item for item in held_out if item.level == level] for level in levels}


@in_style
def draw_held_out(prediction: Prediction, *, ax: GivenAxes = None) -> Drawing:
    """Draw measured against predicted responses of the levels that identification has not seen.

    Parameters
    ----------
    prediction
        Made with a surface and with levels held out; that of a multisine has the figure of
        ``draw_predicted_record``.
    ax
        Axes, one a level; None makes a figure.

    Raises
    ------
    RsgenError
        No level was held out.
    """
    if prediction.records:
        return draw_predicted_record(prediction, ax=ax)
    groups = _group(prediction.held_out)
    if not groups:
        raise RsgenError("prediction: no level was held out; name some in hold_out")
    figure, panels = take_axes(ax, len(groups), (4.4, 1.2 + 1.45 * len(groups)), sharex=True)
    for axes, items in zip(panels, groups.values(), strict=False):
        held = _draw_level(axes, items, prediction)
    panels[0].legend(loc="best")
    label_abscissa(panels, ax, "Frequency [Hz]")
    caption = "Levels that identification has not seen: as tested and as the refined model predicts."
    caption += (
        " The curve is that of one force, where points have their own measured ones."
        if held
        else " The line at the forces of the points joins what it predicts for each."
    )
    return Drawing("held-out", figure, caption, ax is None)


def _draw_level(axes: Axes, items: Sequence[HeldOutLevel], prediction: Prediction) -> bool:
    """Draw the sweeps of a level and what predicts them; return True if its force was held."""
    scale = choose_scale(np.concatenate([np.abs(item.measured) for item in items]), "m")
    near = RELATIVE_CHANGE_NEGLIGIBLE * items[0].force
    drawn = [curve for curve in prediction.curves if len(curve.frequency)]
    # a shaker loses force at a resonance: the points do not lie on the curve at one force
    changes = any(item.changes for item in items)
    held = abs(items[0].force - items[0].level) <= near and items[0].level_unit == "N" and not changes
    at, pale = ("", 1.0) if held else (f" at {quantity_text(items[0].force, items[0].force_unit, 3)}", 0.45)
    for curve in (one for one in drawn if abs(one.force - items[0].force) <= near and not changes):
        low = np.where(curve.stable, curve.lower, np.nan) / scale.factor
        high = np.where(curve.stable, curve.upper, np.nan) / scale.factor
        axes.fill_between(curve.frequency, low, high, color=ORANGE, alpha=0.18, lw=0)
        _draw_curve(axes, curve, scale.factor, to_rgba(ORANGE, pale), f"predicted{at}")
    for item in items:
        if not held:
            name = "predicted at the measured forces" if item is items[0] else None
            _draw_predicted(axes, item, scale.factor, ORANGE, name)
        axes.plot(
            item.frequency,
            np.abs(item.measured) / scale.factor,
            _MARKERS[item.sweep],
            ms=2.8,
            mfc="none",
            mec=BLUE,
            mew=0.8,
            zorder=1.5,
            rasterized=len(item.frequency) > 40,
            label=f"tested, {SWEEPS[item.sweep]}",
        )
    frequency = np.concatenate([item.frequency for item in items])
    axes.set_xlim(float(frequency.min()), float(frequency.max()))
    axes.set_ylim(0, 1.15 * float(max(np.abs(item.measured).max() for item in items)) / scale.factor)
    axes.set_ylabel(scale.label("X"))
    axes.set_title(_level_text(items[0]))
    return held


# ----------------------------------------------------------------------------
# Multisines: the best linear approximation, the misfit of lines, and a record that was held out.

_FLOOR = 1e-7
"""Below the largest value by this factor nothing is drawn: round-off of exact data would set the scale."""


def _semilog(axes: Axes, frequency: Array, values: Array, **look: Any) -> None:
    """A line over frequency on a logarithmic scale; what is zero or unknown is left out.

    The neighbours of what is left out are joined: between lines that are not excited the others would be
    single points, which have no line.
    """
    shown = values > 0
    axes.semilogy(frequency[shown], values[shown], **look)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number_text(value)))


def _limit_lines(axes: Axes) -> None:
    """Choose the limits of the ordinate by the first line, which is the largest."""
    first = np.asarray(axes.get_lines()[0].get_ydata())
    if len(first):
        axes.set_ylim(max(axes.get_ylim()[0], _FLOOR * first.max()), 2 * first.max())


def _draw_lines(
    axes: Axes, frequency: Array, parts: Mapping[str, tuple[Array, str]], unit: str, what: str
) -> Scale:
    """Draw parts of a spectrum, each with its colour, on the scale of the first, which is the largest."""
    first = next(iter(parts.values()))[0]
    scale = choose_scale(first, unit)
    for name, (values, colour) in parts.items():
        _semilog(axes, frequency, values / scale.factor, color=colour, label=name, lw=0.7, alpha=0.75)
    axes.set_ylabel(scale.label(what))
    return scale


@in_style
def draw_best_linear(found: MultisineIdentification, *, ax: GivenAxes = None) -> Drawing:
    """Draw the best linear approximation of every level, and what is distortion and noise at the highest.

    Parameters
    ----------
    found
        From a multisine.
    ax
        Axes for receptance and response; None makes a figure.
    """
    levels = found.approximations
    figure, panels = take_axes(ax, 2, (4.4, 4.6), sharex=True)
    unit = found.curve.units.of("m/N") if np.isfinite(found.curve.units.kilogram) else "s^2"
    scale = choose_scale(np.abs(np.concatenate([one.receptance for one in levels])), unit)
    norm = Normalize(0, max(len(levels) - 1, 1))
    for number, one in enumerate(levels):
        look = {
            "color": level_colours()(norm(number)),
            "lw": 1.2,
            "label": quantity_text(one.level, one.level_unit, 3),
        }
        _semilog(panels[0], one.frequency, np.abs(one.receptance) / scale.factor, **look)
    panels[0].set_ylabel(scale.label("Receptance |G|"))
    panels[0].legend(loc="best", title="Level, rms")
    if len(panels) > 1:
        _draw_parts(panels[1], found)
    label_abscissa(panels, ax, "Frequency [Hz]")
    caption = (
        "Best linear approximation of each level, and what of the response at the highest level no linear "
        "structure would answer: distortion repeats every period, noise does not."
    )
    return Drawing("best-linear", figure, caption, ax is None)


def _draw_parts(axes: Axes, found: MultisineIdentification) -> None:
    """Response, distortion and noise of the highest level."""
    one = found.approximations[-1]
    parts = {
        "response": (one.response, "#1b1c1e"),
        "distortion": (one.distortion, ORANGE),
        "noise": (one.noise, BLUE),
    }
    what = f"Lines at {quantity_text(one.level, one.level_unit, 3)}"
    scale = _draw_lines(axes, one.frequency, parts, "m", what)
    for lines, name, mark in ((one.even, "even lines", "s"), (one.odd, "odd lines, not excited", "^")):
        if lines is not None and len(lines.frequency):
            values = np.where(lines.response > 0, lines.response, np.nan) / scale.factor
            axes.plot(lines.frequency, values, mark, ms=2.2, mfc="none", mew=0.7, label=name)
    axes.set_xlim(one.frequency[0], one.frequency[-1])
    _limit_lines(axes)
    axes.legend(loc="best")


@in_style
def draw_line_misfit(found: MultisineIdentification, *, ax: GivenAxes = None) -> Drawing:
    """Draw the residual of the balance at each line, its noise and the force.

    Parameters
    ----------
    found
        From a multisine.
    ax
        Axes for the lowest and the highest level; None makes a figure.
    """
    spectra = found.spectra
    rows = np.flatnonzero(np.isin(spectra.level, found.levels))
    level = spectra.level[rows]
    shown = list(dict.fromkeys([int(np.argmin(level)), int(np.argmax(level))]))
    figure, panels = take_axes(ax, len(shown), (4.4, 2.4 * len(shown)), sharex=True)
    for axes, place in zip(panels, shown, strict=False):
        used, named = found.used[place], quantity_text(float(level[place]), spectra.level_unit, 3)
        frequency = spectra.omega[rows[place]][used] / (2 * np.pi)
        parts = {
            "force": (np.abs(spectra.mean_force[rows[place]][used]), "#1b1c1e"),
            "misfit": (np.abs(found.misfit[place][used]), ORANGE),
            "noise of the balance": (found.deviation[place][used], BLUE),
        }
        _draw_lines(axes, frequency, parts, spectra.units.force, f"Level {named}")
        _limit_lines(axes)
    panels[0].legend(loc="best")
    label_abscissa(panels, ax, "Frequency [Hz]")
    caption = "What the law leaves of the balance at each line; above the noise it is misfit of the law."
    return Drawing("line-misfit", figure, caption, ax is None)


@in_style
def draw_predicted_record(prediction: Prediction, *, ax: GivenAxes = None) -> Drawing:
    """Draw a record that identification has not seen: measured, predicted, their difference; the first one.

    Parameters
    ----------
    prediction
        Of a multisine, with at least one record.
    ax
        Axes to draw on; None makes a figure.

    Raises
    ------
    RsgenError
        No record was predicted.
    """
    if not prediction.records:
        raise RsgenError("prediction: no record was predicted; hold a level out, or give spectra")
    one = prediction.records[0]
    figure, (axes,) = take_axes(ax, 1, (4.4, 2.6))
    judged = one.judged
    measured, predicted = one.measured[judged], one.predicted[judged]
    parts = {
        "measured": (np.abs(measured), "#1b1c1e"),
        "predicted": (np.abs(predicted), "#009E73"),
        "difference": (np.abs(predicted - measured), ORANGE),
    }
    _draw_lines(axes, one.frequency[judged], parts, "m", "Displacement")
    axes.set_xlabel("Frequency [Hz]")
    _limit_lines(axes)
    axes.legend(loc="best")
    caption = "A level that identification has not seen: response predicted from the measured force alone."
    return Drawing("predicted-record", figure, caption, ax is None)
