"""Interpretation of the numbers: a sentence for each spring and damper, energy, mean, printed formulas."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np

from rsgen.common.finding import Finding, Quantity
from rsgen.common.tolerances import NOISE_LIMIT_SIGMAS
from rsgen.data.surface import ResponseSurface
from rsgen.describing import PrintedComparison, compare_printed, derive
from rsgen.formula import symbol
from rsgen.formula.units.quantities import quantity_text
from rsgen.identification.results import Identification
from rsgen.law.element import Element
from rsgen.report.figures.cycles import (
    dissipated_energy,
    measured_energy,
    mode_surface,
    small_stiffness,
)
from rsgen.report.figures.equivalent import evaluated, solution_of
from rsgen.report.provenance import Subject
from rsgen.report.wording import sentence

# ----------------------------------------------------------------------------
# The energy of a cycle, of a test and of its model.


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def dissipation_entry(surface: ResponseSurface, identification: Identification) -> dict[str, Any]:
    """Return the entry "dissipation" of result.json, SI units; what is not known is null."""
    measured = measured_energy(mode_surface(surface, identification))
    refined = dissipated_energy(identification)
    values = solution_of(identification)
    ends = [0, -1] if isfinite(refined.exponent) else []
    known = np.isfinite([values[name] for name in identification.model.parameters]).all()
    rest = small_stiffness(identification, values) if known else float("nan")
    return {
        "measured": {
            "exponent": _known(measured.exponent),
            "standard_error": _known(measured.error),
            "points": len(measured.amplitude),
        },
        "identified": {
            "amplitude": [float(refined.amplitude[end]) for end in ends],
            "energy": [float(refined.energy[end]) for end in ends],
            "exponent": [float(refined.course[end]) for end in ends],
        },
        "stiffness_at_rest": _known(rest),
    }


_ROUND_OFF = 1e-9
"""Share of the total stiffness below which the stiffness of an element is round-off."""


def element_finding(element: Element, identification: Identification) -> Finding | None:
    """Find what an identified spring or damper does over the tested amplitudes; None where nothing is known.

    Parameters
    ----------
    element
        One of the model's elements.
    identification
        Gives the values and the tested range; parameters that are not identifiable are named.
    """
    identifiable = {estimate.name: estimate.identifiable for estimate in identification.refined}
    unknown = [name for name in element.parameters if not identifiable.get(name, True)]
    course = Finding("element-course", "info", names={"unknown": ", ".join(unknown)} if unknown else {})
    # the fit reproduces the test with these values, also where single ones are not identifiable
    names = sorted(identification.model.parameters)
    values = dict(zip(names, identification.solution.tolist(), strict=True))
    if len(unknown) == len(element.parameters) > 0 or not np.isfinite(list(values.values())).all():
        # without a mass the rest of a law has no values, which a damper of the velocity alone does not need
        own = np.isfinite([values[name] for name in element.parameters]).all()
        if unknown or not own or element.force.has(symbol("x")):
            return course if unknown else None
    numbers, states = _course(element, identification, values)
    return replace(course, numbers=numbers, names={**course.names} | states)


def _course(
    element: Element, identification: Identification, values: dict[str, float]
) -> tuple[dict[str, Quantity], dict[str, str]]:
    """Stiffness and damping at the smallest and at the largest amplitude, or states whose loop is open."""
    curve = identification.curve.amplitude[identification.curve.used]
    # elements across two sensors follow what the curve is over, and not the response
    followed = {element.across: (float(curve.min()), float(curve.max())), "": identification.amplitude_range}
    low, high = followed[element.across]
    omega = np.pi * sum(identification.frequency_range)
    amplitude, speed = np.array([low, high]), np.full(2, omega)
    # the mean is a matter of all elements together
    mean = evaluated(derive(identification.model.force), amplitude, speed, values).mean
    own = {name: values[name] for name in element.parameters}
    result = evaluated(derive(element), amplitude, speed, own, np.where(np.isfinite(mean), mean, 0.0))
    if not np.isfinite([result.stiffness, result.damping]).all() and element.memory:
        return {}, {"states": ", ".join(element.memory)}
    numbers = {"amplitude_first": Quantity(low, "m"), "amplitude_last": Quantity(high, "m")}
    # an element has a share in stiffness or damping when it is not round-off of the whole
    size = float(np.nanmax(np.abs(identification.curve.stiffness), initial=0.0))
    kinds = (("stiffness", "N/m", 1.0, result.stiffness), ("damping", "N*s/m", omega, result.damping))
    for kind, unit, rate, value in kinds:
        if np.isfinite(value).all() and np.abs(value).max() * rate > _ROUND_OFF * size:
            for end, number in zip(("first", "last"), value.tolist(), strict=True):
                numbers[f"{kind}_{end}"] = Quantity(number, identification.curve.units.of(unit))
    return numbers, {}


def describe_elements(elements: Iterable[Element], identification: Identification) -> dict[str, str]:
    """Return the sentence of every element by its name."""
    said = {element.name: element_finding(element, identification) for element in elements}
    return {name: sentence(finding) for name, finding in said.items() if finding is not None}


def mean_sentence(surface: ResponseSurface, identification: Identification | None = None) -> str:
    """Say between which peaks the largest response swings; "" where its mean is negligible.

    Parameters
    ----------
    surface
        Its largest settled response is described.
    identification
        Source of the noise level; None where it is not known.
    """
    settled = np.flatnonzero(surface.settled)
    if not settled.size:
        return ""
    i = int(settled[np.argmax(surface.amplitude[settled])])
    mean, amplitude = float(surface.harmonics[i, 0].real), float(surface.amplitude[i])
    noise = 0.0 if identification is None or not np.isfinite(identification.noise) else identification.noise
    if (
        abs(mean) < max(1e-3, NOISE_LIMIT_SIGMAS * noise) * amplitude
        or not np.isfinite(surface.peak[i]).all()
    ):
        return ""
    high, low, middle = (quantity_text(float(value), "m", 3) for value in (*surface.peak[i], mean))
    return f"At the largest response the displacement swings from {low} to {high} about a mean of {middle}."


_POINTS = 240
"""Amplitudes at which a formula in print is compared with the derivation."""


def check_printed(subject: Subject, identification: Identification) -> tuple[PrintedComparison, ...]:
    """Hold every formula that the source prints against the derivation, with the refined values.

    Raises
    ------
    RsgenError
        A formula is of something else than stiffness or damping, or has names that the law does not have.
    """
    model = identification.model
    values = {name: float(identification.values[name]) for name in model.parameters}
    low, high = identification.amplitude_range
    if not (subject.printed and np.isfinite(list(values.values())).all() and 0 < low < high):
        return ()
    omega = np.pi * sum(identification.frequency_range)
    return compare_printed(
        derive(model.force), subject.printed, values, np.linspace(low, high, _POINTS), omega
    )
