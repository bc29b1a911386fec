"""Figures of a multisine test: best linear approximation, misfit by line, a record predicted."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.ticker import FuncFormatter

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError, require
from rsgen.data.multisine import BestLinear
from rsgen.formula.units.quantities import choose_scale, count_text, number_text, quantity_text
from rsgen.identification.lines import MultisineIdentification
from rsgen.identification.prediction.prediction_result import MultisinePrediction, PredictedRecord
from rsgen.law.motion import waveform
from rsgen.report.figures.drawing import Drawing, GivenAxes, in_style, label_abscissa, take_axes
from rsgen.report.figures.overview import level_colours

__all__ = ["draw_best_linear", "draw_line_misfit", "draw_predicted_record"]


_PALE: dict[str, Any] = {"lw": 0.7, "alpha": 0.75}
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


def _limit(axes: Axes, largest: float) -> None:
    if largest > 0:
        low = axes.get_ylim()[0]
        axes.set_ylim(max(low, _FLOOR * largest), 2 * largest)


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
    require(found, MultisineIdentification, "found")
    levels = found.approximations
    figure, panels = take_axes(ax, 2, (4.4, 4.6), sharex=True)
    unit = "m/N"
    scale = choose_scale(np.abs(np.concatenate([one.receptance for one in levels])), unit)
    norm = Normalize(0, max(len(levels) - 1, 1))
    for number, one in enumerate(levels):
        look = {"color": level_colours()(norm(number)), "lw": 1.2, "label": quantity_text(one.level, "N", 3)}
        _semilog(panels[0], one.frequency, np.abs(one.receptance) / scale.factor, **look)
    panels[0].set_ylabel(scale.label("Receptance |G|"))
    panels[0].legend(loc="best", title="Level, rms")
    if len(panels) > 1:
        _draw_parts(panels[1], found)
    label_abscissa(panels, ax, "Frequency [Hz]")
    text = " ".join(map(_said, levels))
    caption = (
        "Best linear approximation of each level, and what of the response at the highest level no linear "
        "structure would answer: distortion repeats every period, noise does not."
    )
    return Drawing("best-linear", figure, caption, text, ax is None)


def _said(one: BestLinear) -> str:
    """The best linear approximation of one level in numbers."""
    noise = f"{number_text(100 * one.noise_share, 2)} %" if np.isfinite(one.noise_share) else "not known"
    apart = ""
    if np.isfinite(one.even_share) and np.isfinite(one.odd_share):
        even, odd = _hidden(one.even_share, one.even_bound), _hidden(one.odd_share, one.odd_bound)
        apart = f", at even lines {even}, at odd lines that are not excited {odd}"
    return (
        f"At {quantity_text(one.level, 'N', 3)}: natural frequency "
        f"{quantity_text(one.natural_frequency, 'Hz', 5)}, damping ratio "
        f"{number_text(100 * one.damping_ratio, 3)} %, distortion "
        f"{number_text(100 * one.distortion_share, 2)} % of the response{apart}, noise {noise}."
    )


def _hidden(share: float, bound: float) -> str:
    """A share in per cent, or what it is below where noise hides it."""
    if share == 0 and np.isfinite(bound) and bound > 0:
        return f"less than {number_text(100 * bound, 2)} %"
    return f"{number_text(100 * share, 2)} %"


def _draw_parts(axes: Axes, found: MultisineIdentification) -> None:
    """Response, distortion and noise of the highest level."""
    one = found.approximations[-1]
    scale = choose_scale(one.response, "m")
    parts = (
        ("response", one.response, "#1b1c1e"),
        ("distortion", one.distortion, "#D55E00"),
        ("noise", one.noise, "#0072B2"),
    )
    for name, values, colour in parts:
        _semilog(axes, one.frequency, values / scale.factor, color=colour, label=name, **_PALE)
    for lines, name, mark in ((one.even, "even lines", "s"), (one.odd, "odd lines, not excited", "^")):
        if lines is not None and len(lines.frequency):
            values = np.where(lines.response > 0, lines.response, np.nan) / scale.factor
            axes.plot(lines.frequency, values, mark, ms=2.2, mfc="none", mew=0.7, label=name)
    axes.set_xlim(one.frequency[0], one.frequency[-1])
    axes.set_ylabel(scale.label(f"Lines at {quantity_text(one.level, 'N', 3)}"))
    _limit(axes, float(one.response.max()) / scale.factor)
    axes.legend(loc="best")


@in_style
def draw_line_misfit(found: MultisineIdentification, *, ax: GivenAxes = None) -> Drawing:
    """Draw the balance that the law leaves at each line beside its noise and the force.

    Parameters
    ----------
    found
        From a multisine.
    ax
        Axes for the lowest and the highest level; None makes a figure.
    """
    require(found, MultisineIdentification, "found")
    spectra = found.spectra
    rows = np.flatnonzero(np.isin(spectra.level, found.levels))
    level = spectra.level[rows]
    shown = list(dict.fromkeys([int(np.argmin(level)), int(np.argmax(level))]))
    figure, panels = take_axes(ax, len(shown), (4.4, 2.4 * len(shown)), sharex=True)
    texts = []
    for axes, place in zip(panels, shown, strict=False):
        used = found.used[place]
        frequency = spectra.frequency[used]
        force = np.abs(spectra.mean_force[rows[place]][used])
        left, noise = np.abs(found.misfit[place][used]), found.deviation[place][used]
        scale = choose_scale(force, "N")
        parts = (
            ("force", force, "#1b1c1e"),
            ("misfit", left, "#D55E00"),
            ("noise of the balance", noise, "#0072B2"),
        )
        for name, values, colour in parts:
            _semilog(axes, frequency, values / scale.factor, color=colour, label=name, **_PALE)
        axes.set_ylabel(scale.label(f"Level {quantity_text(float(level[place]), 'N', 3)}"))
        _limit(axes, float(force.max()) / scale.factor)
        share = float(np.linalg.norm(left) / np.linalg.norm(force))
        known = bool(np.isfinite(noise).all() and noise.all())
        times = float(np.sqrt(np.mean((left / noise) ** 2))) if known else float("nan")
        beside = f", {number_text(times, 2)} times its noise" if np.isfinite(times) else ""
        texts.append(
            f"At {quantity_text(float(level[place]), 'N', 3)} the law leaves "
            f"{number_text(100 * share, 2)} % of the force at {count_text(int(used.sum()), 'line')}{beside}."
        )
    panels[0].legend(loc="best")
    label_abscissa(panels, ax, "Frequency [Hz]")
    caption = "What the law leaves of the balance at each line; above the noise it is misfit of the law."
    return Drawing("line-misfit", figure, caption, " ".join(texts), ax is None)


@in_style
def draw_predicted_record(prediction: MultisinePrediction, *, ax: GivenAxes = None) -> Drawing:
    """Draw a record that identification has not seen: measured, predicted, their difference; the first one.

    Parameters
    ----------
    prediction
        Of a multisine, with at least one record.
    ax
        Axes for spectrum and time; None makes a figure.

    Raises
    ------
    RsgenError
        No record was predicted.
    """
    require(prediction, MultisinePrediction, "prediction")
    if not prediction.records:
        raise RsgenError("prediction: no record was predicted; hold a level out, or give spectra")
    one = prediction.records[0]
    figure, panels = take_axes(ax, 2, (4.4, 4.6))
    judged = one.judged
    measured, predicted = one.measured[judged], one.predicted[judged]
    scale = choose_scale(np.abs(measured), "m")
    parts = (
        ("measured", np.abs(measured), "#1b1c1e"),
        ("predicted", np.abs(predicted), "#009E73"),
        ("difference", np.abs(predicted - measured), "#D55E00"),
    )
    for name, values, colour in parts:
        _semilog(panels[0], one.frequency[judged], values / scale.factor, color=colour, label=name, **_PALE)
    panels[0].set_ylabel(scale.label("Displacement"))
    panels[0].set_xlabel("Frequency [Hz]")
    _limit(panels[0], float(np.abs(measured).max()) / scale.factor)
    panels[0].legend(loc="best")
    if len(panels) > 1:
        _draw_time(panels[1], one)
    level = quantity_text(one.level, "N", 3)
    noise = (
        f"; the noise of the measured mean is {number_text(100 * one.noise, 2)} %"
        if np.isfinite(one.noise)
        else ""
    )
    error = number_text(100 * one.error, 3)
    text = f"Held-out level {level}: the predicted response differs by {error} % rms{noise}."
    caption = "A level that identification has not seen: response predicted from the measured force alone."
    return Drawing("predicted-record", figure, caption, text, ax is None)


def _draw_time(axes: Axes, one: PredictedRecord) -> None:
    """The largest motion of the record in time, judged lines only."""
    count = len(one.frequency)
    samples = 8 * count
    waves = [
        waveform(np.where(one.judged, np.nan_to_num(spectrum), 0), samples)
        for spectrum in (one.measured, one.predicted)
    ]
    strongest = one.frequency[int(np.argmax(np.where(one.judged, np.abs(one.measured), 0)))]
    period = 1 / one.frequency[1]
    width = min(int(samples * 12 / strongest / period), samples)
    begin = int(np.clip(np.argmax(np.abs(waves[0])) - width // 2, 0, samples - width))
    part = slice(begin, begin + width)
    scale = choose_scale(waves[0][part], "m")
    time = np.arange(samples)[part] * period / samples
    axes.plot(time, waves[0][part] / scale.factor, color="#1b1c1e", lw=1.4, label="measured")
    axes.plot(time, waves[1][part] / scale.factor, color="#009E73", lw=1.2, ls=(0, (4, 2)), label="predicted")
    axes.set_xlabel("Time in the period [s]")
    axes.set_ylabel(scale.label("Displacement"))
