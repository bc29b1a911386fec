"""A structure with one isolated mode: mass, springs and dampers, and the values of their parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from types import MappingProxyType
from typing import Annotated, Any

import sympy

from rsgen.common.declaration import Rule
from rsgen.common.errors import RsgenError, require, require_number
from rsgen.data.observation import Observation
from rsgen.formula import write
from rsgen.law import Element, LawLike, as_elements
from rsgen.law.memory import equations_of
from rsgen.law.notation import latex

__all__ = ["KNOWN_MASS", "Model", "Oscillator", "join_model", "total_force"]

KNOWN_MASS = Rule("Mass, where it is known beforehand.", unit="kg", above=0)


def total_force(elements: Iterable[Element]) -> sympy.Expr:
    """Add the forces n(x, v) [N] of elements; zero of none."""
    return sympy.Add(*(element.force for element in elements))


class _Elements:
    """What a structure with values and one without have in common."""

    __slots__ = ()

    elements: tuple[Element, ...]

    @property
    def force(self) -> sympy.Expr:
        """n(x, v) [N], the sum of all element forces."""
        return total_force(self.elements)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters of the laws, sorted; the mass is not among them."""
        return _parameters(self.elements)

    @property
    def _law(self) -> str:
        """The law as Python, as it makes the same elements."""
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
        One finite SI value for each parameter of the elements, no more and no less.

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

    def __init__(
        self, mass: float, elements: LawLike | Sequence[LawLike], values: Mapping[str, float]
    ) -> None:
        mass = require_number(mass, "mass", "kg")
        if not (isfinite(mass) and mass > 0):
            raise RsgenError(f"mass: {mass!r} kg; must be positive and finite")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "elements", _checked_elements(elements))
        object.__setattr__(self, "values", _checked_values(values, self.parameters))

    def __repr__(self) -> str:
        """Mass, law and values, as they make the same oscillator."""
        return f"Oscillator({self.mass:g}, {self._law}, {dict(self.values)})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the values as a plain dict, so that processes can exchange oscillators."""
        return Oscillator, (self.mass, self.elements, dict(self.values))


@dataclass(frozen=True, slots=True, init=False, repr=False)
class Model(_Elements):
    """What identification gets: laws without values, so that truth cannot leak.

    Parameters
    ----------
    elements
        The candidate springs and dampers: a formula, an element, a law, or a sequence of these.
    mass
        m [kg] where it is known beforehand; None where it is to be identified.
    observation
        How the structure was observed.

    Raises
    ------
    RsgenError
        Mass not positive and finite, element names not unique, or a mass given of a test that is not
        calibrated.

    Examples
    --------
    >>> Model("k*x + c*v", mass=1.5)
    Model('c*v + k*x', mass=1.5)
    """

    elements: tuple[Element, ...]
    mass: Annotated[float | None, KNOWN_MASS]
    observation: Observation

    def __init__(
        self,
        elements: LawLike | Sequence[LawLike],
        mass: float | None = None,
        observation: Observation | None = None,
    ) -> None:
        observation = Observation() if observation is None else observation
        require(observation, Observation, "observation")
        mass = None if mass is None else require_number(mass, "mass", "kg")
        if mass is not None and (fault := KNOWN_MASS.fault(mass)):
            raise RsgenError(f"mass: {fault}, or None to identify it")
        if mass is not None and not observation.calibrated:
            raise RsgenError("mass: given, but the test is not calibrated; leave the mass out, or calibrate")
        object.__setattr__(self, "elements", _checked_elements(elements))
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "observation", observation)

    def __repr__(self) -> str:
        """Law, mass and what was declared about the test."""
        mass = "" if self.mass is None else f", mass={self.mass:g}"
        observed = "" if self.observation == Observation() else f", observation={self.observation!r}"
        return f"Model({self._law}{mass}{observed})"


def join_model(
    law: Model | LawLike | Sequence[LawLike],
    observation: Observation | None = None,
    mass: float | None = None,
) -> Model:
    """Join law, mass and observation; what is given explicitly wins over the model's."""
    model = law if isinstance(law, Model) else Model(law)
    return replace(
        model,
        mass=model.mass if mass is None else mass,
        observation=model.observation if observation is None else observation,
    )
