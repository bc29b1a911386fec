"""A case: what one case file declares, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import sympy

from rsgen.data.observation import Observation
from rsgen.data.oscillator import Model, Oscillator
from rsgen.dynamics.simulation import MultisineTest, SimulatedTest
from rsgen.files import MeasuredTest

__all__ = ["Case"]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A structure, a test, what to identify and how well: one case file, checked.

    Parameters
    ----------
    path
        The case file.
    name, title, source
        Folder of the report, heading, origin; printable text, never markup.
    text, sha256
        The file's text and the SHA-256 of its bytes as UTF-8.
    oscillator
        The structure with its true values; None for a measured case.
    model
        The laws without values and the observation, all that identification gets.
    test
        How the response surface comes about.
    truth
        True values in SI by parameter, "m" [kg] included; None for a measured case.
    accept
        Largest relative error of the refined estimate, by parameter, "m", or a key of
        ``force_keys.FORCE_KEYS``.
    printed
        "stiffness", "damping": formulas as the source prints them, in X, X0, omega and the parameters.
    units
        SI unit of each parameter and of "m"; "" where the law does not determine it.
    warnings
        Sentences about what is allowed but may be meant otherwise.
    ranked
        Whether the laws of the library compete with the case's own.
    """

    path: Path
    name: str
    title: str
    source: str
    text: str
    sha256: str
    oscillator: Oscillator | None
    model: Model
    test: SimulatedTest | MultisineTest | MeasuredTest
    truth: Mapping[str, float] | None
    accept: Mapping[str, float] = field(default_factory=dict)
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    ranked: bool = False

    def __post_init__(self) -> None:
        for name in ("truth", "accept", "printed", "units"):
            table = getattr(self, name)
            if table is not None:
                object.__setattr__(self, name, MappingProxyType(dict(table)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the mappings as plain dicts, so that a case is loaded once and sent to a process."""
        values = [getattr(self, name) for name in self.__dataclass_fields__]
        return Case, tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)

    @property
    def observation(self) -> Observation:
        """How the structure was observed."""
        return self.model.observation

    @property
    def folder(self) -> Path:
        """The folder of the case file."""
        return self.path.parent

    def with_model(self, model: Model) -> Case:
        """Give the case the law that a ranking found; what concerned another law is left out.

        Parameters
        ----------
        model
            Of the best candidate; the case's own one leaves the case as it is.
        """
        if model.elements == self.model.elements:
            return self
        units = {name: unit for name, unit in self.units.items() if name == "m"}
        return replace(self, model=model, truth=None, printed={}, units=units)
