"""Description of a test, simulated or measured, before it is run or read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError

if TYPE_CHECKING:
    from rsgen.data.multisine import MultisineSpectra
    from rsgen.data.surface import ResponseSurface


class PlannedTest(ABC):
    """A test, simulated or measured; the defaults are those of a test without prior knowledge."""

    __slots__ = ()

    @property
    def all_files(self) -> tuple[Path, ...]:
        """The measured files, each once."""
        return ()

    @property
    def many_lines(self) -> bool:
        """Return whether a record's force has many lines, so that the test gives spectra and no surface."""
        return False

    def require_surface(self, reason: str) -> None:
        """Raise an ``RsgenError`` with a reason if the test gives spectra and no response surface."""
        if self.many_lines:
            raise RsgenError(reason)

    @property
    def in_time(self) -> bool:
        """Return whether the law is integrated in time."""
        return False

    @property
    def settles(self) -> bool:
        """Return whether the response must settle under a given force before it is recorded."""
        return False

    @property
    def ends(self) -> Array:
        """(e,) frequencies [Hz] at which a law is tried with sines before the run."""
        return np.zeros(0)

    @property
    def planned_levels(self) -> Array:
        """(l,) levels that are known beforehand."""
        return np.zeros(0)

    @property
    def noise_seed(self) -> int | None:
        """Seed of simulated noise; None without it."""
        return None

    def known_mass(self, mass: float | None) -> float | None:
        """Return the mass [kg] given to identification, from that of the case; None: it is identified."""
        return mass

    def planned(self) -> ResponseSurface | MultisineSpectra | None:
        """Return the planned records, each with the same response; None for files."""
        return None

    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Return kind and settings of the test, without the extent of its records."""

    @abstractmethod
    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
