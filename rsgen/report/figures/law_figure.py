"""A law and its describing function in one picture: the force, k(X), c(X) and the mean."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rsgen.common.arrays import Array
from rsgen.describing import DescribingFunction
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import Inner
from rsgen.formula.units.quantities import choose_scale, number_text, quantity_text
from rsgen.law.notation import readable
from rsgen.law.pieces import normal_form
from rsgen.report.figures.curves import REFINED
from rsgen.report.figures.drawing import Drawing, GivenAxes, in_style, take_axes
from rsgen.report.figures.equivalent import calm_limits

__all__ = ["draw_derivation", "telling_amplitude"]

POINTS = 481
WIDTH = 72
"""Characters of a line of the heading."""

TURNED = 1.5
"""Change of the local power of k(X) or c(X) after which the largest amplitudes show nothing new."""

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
    edges = [edge for edge in _edges(function, values, omega) if np.isfinite(edge)]
    if any(edge > 0 for edge in edges):
        return 3 * max(edges)
    if function.memory:
        X, curves = _upward(function, values, omega)
    else:
        X = np.geomspace(1e-6, 1e4, 201)
        found = function.evaluate(X, omega, values)
        curves = [found.stiffness, found.damping]
    places = []
    for curve in curves:
        with np.errstate(all="ignore"):
            slope = np.gradient(np.log(np.abs(curve)), np.log(X))
            change = np.minimum(np.abs(slope - slope[0]), 1.0)
        change = np.where(np.isfinite(change), change, 0.0)
        # a pure power has no amplitude of its own
        if change.max() > LEAST_CHANGE:
            places.append(float(X[np.argmax(change >= change.max() / 2)]))
    return 3 * max(places) if places else 1.0


def _edges(function: DescribingFunction, values: Mapping[str, float], omega: float) -> list[float]:
    """List the amplitudes at which a switch starts to act, or a formula changes."""
    names = tuple(map(symbol, function.parameters))
    numbers = [values[name] for name in function.parameters]
    edges = []
    for switch in normal_form(function.force).switches:
        if switch.threshold is not None and not switch.threshold.atoms(Inner):
            level = abs(float(compiled((switch.threshold,), names)(*numbers)[0]))
            edges.append(level if switch.variable == "x" else level / omega)
    if function.remembered:
        levels = (condition.rhs for condition in function.regimes if condition.lhs == symbol("X"))
        known = [level for level in levels if level.free_symbols <= set(names)]
        edges += [abs(float(compiled((level,), names)(*numbers)[0])) for level in known]
    return edges


def _upward(
    function: DescribingFunction, values: Mapping[str, float], omega: float
) -> tuple[Array, list[Array]]:
    """Go up in amplitude until the powers of k(X) or c(X) have changed."""
    fields = {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}
    X, curves = np.empty(0), [np.empty(0)] * 2
    for low, high in ((-6, -2), (-2, 0), (0, 2), (2, 4)):
        some = np.geomspace(10.0**low, 10.0**high, 12 * (high - low), endpoint=False)
        found = function.harmonics(some, np.zeros(some.shape), np.full(some.shape, omega), fields)[:2]
        if not np.all(np.isfinite(found)):
            break
        X = np.concatenate((X, some))
        curves = [np.concatenate(parts) for parts in zip(curves, found, strict=True)]
        with np.errstate(all="ignore"):
            slopes = [np.gradient(np.log(np.abs(curve)), np.log(X)) for curve in curves]
        if any(np.nanmax(np.abs(slope - slope[0]), initial=0.0) > TURNED for slope in slopes):
            break
    return X, curves


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
    if function.remembered:
        curves.insert(2, ("Energy of a cycle D", np.pi * omega * X**2 * found.damping, "J"))
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
    lines = textwrap.wrap(f"n = {law}", WIDTH)[:4]
    for name, rate in function.memory.items():
        lines += textwrap.wrap(f"{name}' = {rate}", WIDTH)[:2]
    lines += [*textwrap.wrap(f"SI: {', '.join(entries)}", WIDTH)]
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
