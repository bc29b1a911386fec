"""What the numbers mean, in sentences: one for each spring and damper."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rsgen.describing import derive
from rsgen.element import Element
from rsgen.figures import number_text, quantity_text
from rsgen.identification import Identification
from rsgen.identification.force_law import compile_law
from rsgen.surface import ResponseSurface

__all__ = ["describe_element", "describe_elements", "describe_mean"]

_LEAST_CHANGE = 5e-4
"""Relative change below which an equivalent property counts as constant: a line width in the figures."""

_LEAST_FORCE = 1e-3
"""Share of the largest force below which a force at rest or a departure from a straight line is none."""


def _percent(change: float) -> str:
    return f"{number_text(100 * abs(change), 2)} %"


def _course(kind: str, first: float, last: float, unit: str, low: str, high: str) -> str:
    change = last / first - 1 if first else float("inf")
    if abs(change) < _LEAST_CHANGE:
        return f"linear: {kind} stays at {quantity_text(first, unit)} from {low} to {high}"
    if kind == "stiffness":
        word = "hardening" if change > 0 else "softening"
    else:
        word = "damping grows with amplitude" if change > 0 else "friction-like, damping falls with amplitude"
    if not np.isfinite(change):
        return f"{word}: {kind} comes up from zero to {quantity_text(last, unit)} at {high}"
    if abs(change) < 3:
        verb = "rises" if change > 0 else "falls"
        return (
            f"{word}: {kind} {verb} by {_percent(change)}, from {quantity_text(first, unit, 3)} at {low} to "
            f"{quantity_text(last, unit, 3)} at {high}"
        )
    return (
        f"{word}: {kind} goes from {quantity_text(first, unit, 3)} at {low} to "
        f"{quantity_text(last, unit, 3)} "
        f"at {high}, {number_text(last / first, 2)} times as much"
    )


def describe_element(element: Element, identification: Identification) -> str:
    """Say in a sentence what an identified spring or damper does over the tested amplitudes.

    Parameters
    ----------
    element
        One of the model's elements.
    identification
        Gives the values and the tested range; parameters that the test does not tell are named.
    """
    values = {name: identification.values[name] for name in element.parameters}
    unknown = [name for name, value in values.items() if not np.isfinite(value)]
    if unknown:
        return f"not told by this test: {', '.join(unknown)}"
    low, high = identification.amplitude_range
    middle = 2 * np.pi * sum(identification.frequency_range) / 2
    ends, speeds = np.array([low, high]), np.array([middle, middle])
    # the mean is a matter of all elements together
    whole = derive(identification.model.force).evaluate(ends, speeds, dict(identification.values))
    centred = np.where(np.isfinite(whole.mean), whole.mean, 0.0)
    result = derive(element).evaluate(ends, speeds, values, mean=centred)
    stiffness, damping, mean = (
        np.broadcast_to(np.asarray(part, dtype=float), (2,))
        for part in (result.stiffness, result.damping, result.mean)
    )
    places = (quantity_text(low, "m", 2), quantity_text(high, "m", 2))
    words = []
    # an element has a share in stiffness or damping when it is not round-off beside the whole
    size = float(np.nanmax(np.abs(identification.curve.stiffness), initial=0.0))
    if np.abs(stiffness).max() > 1e-9 * size:
        words.append(_course("stiffness", float(stiffness[0]), float(stiffness[1]), "N/m", *places))
    if np.abs(damping).max() * middle > 1e-9 * size:
        words.append(_course("damping", float(damping[0]), float(damping[1]), "N*s/m", *places))
    if abs(mean[1]) > 1e-6 * high and np.abs(stiffness).max() > 1e-9 * size:
        words.append(
            f"the mean moves to {quantity_text(float(mean[1]), 'm', 2)} at {places[1]}, "
            f"{_percent(float(mean[1]) / high)} of the amplitude"
        )
    return "; ".join(words) if words else "no force over the tested amplitudes"


def describe_elements(elements: Iterable[Element], identification: Identification) -> dict[str, str]:
    """Give the sentence of every element by its name."""
    return {element.name: describe_element(element, identification) for element in elements}


def _one_sided(identification: Identification, low: float, high: float) -> bool:
    """Tell whether the identified spring is without force at rest and no straight line from low to high."""
    law = compile_law(identification.model.force)
    point = np.array([identification.values[name] for name in law.parameters])
    x = np.append(np.linspace(low, high, 101), 0.0)
    force = law.force(x, np.zeros_like(x), point)
    size = float(np.max(np.abs(force)))
    if not (np.isfinite(size) and abs(force[-1]) <= _LEAST_FORCE * size):
        return False
    line = np.polynomial.Polynomial.fit(x, force, 1)
    return bool(np.max(np.abs(line(x) - force)) > _LEAST_FORCE * size)


def describe_mean(surface: ResponseSurface, identification: Identification | None = None) -> str | None:
    """Say what the two peaks tell about a law with a mean; None where the mean is negligible.

    Parameters
    ----------
    surface
        Its largest settled response is described.
    identification
        The peaks tell the stiffness of the two sides only where its law has no force at rest and a spring
        that is not linear: a constant force moves the mean of a linear spring as well.
        Without it only the swing is told.

    With light damping the energy at the two turning points is the same: for a bilinear spring
    k6 Xp^2 = k7 Xn^2 (METHOD.md 2, from Liu et al., Sec. 2.5).
    """
    settled = np.flatnonzero(surface.settled)
    if not settled.size:
        return None
    i = int(settled[np.argmax(surface.amplitude[settled])])
    mean, amplitude = float(surface.harmonics[i, 0].real), float(surface.amplitude[i])
    if abs(mean) < 1e-3 * amplitude or not np.isfinite(surface.peak[i]).all():
        return None
    high, low = (abs(float(value)) for value in surface.peak[i])
    swing = (
        f"At the largest response the displacement swings from {quantity_text(-low, 'm', 3)} to "
        f"{quantity_text(high, 'm', 3)} about a mean of {quantity_text(mean, 'm', 3)}."
    )
    bottom, top = float(surface.peak[i, 1]), float(surface.peak[i, 0])
    if identification is None or not _one_sided(identification, bottom, top):
        return swing
    return (
        f"{swing} The energy at the two turning points is the same when damping is light, so the "
        "stiffness on the positive side is about "
        f"(negative peak / positive peak)² = {number_text((low / high) ** 2, 3)} times that on the "
        "negative side."
    )
