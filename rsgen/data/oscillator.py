"""Structure with one isolated mode: mass, springs and dampers; its test and what is declared of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import isfinite
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
import sympy

from rsgen.common.declaration import Rule, check, declare, documented
from rsgen.common.errors import RsgenError, known_arguments, require, require_number
from rsgen.formula.printing import write
from rsgen.formula.unit_deduction import parameter_units
from rsgen.formula.units import UNCALIBRATED, WHOLE, ForceUnits
from rsgen.law.character import character
from rsgen.law.element import Element, LawLike, as_elements
from rsgen.law.memory import equations_of
from rsgen.law.notation import latex

BACKGROUNDS = ("none", "phase", "constant", "residuals", "neighbour")
"""Kinds of background; each contains the ones before it."""

OFFSET = "+offset"
"""Ending of a kind to which a response is added that does not depend on the force."""


def _numbers(values: object, what: str, count: int | None = None) -> tuple[float, ...]:
    """Return one number or several as a tuple; ``what`` names them in the message of an RsgenError."""
    fault = RsgenError(f"{what}: {values!r:.60}; must be {'numbers' if count is None else 'numbers, a pair'}")
    try:
        found = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError):
        raise fault from None
    if isinstance(values, str) or found.ndim != 1 or len(found) != (len(found) if count is None else count):
        raise fault
    return tuple(map(float, found))


Edge = Annotated[float, Rule(unit="Hz", at_least=0)]


@documented
@dataclass(frozen=True, slots=True)
class Observation:
    """How the structure was observed: background, band, calibration, held-out levels.

    Raises RsgenError where the background is unknown or the band not ascending.
    """

    background: Literal[
        "none",
        "phase",
        "constant",
        "residuals",
        "neighbour",
        "phase+offset",
        "constant+offset",
        "residuals+offset",
        "neighbour+offset",
    ] = declare(
        "none",
        "What the sensor sees of other modes, fitted with the law: a constant phase error between force and "
        "response; and a response proportional to the force; and its change over the band, as modes below "
        "and above leave it; and one linear mode near the band. With +offset also a displacement of constant "
        "size and phase that does not depend on the force, as pick-up from the generator leaves it.",
    )
    hold_out: tuple[Annotated[float, Rule(unit="N", label=True)], ...] = declare(
        (),
        "Levels that identification must not see: a number that is a label means the run with it, any other "
        "an amount; prediction is scored on them.",
        most=1000,
    )
    predict: tuple[Annotated[float, Rule(unit="N", above=0)], ...] = declare(
        (),
        "Levels that were not tested: amplitudes of the force (also where the response was held), or "
        "accelerations of a driven base, whose response the report predicts.",
        most=20,
    )
    band: tuple[Edge, Edge] | None = declare(
        None, 'Lowest and highest frequency used and predicted, such as ["40 Hz", "45 Hz"]; all without it.'
    )
    calibrated: bool = declare(
        True,
        "False: force or response have no known scale (a drive in volts, a strain). Parameters are then per "
        "unit of the drive, and so is the mass, which cannot be given.",
    )

    def __post_init__(self) -> None:
        for name in ("hold_out", "predict"):
            object.__setattr__(self, name, _numbers(getattr(self, name), f"{name}: levels"))
        if self.band is not None:
            object.__setattr__(self, "band", _numbers(self.band, "band: two frequencies in Hz", 2))
        if self.background is None:
            object.__setattr__(self, "background", "none")
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Yield names of fields that contradict others, each with the reason."""
        if self.band is not None and self.band[0] >= self.band[1]:
            yield "band", f"{self.band[0]:g} to {self.band[1]:g} Hz; must be ascending"


# ----------------------------------------------------------------------------
# The structure itself.

KNOWN_MASS = Rule("Mass, where it is known beforehand.", unit="kg", above=0)


def total_force(elements: Iterable[Element]) -> sympy.Expr:
    """Return the sum of the forces n(x, v) [N] of elements; zero without elements."""
    return sympy.Add(*(element.force for element in elements))


class _Elements:
    """Properties of a structure that follow from its elements, with or without values of parameters."""

    __slots__ = ()

    elements: tuple[Element, ...]

    @property
    def force(self) -> sympy.Expr:
        """n(x, v) [N], the sum of all element forces."""
        return total_force(self.elements)

    @property
    def sensors(self) -> str:
        """Pair of sensors between which elements act, "" where all act on the response."""
        return max((element.across for element in self.elements), default="")

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters of the laws, sorted; the mass is not among them."""
        return _parameters(self.elements)

    @property
    def _law(self) -> str:
        """The law as Python code that makes the same elements."""
        memory = equations_of(self.force)
        return f"Law({write(self.force)!r}, memory={memory})" if memory else repr(write(self.force))

    def _repr_latex_(self) -> str:
        return f"$m \\ddot x + n(x, v) = f(t),\\quad n(x, v) = {latex(self.force)}$"


def _parameters(elements: tuple[Element, ...]) -> tuple[str, ...]:
    return tuple(sorted({name for element in elements for name in element.parameters}))


def _checked_elements(law: LawLike | Sequence[LawLike]) -> tuple[Element, ...]:
    elements = as_elements(law)
    if not elements:
        raise RsgenError("elements: none given; a structure needs at least one spring or damper")
    if "m" in _parameters(elements):
        raise RsgenError("elements: a parameter is named m, which is the mass; give it another name")
    sums = [] if isinstance(law, str) or not isinstance(law, Sequence) else law
    given = [n for one in sums if not isinstance(one, Element) for n in _parameters(as_elements(one))]
    if both := sorted({name for name in given if given.count(name) > 1}):
        raise RsgenError(
            f"elements: {', '.join(both)}: in several of the laws, whose forces add up; write one formula, "
            "or other names; laws to choose from go to rsgen.rank"
        )
    names = [element.name for element in elements]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RsgenError(
            f"elements: {', '.join(map(repr, twice))} named more than once; every name must be unique"
        )
    return elements


def _checked_values(values: Mapping[str, float], wanted: tuple[str, ...]) -> Mapping[str, float]:
    require(values, Mapping, "values")
    missing = [name for name in wanted if name not in values]
    unknown = sorted(set(values) - set(wanted))
    if missing or unknown:
        raise RsgenError(
            f"values: missing {', '.join(missing) or 'none'}; unknown {', '.join(unknown) or 'none'}; "
            f"the elements have {', '.join(wanted)}"
        )
    numbers = {name: require_number(values[name], f"values.{name}", "SI") for name in wanted}
    for name, value in numbers.items():
        if not isfinite(value):
            raise RsgenError(f"values.{name}: {value!r}; must be finite")
    return MappingProxyType(numbers)


@dataclass(frozen=True, slots=True, init=False, repr=False)
class Oscillator(_Elements):
    """m x'' + sum of element forces = f(t), with every parameter known.

    Parameters
    ----------
    mass
        m [kg], positive.
    elements
        The springs and dampers whose forces add up: a formula, an element, a law, or a sequence of these.
    values
        One finite SI value for each parameter of the elements.

    Raises
    ------
    RsgenError
        Mass not positive and finite, a value missing, unknown or not finite, element names not unique.

    Examples
    --------
    >>> Oscillator(1.5, "k*x + c*v", {"k": 5000, "c": 4})
    Oscillator(1.5, 'c*v + k*x', {'c': 4.0, 'k': 5000.0})
    """

    mass: float
    elements: tuple[Element, ...]
    values: Mapping[str, float] = field(hash=False)

    @known_arguments
    def __init__(
        self,
        mass: float,
        elements: LawLike | Sequence[LawLike] = (),
        values: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        mass = require_number(mass, "mass", "kg")
        if not (isfinite(mass) and mass > 0):
            raise RsgenError(f"mass: {mass!r} kg; must be positive and finite")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "elements", _checked_elements(elements))
        object.__setattr__(self, "values", _checked_values(values, self.parameters))

    def __repr__(self) -> str:
        """Return Python code that makes the same oscillator."""
        return f"Oscillator({self.mass:g}, {self._law}, {dict(self.values)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the values as a plain dict, so that processes can exchange oscillators."""
        return Oscillator, (self.mass, self.elements, dict(self.values))


@dataclass(frozen=True, slots=True, init=False, repr=False)
class Model(_Elements):
    """Laws without values, and the observation: the input of identification, which never sees the truth.

    Parameters
    ----------
    elements
        The candidate springs and dampers: a formula, an element, a law, or a sequence of these.
    mass
        m [kg] where it is known beforehand: the same as ``fixed={"m": mass}``.
    observation
        How the structure was observed.
    fixed
        Values of parameters that are known beforehand, SI, by name; all others are to be identified.
    mass_error
        Standard error [kg] of a mass that was weighed, half of a ± that holds for 95 %: it is then
        identified, from one more equation. A mass in ``fixed`` is held, as fits of tests whose forces follow
        it do, and its error is in all values.

    Raises
    ------
    RsgenError
        Mass not positive and finite, element names not unique, a mass given of a test that is not
        calibrated, a fixed value that is no finite number or of a parameter that the law has not, a standard
        error that is not positive or of no mass.

    Examples
    --------
    >>> Model("k*x + c*v", mass=1.5)
    Model('c*v + k*x', mass=1.5)
    """

    elements: tuple[Element, ...]
    mass: float | None
    observation: Observation
    fixed: Mapping[str, float] = field(hash=False)
    mass_error: float | None

    def __init__(
        self,
        elements: LawLike | Sequence[LawLike],
        mass: float | None = None,
        observation: Observation | None = None,
        fixed: Mapping[str, float] = MappingProxyType({}),
        mass_error: float | None = None,
    ) -> None:
        observation = Observation() if observation is None else observation
        require(observation, Observation, "observation")
        object.__setattr__(self, "elements", _checked_elements(elements))
        object.__setattr__(self, "observation", observation)
        known = self._checked(fixed, mass)
        object.__setattr__(self, "mass", known.get("m"))
        if mass_error is not None:
            mass_error = require_number(mass_error, "mass_error", "kg")
            none = "" if "m" in known else f"{mass_error:g} kg, but no mass is given"
            if fault := KNOWN_MASS.fault(mass_error) or none:
                raise RsgenError(f"mass_error: {fault}; leave it out where the mass is exact, or not known")
            if "m" not in fixed:
                del known["m"]
        object.__setattr__(self, "fixed", MappingProxyType(known))
        object.__setattr__(self, "mass_error", mass_error)

    def _checked(self, fixed: Mapping[str, float], mass: float | None) -> dict[str, float]:
        """Return the fixed values with the mass; raise an RsgenError for those that cannot be fixed."""
        require(fixed, Mapping, "fixed")
        numbers = {name: require_number(value, f"fixed.{name}", "SI") for name, value in fixed.items()}
        if mass is not None:
            mass = require_number(mass, "mass", "kg")
            if numbers.setdefault("m", mass) != mass:
                raise RsgenError(f"mass: {mass:g} kg, and {numbers['m']:g} kg in fixed; give it once")
        allowed = (*self.parameters, "m")
        foreign = sorted(repr(name)[:60] for name in numbers if name not in allowed)
        if foreign:
            mass_hint = "; the mass is m" if "mass" in numbers else ""
            raise RsgenError(
                f"fixed: {', '.join(foreign)}: no parameter; allowed are {', '.join(allowed)}{mass_hint}"
            )
        law = character(self.force) if numbers.keys() - {"m"} else None
        positive = () if law is None else tuple(law.parameters[place] for place in law.positive)
        for name, value in numbers.items():
            rule = KNOWN_MASS if name == "m" else Rule(above=0 if name in positive else None)
            if fault := rule.fault(value):
                place = "mass" if name == "m" else f"fixed.{name}"
                raise RsgenError(f"{place}: {fault}; leave it out to identify it")
        if "m" in numbers and not self.observation.calibrated:
            raise RsgenError("mass: given, but the test is not calibrated; leave the mass out, or calibrate")
        return numbers

    @property
    def exact(self) -> Mapping[str, float]:
        """The fixed values without a mass that has an error."""
        return {name: value for name, value in self.fixed.items() if name != "m" or self.mass_error is None}

    @property
    def weighed(self) -> tuple[float, float] | None:
        """m and its standard error [kg] where both are given; None where it is exact, or not known."""
        return None if self.mass is None or self.mass_error is None else (self.mass, self.mass_error)

    def __repr__(self) -> str:
        """Return Python code with law, fixed values and observation."""
        others = {name: value for name, value in self.fixed.items() if name != "m"}
        known = {"mass": self.mass, "mass_error": self.mass_error}
        parts = [self._law, *(f"{name}={value:g}" for name, value in known.items() if value is not None)]
        parts += [f"fixed={others}"] if others else []
        parts += [] if self.observation == Observation() else [f"observation={self.observation!r}"]
        return f"Model({', '.join(parts)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fixed values as a plain dict, so that processes can exchange models."""
        return Model, (self.elements, self.mass, self.observation, dict(self.fixed), self.mass_error)


_ALONG_ONE_MOTION = {
    "neighbour": "background: a neighbouring mode is not determined with elements across {!r}: noise of a "
    "difference of sensors fits as well; take 'residuals', and a band that leaves the other mode out, or "
    "measure the motion across by a sensor of its own",
    "phases": "across: phases were not recorded; elements across {!r} need them",
    "simulation": "element: acts across {!r}, but a simulated structure is one mass with one motion; leave "
    "across out of its elements, or bring the motion across and identify them",
    "levels": "levels: the law acts across {!r}, whose motion is known only where it was measured; leave "
    "levels out and give the surface, for a score of its held-out levels",
}
"""Requests that are not determined along two motions: reason and remedy."""


def refuse_across(sensors: str | int, **asked: bool) -> None:
    """Raise an RsgenError for a request that is not determined along two motions.

    Parameters
    ----------
    sensors
        Pair of sensors of the elements, or columns of the motion between sensors; "" or 0: one motion.
    asked
        Entries of ``_ALONG_ONE_MOTION``, True where requested.

    Raises
    ------
    RsgenError
        A request is True, and elements act between two sensors.
    """
    reasons = [_ALONG_ONE_MOTION[name] for name, wanted in asked.items() if wanted]
    if sensors and reasons:
        raise RsgenError(reasons[0].format(sensors))


def join_model(
    law: Model | LawLike | Sequence[LawLike],
    observation: Observation | None = None,
    mass: float | None = None,
    fixed: Mapping[str, float] = MappingProxyType({}),
    mass_error: float | None = None,
) -> Model:
    """Return a model of law, mass, observation and fixed values; arguments replace those of a model."""
    model = law if isinstance(law, Model) else Model(law)
    observation = model.observation if observation is None else observation
    mass = model.mass if mass_error is not None and mass is None and "m" not in fixed else mass
    known = Model(model.elements, mass, observation, fixed, mass_error)
    own = model if known.mass is None else known
    others = {name: value for name, value in model.fixed.items() if name != "m"}
    return Model(model.elements, own.mass, observation, {**others, **known.fixed}, own.mass_error)


def force_units(model: Model, of: ForceUnits) -> ForceUnits:
    """Return the units of a test; of one that is not calibrated only those without a force are known."""
    return of if model.observation.calibrated else UNCALIBRATED


def units_of(model: Model, of: ForceUnits = WHOLE) -> dict[str, str]:
    """SI unit of every parameter, "" where the law does not say, in those of a test (``force_units``)."""
    of = force_units(model, of)
    # names that are kept for the time and the force have no unit there
    units = dict.fromkeys(model.parameters, "")
    # a law whose terms do not agree in units can be fitted all the same
    with suppress(RsgenError):
        units |= parameter_units(model.force)
    named = {name: of.of(unit) for name, unit in units.items()}
    return {"m": of.of("kg"), **{name: "" if unit == "1" else unit for name, unit in named.items()}}
