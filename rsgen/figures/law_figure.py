"""A law and its describing function in one picture: the force, k(X), c(X) and the mean."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rsgen.describing import DescribingFunction
from rsgen.expression import symbol
from rsgen.expression.evaluation import compiled
from rsgen.figures.curves import REFINED
from rsgen.figures.drawing import Drawing, GivenAxes, in_style, take_axes
from rsgen.figures.equivalent import calm_limits
from rsgen.law.notation import readable
from rsgen.law.pieces import normal_form
from rsgen.units.scale import choose_scale, number_text, quantity_text

__all__ = ["draw_derivation", "telling_amplitude"]

Floats = NDArray[np.float64]

POINTS = 481
WIDTH = 72
"""Characters of a line of the heading."""

LEAST_CHANGE = 0.02
"""Change of the local power of k(X) or c(X) that counts as one."""

SHADES = ((0.3, "#8fb8d8"), (0.6, "#4a8ec2"), (1.0, "#0072B2"))
"""Amplitudes of the cycles drawn, in parts of the largest, and their colours."""


def telling_amplitude(function: DescribingFunction, values: Mapping[str, float], omega: float) -> float:
    """Choose a largest amplitude [m] for a picture: beyond all switches, or where k or c has changed.

    Parameters
    ----------
    values
        A value for each parameter, SI.
    omega
        Angular frequency [rad/s].
    """
    names = tuple(map(symbol, function.parameters))
    numbers = [values[name] for name in function.parameters]
    edges = []
    for switch in normal_form(function.force).switches:
        if switch.threshold is not None:
            level = abs(float(compiled((switch.threshold,), names)(*numbers)[0]))
            edges.append(level if switch.variable == "x" else level / omega)
    if any(np.isfinite(edge) and edge > 0 for edge in edges):
        return 3 * max(edge for edge in edges if np.isfinite(edge))
    X = np.geomspace(1e-6, 1e4, 201)
    found = function.evaluate(X, omega, values)
    places = []
    for curve in (found.stiffness, found.damping):
        with np.errstate(all="ignore"):
            slope = np.gradient(np.log(np.abs(curve)), np.log(X))
            change = np.minimum(np.abs(slope - slope[0]), 1.0)
        change = np.where(np.isfinite(change), change, 0.0)
        # a pure power has no amplitude of its own
        if change.max() > LEAST_CHANGE:
            places.append(float(X[np.argmax(change >= change.max() / 2)]))
    return 3 * max(places) if places else 1.0


@in_style
def draw_derivation(
    function: DescribingFunction,
    values: Mapping[str, float] | None = None,
    omega: float = 1.0,
    largest: float | None = None,
    *,
    ax: GivenAxes = None,
) -> Drawing:
    """Draw a law and its equivalent stiffness and damping over amplitude.

    Parameters
    ----------
    function
        What was derived.
    values
        Parameters, SI; those that are missing are taken as 1, and the heading says so.
    omega
        Angular frequency [rad/s].
    largest
        Largest amplitude [m]; None takes one that shows how the law changes.
    ax
        Axes for the law, and for stiffness, damping and mean as far as there are any; None makes a figure.
    """
    given = dict(values or {})
    numbers = {name: given.get(name, 1.0) for name in function.parameters}
    top = telling_amplitude(function, numbers, omega) if largest is None else largest
    X = np.linspace(top / POINTS, top, POINTS)
    found = function.evaluate(X, omega, numbers)
    curves = [
        ("Equivalent stiffness k", found.stiffness, "N/m"),
        ("Equivalent damping c", found.damping, "N*s/m"),
        ("Mean X0", found.mean, "m"),
    ]
    shown = [c for c in curves if np.any(c[1] != 0) and np.any(np.isfinite(c[1]))] or curves[:1]
    figure, (law, *panels) = take_axes(ax, 1 + len(shown), (4.6, 1.5 + 1.9 * (1 + len(shown))))
    if ax is None:
        _heading(figure, function, numbers, given, omega)
    _draw_law(law, function, numbers, omega, top, found.mean[-1])
    scale = choose_scale(X, "m")
    words = []
    for axes, (what, curve, unit) in zip(panels, shown, strict=False):
        y = choose_scale(np.percentile(np.abs(curve[np.isfinite(curve)]), 99), unit)
        axes.plot(X / scale.factor, curve / y.factor, **REFINED)
        calm_limits(axes, [curve / y.factor])
        axes.set_ylabel(y.label(what))
        axes.set_xlim(0, top / scale.factor)
        words.append(
            f"{what} is {quantity_text(curve[POINTS // 10], unit, 3)} at "
            f"{quantity_text(X[POINTS // 10], 'm', 2)} and {quantity_text(curve[-1], unit, 3)} at "
            f"{quantity_text(top, 'm', 2)}."
        )
    for axes in panels[-1:]:
        axes.set_xlabel(scale.label("Amplitude X"))
    caption = "The force of the law, and what it is to the fundamental of a vibration of amplitude X."
    return Drawing("derivation", figure, caption, " ".join(words), ax is None)


def _heading(
    figure: Figure,
    function: DescribingFunction,
    numbers: Mapping[str, float],
    given: Mapping[str, float],
    omega: float,
) -> None:
    """Write the law and the numbers at which it is drawn above the panels."""
    law = " ".join(readable(function.force).split())
    entries = [f"{name} = {number_text(number)}" for name, number in numbers.items() if name in given]
    assumed = [name for name in numbers if name not in given]
    if assumed:
        entries.append(f"{' = '.join(assumed)} = 1 (not given)")
    entries.append(f"omega = {number_text(omega)} rad/s")
    lines = [*textwrap.wrap(f"n = {law}", WIDTH)[:4], *textwrap.wrap(f"SI: {', '.join(entries)}", WIDTH)]
    figure.suptitle("\n".join(lines), x=0.02, ha="left", fontsize=8)


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
    law = compiled((function.force,), (x, v, *map(symbol, function.parameters)))
    phi = np.linspace(-np.pi / 2, 3 * np.pi / 2, 4 * POINTS)
    over_x = function.force.has(x) or not function.force.has(v)
    both = function.force.has(x) and function.force.has(v)
    middle = float(mean) if np.isfinite(mean) else 0.0
    span = top if over_x else omega * top
    place = choose_scale(span, "m" if over_x else "m/s")
    cycles = []
    for part, colour in SHADES if both else SHADES[-1:]:
        displacement = middle + part * top * np.sin(phi)
        velocity = omega * part * top * np.cos(phi)
        (force,) = law(displacement, velocity, *numbers.values())
        cycles.append((displacement if over_x else velocity, np.broadcast_to(force, phi.shape), colour))
    finite = [force[np.isfinite(force)] for _, force, _ in cycles]
    size = max((float(np.abs(force).max()) for force in finite if force.size), default=0.0)
    y = choose_scale(size, "N")
    for along, force, colour in cycles:
        axes.plot(along / place.factor, force / y.factor, color=colour, lw=1.3)
    axes.set_xlabel(place.label("Displacement x" if over_x else "Velocity v"))
    axes.set_ylabel(y.label("Force n"))
