"""A structure with one isolated mode: mass, springs and dampers, and the values of their parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from types import MappingProxyType

import sympy

from rsgen.errors import RsgenError
from rsgen.law.element import Element
from rsgen.observation import Observation

__all__ = ["Model", "Oscillator"]


def _total_force(elements: Iterable[Element]) -> sympy.Expr:
    return sympy.Add(*(element.force for element in elements))


def _parameters(elements: Iterable[Element]) -> tuple[str, ...]:
    return tuple(sorted({name for element in elements for name in element.parameters}))


def _check_elements(elements: tuple[Element, ...]) -> None:
    if not elements:
        raise RsgenError("elements: none given; a structure needs at least one spring or damper")
    names = [element.name for element in elements]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RsgenError(
            f"elements: {', '.join(map(repr, twice))} named more than once; every name must be unique"
        )


@dataclass(frozen=True, slots=True)
class Oscillator:
    """m x'' + sum of element forces = f(t), with every parameter known.

    Parameters
    ----------
    mass
        m [kg], positive.
    elements
        The springs and dampers whose forces add up.
    values
        One finite SI value for each parameter of the elements, no more and no less.

    Raises
    ------
    RsgenError
        Mass not positive and finite, a value missing, unknown or not finite, element names not unique.
    """

    mass: float
    elements: tuple[Element, ...]
    values: Mapping[str, float] = field(hash=False)

    def __post_init__(self) -> None:
        if not (isfinite(self.mass) and self.mass > 0):
            raise RsgenError(f"mass: {self.mass!r} kg; must be positive and finite")
        object.__setattr__(self, "elements", tuple(self.elements))
        _check_elements(self.elements)
        wanted = _parameters(self.elements)
        missing = [name for name in wanted if name not in self.values]
        unknown = sorted(set(self.values) - set(wanted))
        if missing or unknown:
            raise RsgenError(
                f"values: missing {', '.join(missing) or 'none'}; unknown {', '.join(unknown) or 'none'}; "
                f"the elements have {', '.join(wanted)}"
            )
        values = {name: float(self.values[name]) for name in wanted}
        for name, value in values.items():
            if not isfinite(value):
                raise RsgenError(f"values.{name}: {value!r}; must be finite")
        object.__setattr__(self, "values", MappingProxyType(values))

    @property
    def force(self) -> sympy.Expr:
        """n(x, v) [N], the sum of all element forces."""
        return _total_force(self.elements)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, sorted; the order of ``values``."""
        return _parameters(self.elements)

    def __reduce__(self) -> tuple[type[Oscillator], tuple[float, tuple[Element, ...], dict[str, float]]]:
        """Pickle the values as a plain dict, so that processes can exchange oscillators."""
        return Oscillator, (self.mass, self.elements, dict(self.values))


@dataclass(frozen=True, slots=True)
class Model:
    """What identification gets: laws without values, so that truth cannot leak.

    Parameters
    ----------
    elements
        The candidate springs and dampers.
    mass
        m [kg] where it is known beforehand; None where it is to be identified.
    observation
        How the structure was observed.

    Raises
    ------
    RsgenError
        Mass not positive and finite, element names not unique, or a mass given of a test that is not
        calibrated.
    """

    elements: tuple[Element, ...]
    mass: float | None = None
    observation: Observation = field(default_factory=Observation)

    def __post_init__(self) -> None:
        object.__setattr__(self, "elements", tuple(self.elements))
        _check_elements(self.elements)
        if self.mass is not None and not (isfinite(self.mass) and self.mass > 0):
            raise RsgenError(f"mass: {self.mass!r} kg; must be positive and finite, or None to identify it")
        if self.mass is not None and not self.observation.calibrated:
            raise RsgenError("mass: given, but the test is not calibrated; leave the mass out, or calibrate")

    @property
    def force(self) -> sympy.Expr:
        """n(x, v) [N], the sum of all element forces."""
        return _total_force(self.elements)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters of the laws, sorted; the mass is not among them."""
        return _parameters(self.elements)
