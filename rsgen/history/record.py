"""The time history of a test: force and one response, sampled together."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.finding import Finding

__all__ = ["BLOCK", "QUANTITIES", "TimeHistory"]

QUANTITIES = ("displacement", "velocity", "acceleration")
BLOCK = 2**18
"""Samples looked at in one go: long histories are never copied whole."""


def _watched(values: Any, name: str, label: str) -> NDArray[Any]:
    """Look at an array without copying it: one dimension, floating point, finite, read-only."""
    array = np.asarray(values)
    if array.dtype not in (np.float32, np.float64):
        if array.dtype.kind not in "iu":
            raise MeasurementError(
                f"{label}: {name}: numbers of kind {array.dtype}; integers or floating point are needed"
            )
        array = array.astype(np.float64)
    if array.ndim != 1:
        raise MeasurementError(f"{label}: {name}: shape {array.shape}; one row of samples is needed")
    for start in range(0, len(array), BLOCK):
        finite = np.isfinite(array[start : start + BLOCK])
        if not finite.all():
            place = start + int(np.argmin(finite)) + 1
            raise MeasurementError(
                f"{label}: {name}: sample {place} is not finite; fill the gap, or leave it out by start "
                "and stop"
            )
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, slots=True, eq=False)
class TimeHistory:
    """Force and one response of a test, sampled at the same instants.

    Arrays are not copied: a long history may lie in a file that is mapped into memory. float32 and float64
    are kept as they are.

    Parameters
    ----------
    rate
        Samples per second [Hz].
    force
        (n,) [N]; all zero, or None, where nothing was measured (free decay).
    response
        (n,) displacement [m], velocity [m/s] or acceleration [m/s^2].
    quantity
        What the response is: one of QUANTITIES.
    level
        Nominal force amplitude [N], or None: to be found from the force.
    start
        Time of the first sample [s].
    label
        Names the history in messages: the file, usually.
    findings
        What was found while it was read, such as units taken from the file.

    Raises
    ------
    MeasurementError
        Rate or level not positive and finite, lengths differ, fewer than 16 samples, a sample that is not
        finite, an unknown quantity.
    """

    rate: float
    force: NDArray[Any] | None
    response: NDArray[Any]
    quantity: str = "displacement"
    level: float | None = None
    start: float = 0.0
    label: str = "time history"
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        if not (isfinite(self.rate) and self.rate > 0):
            raise MeasurementError(f"{self.label}: rate: {self.rate!r} Hz; must be positive and finite")
        if self.level is not None and not (isfinite(self.level) and self.level > 0):
            raise MeasurementError(f"{self.label}: level: {self.level!r} N; must be positive and finite")
        if not isfinite(self.start):
            raise MeasurementError(f"{self.label}: start: {self.start!r} s; must be finite")
        if self.quantity not in QUANTITIES:
            raise MeasurementError(
                f"{self.label}: quantity: {self.quantity!r}; must be one of {', '.join(QUANTITIES)}"
            )
        object.__setattr__(self, "response", _watched(self.response, "response", self.label))
        if self.force is not None:
            object.__setattr__(self, "force", _watched(self.force, "force", self.label))
            if len(self.force) != len(self.response):
                raise MeasurementError(
                    f"{self.label}: {len(self.force)} samples of force, {len(self.response)} of response; "
                    "one of each an instant is needed"
                )
        if len(self.response) < 16:
            raise MeasurementError(f"{self.label}: {len(self.response)} samples; at least 16 are needed")

    def __len__(self) -> int:
        """Count the samples."""
        return len(self.response)

    @property
    def reference(self) -> NDArray[Any]:
        """(n,) force [N]; a MeasurementError where none was measured."""
        if self.force is None:
            raise MeasurementError(f"{self.label}: no force; a forced test needs the measured force")
        return self.force

    @property
    def duration(self) -> float:
        """Length of the history [s]."""
        return len(self.response) / self.rate
