"""What the numbers mean, in sentences: one for each spring and damper."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity
from rsgen.common.tolerances import CHANCE, NORMAL
from rsgen.data.surface import ResponseSurface
from rsgen.describing import derive
from rsgen.formula import symbol
from rsgen.formula.memory import remembers
from rsgen.identification.results import Identification
from rsgen.law.element import Element
from rsgen.law.numeric import compile_law
from rsgen.report.dissipation import slip_findings
from rsgen.report.figures.equivalent import evaluated, standard_errors
from rsgen.report.wording import sentence

__all__ = ["describe_elements", "element_findings", "mean_finding"]


_LEAST_CHANGE = 5e-4
"""Relative change below which an equivalent property counts as constant: a line width in the figures."""

_LEAST_FORCE = 1e-3
"""Share of the largest force below which a force at rest or a departure from a straight line is none."""

_TURN = 0.05
"""Share of the whole course by which it must turn back to count as two courses."""

_FACTOR = 2.0
"""From this ratio on a change is given as a factor: "falls by 99.7 %" says little."""

_DEGREES = {0: "constant force", 2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}


@dataclass(frozen=True, slots=True)
class _Course:
    """How stiffness or damping of an element goes over the tested amplitudes.

    ``amplitude`` and ``value`` (n,) ascending in amplitude; ``error`` standard error of last minus first;
    ``shape`` is the law's in a word, "" where there is none; ``frequency`` [Hz] where it matters, else None.
    """

    kind: str
    unit: str
    amplitude: Array
    value: Array
    error: float
    shape: str
    linear: bool
    frequency: float | None

    def finding(self, code: str, turn: int = 0, numbers: Mapping[str, Quantity] | None = None) -> Finding:
        """Make a finding of this course with values and amplitudes of its ends, and of where it turns."""
        numbers = dict(numbers or {})
        for name, i in (("first", 0), ("last", -1), ("turn", turn)):
            if name != "turn" or turn:
                numbers |= {
                    f"value_{name}": Quantity(float(self.value[i]), self.unit),
                    f"amplitude_{name}": Quantity(float(self.amplitude[i]), "m"),
                }
        if self.frequency is not None:
            numbers["frequency"] = Quantity(self.frequency, "Hz")
        names = {"kind": self.kind, "shape": self.shape, "linear": "yes" if self.linear else "no"}
        return Finding(code, "info", numbers=numbers, names=names)


def _course_finding(course: _Course) -> Finding:
    """Find whether a course stays, turns back, is within its error, or rises or falls, and by how much."""
    first, last = float(course.value[0]), float(course.value[-1])
    size = float(np.abs(course.value).max())
    if float(np.ptp(course.value)) < _LEAST_CHANGE * size:
        middle = Quantity(float(np.median(course.value)), course.unit)
        return course.finding("course-constant", numbers={"value": middle})
    turn = _turning(course.value)
    if turn:
        return course.finding("course-turns", turn)
    change, half = last - first, NORMAL * course.error
    if half > abs(change):
        within = {"change": Quantity(change, course.unit), "half_width": Quantity(half, course.unit)}
        return course.finding("course-not-resolved", numbers=within)
    if abs(first) < 1e-9 * size:
        return course.finding("course-from-zero")
    if first * last <= 0:
        return course.finding("course-changes-sign")
    if last < 0:
        return course.finding("course-negative")
    factor = max(last / first, first / last)
    if factor >= _FACTOR:
        return course.finding("course-by-factor", numbers={"factor": Quantity(factor)})
    return course.finding("course-by-share", numbers={"share": Quantity(abs(change / first))})


def _turning(value: Array) -> int:
    """Give the index where a course turns back; 0 where it does not."""
    low, high = float(min(value[0], value[-1])), float(max(value[0], value[-1]))
    span = float(np.ptp(value))
    if low - float(value.min()) > _TURN * span:
        return int(np.argmin(value))
    return int(np.argmax(value)) if float(value.max()) - high > _TURN * span else 0


def _shape(force: sympy.Expr) -> str:
    """Name the nonlinear part of a law by its degree; "" where it has none or is no sum of powers."""
    if force.has(sympy.Piecewise, sympy.Heaviside, sympy.Max, sympy.Min):
        return "piecewise"
    x, v = symbol("x"), symbol("v")
    size = sympy.Symbol("size", positive=True)
    names: dict[sympy.Expr, str] = {}
    for term in sympy.Add.make_args(sympy.expand(force)):
        scaled = sympy.expand_power_base(term.subs({x: size * x, v: size * v}, simultaneous=True))
        power = (scaled / term).as_base_exp()
        if scaled != term and power[0] != size:
            return ""
        degree = sympy.Integer(0) if scaled == term else power[1]
        if degree == 0 and (term.has(x) or term.has(v)):
            names[degree] = "dry friction" if term.has(v) else "preloaded"
        elif degree not in (0, 1):
            names[degree] = _DEGREES.get(degree, f"power {degree}" if degree.is_number else "power law")
    if len(names) > 2 and all(degree == int(degree) for degree in names if degree.is_number):
        return f"polynomial of degree {max(names)}"
    return " and ".join(names[degree] for degree in sorted(names, key=str))


def _linear_within(
    element: Element, values: dict[str, float], high: float, fast: float, mean: float
) -> tuple[bool, bool]:
    """Find whether the force is a straight line over the tested displacements, and over the velocities."""
    law = compile_law(element.force)
    point = law.ordered(values)
    reach, rest = np.linspace(-1, 1, 101), np.zeros(101)
    x, v = (
        law.force(place, speed, point)
        for place, speed in ((mean + high * reach, rest), (mean + rest, fast * reach))
    )
    return _is_line(reach, x), _is_line(reach, v)


def _is_line(place: Array, force: Array) -> bool:
    line = np.polynomial.Polynomial.fit(place, force, 1)(place)
    return bool(np.max(np.abs(force - line)) <= _LEAST_FORCE * max(np.max(np.abs(force)), 1e-300))


def element_findings(element: Element, identification: Identification) -> list[Finding]:
    """Find what an identified spring or damper does over the tested amplitudes.

    Parameters
    ----------
    element
        One of the model's elements.
    identification
        Gives the values and the tested range; parameters that are not identifiable are named.
    """
    identifiable = {estimate.name: estimate.identifiable for estimate in identification.refined}
    unknown = [name for name in element.parameters if not identifiable.get(name, True)]
    missing = [Finding("element-not-identifiable", "warning", names={"parameters": ", ".join(unknown)})]
    # the fit reproduces the test with these values, also where single ones are not identifiable
    names = sorted(identification.model.parameters)
    values = dict(zip(names, identification.solution.tolist(), strict=True))
    if len(unknown) == len(element.parameters) > 0 or not np.isfinite(list(values.values())).all():
        # without a mass the rest of a law has no values, which a damper of the velocity alone does not need
        own = np.isfinite([values[name] for name in element.parameters]).all()
        if unknown or not own or element.force.has(symbol("x")):
            return missing if unknown else []
    found = _courses(element, identification, values)
    return [*found, *missing] if unknown else found or [Finding("element-without-force", "info")]


def _courses(element: Element, identification: Identification, values: dict[str, float]) -> list[Finding]:
    low, high = identification.amplitude_range
    if element.across:
        # what the element follows, and not the response
        followed = identification.curve.amplitude[identification.curve.used]
        low, high = float(followed.min()), float(followed.max())
    middle = sum(identification.frequency_range) / 2
    omega = 2 * np.pi * middle
    amplitude = np.unique(np.concatenate([np.linspace(low, high, 41), np.geomspace(low, high, 41)]))
    speed = np.full(amplitude.shape, omega)
    # the mean is a matter of all elements together
    whole = evaluated(derive(identification.model.force), amplitude, speed, values)
    mean = np.where(np.isfinite(whole.mean), whole.mean, 0.0)
    function = derive(element)

    def evaluate(changed: Mapping[str, float]) -> Array:
        chosen = {name: changed[name] for name in element.parameters}
        result = evaluated(function, amplitude, speed, chosen, mean)
        return np.array([result.stiffness, result.damping], dtype=float)

    parts = evaluate(values)
    if not np.isfinite(parts).all() and element.memory:
        return [Finding("loop-does-not-close", "warning", names={"states": ", ".join(element.memory)})]
    errors = standard_errors(
        identification,
        values,
        element.parameters,
        lambda changed: np.diff(evaluate(changed)[:, [0, -1]])[:, 0],
    ).tolist()
    memory = remembers(element.force)
    lines = (False, False) if memory else _linear_within(element, values, high, omega * high, float(mean[-1]))
    spring = element.force if memory else element.force.subs(symbol("v"), 0)
    findings = []
    # an element has a share in stiffness or damping when it is not round-off of the whole
    size = float(np.nanmax(np.abs(identification.curve.stiffness), initial=0.0))
    kinds = (
        ("stiffness", "N/m", 1.0, function.stiffness, spring),
        ("damping", "N*s/m", omega, function.damping, element.force - spring),
    )
    for (kind, unit, rate, formula, part), value, error, linear in zip(
        kinds, parts, errors, lines, strict=True
    ):
        if np.abs(value).max() * rate > 1e-9 * size and np.isfinite(value).all():
            frequency = middle if formula.has(symbol("omega")) else None
            shape = "hysteretic" if memory else "" if linear else _shape(part)
            unit = identification.curve.unit(unit)
            course = _Course(kind, unit, amplitude, value, error, shape, linear, frequency)
            findings.append(_course_finding(course))
    findings += slip_findings(element, identification)
    if abs(mean[-1]) > 1e-6 * high and np.abs(parts[0]).max() > 1e-9 * size:
        numbers = {
            "mean": Quantity(float(mean[-1]), "m"),
            "amplitude": Quantity(high, "m"),
            "share": Quantity(abs(float(mean[-1])) / high),
        }
        findings.append(Finding("mean-moves", "info", numbers=numbers))
    return findings


def describe_elements(elements: Iterable[Element], identification: Identification) -> dict[str, str]:
    """Give the sentence of every element by its name."""
    said = {element.name: element_findings(element, identification) for element in elements}
    return {name: "; ".join(map(sentence, findings)) for name, findings in said.items() if findings}


def _one_sided(identification: Identification, low: float, high: float) -> bool:
    """Find whether the identified spring is without force at rest and no straight line from low to high."""
    law = compile_law(identification.model.force)
    if law.odd:
        # the same on both sides: motion in one well of two has a mean as well
        return False
    point = law.ordered(identification.values)
    x = np.append(np.linspace(low, high, 101), 0.0)
    force = law.force(x, np.zeros_like(x), point)
    size = float(np.max(np.abs(force)))
    return bool(np.isfinite(size) and abs(force[-1]) <= _LEAST_FORCE * size and not _is_line(x, force))


def mean_finding(surface: ResponseSurface, identification: Identification | None = None) -> Finding | None:
    """Find what the two peaks say about a law with a mean; None where the mean is negligible.

    Parameters
    ----------
    surface
        Its largest settled response is described.
    identification
        The peaks give the stiffness of the two sides only where its law has no force at rest and a spring
        that is not linear: a constant force moves the mean of a linear spring as well.
        Without it only the swing is described.

    With light damping the energy at the two turning points is the same: for a bilinear spring
    k6 Xp^2 = k7 Xn^2 (docs/method.md, 2, from Liu et al., Sec. 2.5).
    """
    settled = np.flatnonzero(surface.settled)
    if not settled.size:
        return None
    i = int(settled[np.argmax(surface.amplitude[settled])])
    mean, amplitude = float(surface.harmonics[i, 0].real), float(surface.amplitude[i])
    noise = 0.0 if identification is None or not np.isfinite(identification.noise) else identification.noise
    if abs(mean) < max(1e-3, CHANCE * noise) * amplitude or not np.isfinite(surface.peak[i]).all():
        return None
    top, bottom = (float(value) for value in surface.peak[i])
    numbers = {"low": Quantity(bottom, "m"), "high": Quantity(top, "m"), "mean": Quantity(mean, "m")}
    if identification is not None and _one_sided(identification, bottom, top):
        numbers["stiffness_ratio"] = Quantity((bottom / top) ** 2)
    return Finding("swing-about-mean", "info", numbers=numbers)
