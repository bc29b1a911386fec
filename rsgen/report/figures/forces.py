"""The forces themselves: what springs and dampers do at each displacement and velocity."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes

from rsgen.common.arrays import Array
from rsgen.data.oscillator import Model
from rsgen.formula.units.scale import choose_scale, number_text, quantity_text
from rsgen.identification.results import Identification
from rsgen.law.numeric import compile_law
from rsgen.report.figures.curves import POINT, REFINED, TRUTH
from rsgen.report.figures.drawing import Drawing, GivenAxes, in_style, take_axes
from rsgen.report.figures.equivalent import calm_limits, solution_of

__all__ = ["draw_forces", "force_function"]

_WIDEST_BAND = 0.5
"""Half width of a band, relative to the largest force, beyond which a point says nothing about the law."""


def force_function(model: Model, values: Mapping[str, float]) -> Callable[[Array, Array], Array]:
    """Give the force of a model as a function of displacement [m] and velocity [m/s], elementwise.

    Parameters
    ----------
    values
        Every parameter of the laws, SI; others are ignored.
    """
    law = compile_law(model.force)
    point = law.ordered(values)

    def force(x: Array, v: Array) -> Array:
        with np.errstate(all="ignore"):
            result = law.force(x, v, point)
        return np.broadcast_to(result, np.broadcast_shapes(np.shape(x), np.shape(v)))

    return force


@in_style
def draw_forces(
    identification: Identification, truth: Mapping[str, float] | None = None, *, ax: GivenAxes = None
) -> Drawing:
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
    high = identification.amplitude_range[1]
    fast = high * 2 * np.pi * identification.frequency_range[1]
    x, v = np.linspace(-high, high, 401), np.linspace(-fast, fast, 401)
    zero = np.zeros(401)
    model = identification.model
    refined = force_function(model, solution_of(identification))
    true = None if truth is None else force_function(model, truth)
    figure, panels = take_axes(ax, 2, (4.4, 4.6))
    restoring = identification.restoring
    kinds = (("stiffness force", x, "m"), ("damping force", v, "m/s"))
    words = []
    for axes, (what, place, unit) in zip(panels, kinds, strict=False):
        inverted = None
        if restoring is not None:
            inverted = (
                (restoring.displacement, restoring.stiffness_force, restoring.stiffness_band)
                if unit == "m"
                else (restoring.velocity, restoring.damping_force, restoring.damping_band)
            )
        force, expected = (
            None if law is None else law(place, zero) if unit == "m" else law(zero, place) - law(zero, zero)
            for law in (refined, true)
        )
        if force is not None:
            named = identification.curve.unit("N")
            words.append(_panel(axes, what, place, unit, force, expected, inverted, named))
    caption = "Forces of springs and of dampers over the tested range"
    caption += (
        ", and the nonparametric restoring force (points, 95 % band)." if restoring is not None else "."
    )
    return Drawing("forces", figure, caption, " ".join(words), ax is None)


def _panel(
    axes: Axes,
    what: str,
    place: Array,
    unit: str,
    force: Array,
    true: Array | None,
    inverted: tuple[Array, Array, Array] | None,
    force_unit: str,
) -> str:
    x = choose_scale(place, unit)
    y = choose_scale(force, force_unit)
    if inverted is not None:
        at, drawn, band = inverted
        # a band wider than the force itself determines nothing: near rest, and at rare amplitudes
        narrow = band < _WIDEST_BAND * np.nanmax(np.abs(force), initial=0.0)
        at, drawn, band = at[narrow], drawn[narrow], band[narrow]
        low, high = (drawn - band) / y.factor, (drawn + band) / y.factor
        axes.fill_between(at / x.factor, low, high, color="#0072B2", alpha=0.18, lw=0)
        few = np.unique(np.linspace(0, max(len(at) - 1, 0), min(len(at), 16)).astype(int))
        axes.plot(at[few] / x.factor, drawn[few] / y.factor, label="nonparametric", **POINT)
    axes.plot(place / x.factor, force / y.factor, label="refined", **REFINED)
    if true is not None:
        axes.plot(place / x.factor, true / y.factor, label="truth", **TRUTH)
    # a band that is wide for want of data must not make the forces flat
    lines = [
        line / y.factor for line in (force, true, None if inverted is None else drawn) if line is not None
    ]
    calm_limits(axes, lines)
    axes.set_xlabel(x.label("Displacement x" if unit == "m" else "Velocity v"))
    axes.set_ylabel(y.label(what.capitalize()))
    axes.legend(loc="upper left")
    text = (
        f"The {what} is {quantity_text(force[-1], force_unit, 3)} at {quantity_text(place[-1], unit, 3)} and "
        f"{quantity_text(force[0], force_unit, 3)} at {quantity_text(place[0], unit, 3)}"
    )
    if true is not None and np.isfinite(force).all():
        largest = float(np.max(np.abs(true)))
        off = float(np.max(np.abs(force - true))) / largest if largest else 0.0
        text += f"; it departs from the truth by at most {number_text(100 * off, 2)} % of the largest force"
    return f"{text}."
