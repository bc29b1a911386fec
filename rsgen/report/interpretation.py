"""What the numbers mean, in sentences: one for each spring and damper."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np
import scipy
import sympy

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity
from rsgen.common.tolerances import CHANCE, NORMAL
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.describing import DescribingFunction, compare_printed, derive
from rsgen.formula import symbol
from rsgen.formula.names import remembers
from rsgen.identification.results import Identification
from rsgen.law.element import Element
from rsgen.law.numeric import compile_law
from rsgen.report.figures import force_function, number_text, quantity_text
from rsgen.report.figures.cycles import (
    Energy,
    dissipated_energy,
    identified_slips,
    measured_energy,
    mode_surface,
    small_stiffness,
)
from rsgen.report.figures.equivalent import evaluated, solution_of, standard_errors
from rsgen.report.provenance import Subject
from rsgen.report.wording import sentence

__all__ = [
    "PrintedFormula",
    "check_printed",
    "describe_elements",
    "dissipation_entry",
    "dissipation_findings",
    "element_findings",
    "free_frequency",
    "mean_finding",
    "slip_findings",
]


# ----------------------------------------------------------------------------
# What a test and its model say about the energy of a cycle: for the page as a finding, for result.json.


def _energies(surface: ResponseSurface, identification: Identification) -> tuple[Energy, Energy]:
    return measured_energy(mode_surface(surface, identification)), dissipated_energy(identification)


def dissipation_findings(surface: ResponseSurface, identification: Identification) -> list[Finding]:
    """Find with which power of the amplitude the energy of a cycle grows, as measured and as identified."""
    measured, refined = _energies(surface, identification)
    found = []
    if isfinite(measured.exponent):
        numbers = {
            "exponent": Quantity(measured.exponent),
            "half_width": Quantity(NORMAL * measured.error),
            "points": Quantity(len(measured.amplitude)),
        }
        found.append(Finding("energy-measured", "info", numbers=numbers))
    if isfinite(refined.exponent):
        numbers = {}
        for name, end in (("first", 0), ("last", -1)):
            numbers[name] = Quantity(float(refined.course[end]))
            numbers[f"amplitude_{name}"] = Quantity(float(refined.amplitude[end]), "m")
        found.append(Finding("energy-identified", "info", numbers=numbers))
    return found


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def dissipation_entry(surface: ResponseSurface, identification: Identification) -> dict[str, Any]:
    """Give the entry "dissipation" of result.json, SI units; what is not known is null."""
    measured, refined = _energies(surface, identification)
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
        "macro_slip": [
            {"amplitude": slip.amplitude, "force": slip.force} for slip in identified_slips(identification)
        ],
    }


def slip_findings(element: Element, identification: Identification) -> list[Finding]:
    """Find from which amplitude on an element slides as a whole, where the test determines it."""
    return [
        Finding(
            "slides-as-a-whole",
            "info",
            numbers={"amplitude": Quantity(slip.amplitude, "m"), "force": Quantity(slip.force, "N")},
            names={
                "below": "sticks" if slip.sticks else "micro-slip",
                "tested": "yes" if slip.amplitude < identification.amplitude_range[1] else "no",
            },
        )
        for slip in identified_slips(identification, element.force)
    ]


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
    curve = identification.curve.amplitude[identification.curve.used]
    # those across two sensors do not follow the response
    followed = {element.across: (float(curve.min()), float(curve.max())), "": identification.amplitude_range}
    low, high = followed[element.across]
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
            unit = identification.curve.units.of(unit)
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


# ----------------------------------------------------------------------------
# The exact frequency of free vibration, by energy: what no describing function approximates.


def free_frequency(force: Callable[[float], float], mass: float, high: float) -> float:
    """Compute the frequency [Hz] of undamped free vibration with the upper turning point at ``high``.

    The period is 2 integral dx / sqrt(2 (U(high) - U(x)) / m) between the turning points; x is a sine of
    an angle, which removes the singular ends.

    Parameters
    ----------
    force
        Spring force [N] at x [m], pushing back on both sides of zero; a corner there costs no accuracy.
    mass
        m [kg].
    high
        Upper turning point [m], above zero.

    Returns
    -------
    float
        NaN where the spring does not push back, so that there is no vibration.

    Examples
    --------
    A bilinear spring has exactly omega = 2 w6 w7/(w6 + w7) (docs/method.md, 2):

    >>> bilinear = free_frequency(lambda x: 4.0 * x if x > 0 else 9.0 * x, 1.0, 1.0)
    >>> round(bilinear * 2 * np.pi, 9), round(2 * 2.0 * 3.0 / 5.0, 9)
    (2.4, 2.4)
    """

    # a third of a second, and needed only for laws with a formula in print
    def work(x: float) -> float:
        return float(scipy.integrate.quad(force, 0.0, x, epsabs=0.0, epsrel=1e-11, limit=200)[0])

    energy = work(high)
    reach = high
    if not (energy > 0 and force(high) > 0):
        return float("nan")
    for _ in range(60):
        if work(-reach) >= energy:
            break
        reach *= 1.3
    else:
        return float("nan")
    low = float(scipy.optimize.brentq(lambda x: work(x) - energy, -reach, 0.0, xtol=1e-15 * high, rtol=1e-14))
    half = sum(_time(force, mass, end) for end in (low, high))
    return 1 / (2 * half)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


def _time(force: Callable[[float], float], mass: float, end: float) -> float:
    """Compute the time [s] from zero to the turning point ``end``.

    With x = end sin(a), the energy left at x is integrated from x on, so that it keeps
    its digits where it vanishes.
    """
    angles: Array = np.pi / 4 * (_NODES + 1)
    total = 0.0
    for angle, weight in zip(angles.tolist(), _WEIGHTS.tolist(), strict=True):
        x = end * np.sin(angle)
        # end - x without cancellation: 1 - sin(a) = 2 sin^2((pi/2 - a)/2)
        left = end * 2 * np.sin((np.pi / 2 - angle) / 2) ** 2
        points = x + left * (_NODES + 1) / 2
        energy = left / 2 * float(np.dot(_WEIGHTS, [force(point) for point in points.tolist()]))
        total += weight * abs(end) * np.cos(angle) / np.sqrt(2 * energy / mass)
    return float(np.pi / 4 * total)


# ----------------------------------------------------------------------------
# Formulas as a source prints them, held against the derivation.

_POINTS = 240
_UNITS = {"stiffness": "N/m", "damping": "N*s/m"}


@dataclass(frozen=True, slots=True)
class PrintedFormula:
    """The verdict on one printed formula: whether it equals the derivation, and what that means.

    Parameters
    ----------
    what
        "stiffness" or "damping".
    largest_deviation
        Relative to the derived value [1].
    where
        The amplitude of the largest deviation, in words; "" where there is none.
    """

    what: str
    formula: sympy.Expr
    agrees: bool
    largest_deviation: float
    where: str
    sentences: tuple[str, ...]


def _number(formula: sympy.Expr, values: dict[str, float], X: float, X0: float, omega: float) -> float:
    """Evaluate a printed formula at one point."""
    named = {**values, "X": X, "X0": X0, "omega": omega}
    value = sympy.N(formula.subs({symbol(name): number for name, number in named.items()}))
    return float(value) if value.is_real else float("nan")


def check_printed(subject: Subject, identification: Identification) -> tuple[PrintedFormula, ...]:
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
    derived = derive(model.force)
    amplitude = np.linspace(low, high, _POINTS)
    omega = 2 * np.pi * float(np.mean(identification.frequency_range))
    checked = []
    for item in compare_printed(derived, subject.printed, values, amplitude, omega):
        verdict = PrintedFormula(item.what, item.formula, item.agrees, item.largest_deviation, "", ())
        if not item.agrees and "X" in item.where:
            verdict = _place(verdict, derived, values, float(item.where["X"]), omega)
        if item.what == "stiffness" and derived.mean != 0:
            verdict = _with_period(verdict, derived, model, identification, omega)
        checked.append(verdict)
    return tuple(checked)


def _place(
    item: PrintedFormula, derived: DescribingFunction, values: dict[str, float], X: float, omega: float
) -> PrintedFormula:
    """Say how much and where a formula departs, in units that people read."""
    exact = derived.evaluate([X], omega, values)
    right = float((exact.stiffness if item.what == "stiffness" else exact.damping)[0])
    printed = _number(item.formula, values, X, float(exact.mean[0]), omega)
    unit = _UNITS[item.what]
    place = f"X = {quantity_text(X, 'm', 3)}"
    words = (
        f"The largest deviation over the tested range is {number_text(100 * item.largest_deviation, 3)} "
        "% of the "
        f"derived value, at {place}: printed {quantity_text(printed, unit)}, derived "
        f"{quantity_text(right, unit)}."
    )
    return replace(item, where=place, sentences=(words,))


def _with_period(
    item: PrintedFormula,
    derived: DescribingFunction,
    model: Model,
    identification: Identification,
    omega: float,
) -> PrintedFormula:
    """Add what free vibration says: it judges between formulas for a law that pushes the mean off zero."""
    values = {name: float(identification.values[name]) for name in model.parameters}
    high, mass = identification.amplitude_range[1], identification.mass
    force, still = force_function(model, values), np.zeros(1)
    exact = free_frequency(lambda x: float(force(np.array([x]), still)[0]), mass, high)
    balanced = derived.evaluate([high], omega, values)
    mean = float(balanced.mean[0])
    stiffness = {
        "the printed formula": _number(item.formula, values, high, mean, omega),
        "the derivation with the mean": float(balanced.stiffness[0]),
    }
    if not (np.isfinite(exact) and all(k > 0 for k in stiffness.values())):
        return item
    said = []
    for name, k in stiffness.items():
        frequency = float(np.sqrt(k / mass)) / (2 * np.pi)
        said.append(
            f"{name} gives {quantity_text(k, 'N/m')} and so {number_text(frequency, 5)} Hz "
            f"({_signed(frequency / exact - 1)} in frequency, "
            f"{_signed((frequency / exact) ** 2 - 1)} in stiffness)"
        )
    words = (
        f"Free vibration of the identified spring has exactly {number_text(exact, 5)} Hz, by energy "
        "between its "
        f"two turning points; {'; '.join(said)}. The law pushes the mean to {quantity_text(mean, 'm', 3)} at "
        f"X = {quantity_text(high, 'm', 3)}."
    )
    return replace(item, sentences=(*item.sentences, words))


def _signed(change: float) -> str:
    return f"{100 * change:+.2f} %".replace("-", "−")
