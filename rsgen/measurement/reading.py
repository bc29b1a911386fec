"""A measured file and its plan to a response surface: displacement and force as SI peak values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.measurement.columns import Columns, read_columns
from rsgen.measurement.mapping import MeasuredTest, Signal, SweepRule
from rsgen.measurement.sweep import group_levels, recognise_directions
from rsgen.surface import ResponseSurface

__all__ = ["read_measurement"]

_INTEGRATIONS = {"displacement": 0, "velocity": 1, "acceleration": 2}


class _Reader:
    """The columns of one file by their name in the case."""

    def __init__(self, test: MeasuredTest) -> None:
        self.test = test
        self.wanted = list(
            dict.fromkeys(
                column
                for column in (
                    test.frequency,
                    *_columns(test.force),
                    *_columns(test.response),
                    test.sweep.column,
                    test.level.column,
                )
                if column is not None
            )
        )
        columns = read_columns(test.file, test.layout, self.wanted, test.sha256)
        frequency = columns.values[:, self.wanted.index(test.frequency)]
        self.refuse(columns, frequency < 0, "frequency is negative; positive frequencies are needed")
        # exported receptances often begin at 0 Hz, where there is no harmonic test
        keep = frequency > 0
        if not keep.any():
            raise MeasurementError(f"{test.file.name}: no row with a frequency above 0")
        self.columns = Columns(columns.values[keep], columns.line[keep], columns.block[keep], columns.sha256)

    def refuse(self, columns: Columns, bad: NDArray[np.bool_], what: str) -> None:
        if bad.any():
            line = int(columns.line[int(np.argmax(bad))])
            raise MeasurementError(f"{self.test.file.name}: line {line}: {what}")

    def column(self, name: int | str) -> NDArray[np.float64]:
        return self.columns.values[:, self.wanted.index(name)]

    def signal(self, signal: Signal, what: str) -> NDArray[np.complex128]:
        """Assemble complex SI peak amplitudes, exp(+i omega t): a lead is a positive phase."""
        if signal.real is not None and signal.imaginary is not None:
            sense = -1 if signal.conjugate else 1
            value = self.column(signal.real) + sense * 1j * self.column(signal.imaginary)
        elif signal.amplitude is not None:
            magnitude = self.column(signal.amplitude)
            self.refuse(self.columns, magnitude < 0, f"{what} amplitude is negative; 0 or more is needed")
            turn = np.zeros_like(magnitude) if signal.phase is None else self.column(signal.phase)
            value = magnitude * np.exp(1j * signal.phase_factor * turn)
        else:
            raise MeasurementError(f"{what}: no column given; amplitude or real and imaginary needed")
        value = np.asarray(value * signal.factor, dtype=np.complex128)
        self.refuse(self.columns, ~np.isfinite(value), f"{what} is too large after conversion to SI units")
        self.refuse(self.columns, value == 0, f"{what} is zero; every point needs one that is not")
        return value

    def directions(
        self, rule: SweepRule, frequency: NDArray[np.float64], level: NDArray[np.float64]
    ) -> NDArray[np.str_]:
        if rule.column is not None:
            said = self.column(rule.column)
            up, down = (_as_number(value) for value in (rule.up, rule.down))
            return np.where(said == up, "up", np.where(said == down, "down", "rest"))
        if rule.direction == "recognise":
            return recognise_directions(frequency, level, self.columns.block)
        return np.full(len(frequency), rule.direction, dtype="U4")


def _as_number(value: int | str | None) -> float:
    try:
        return float(value if value is not None else "nan")
    except ValueError:
        raise MeasurementError(
            f"sweep: {value!r} is no number; the column of directions holds numbers"
        ) from None


def _columns(signal: Signal) -> tuple[int | str | None, ...]:
    return signal.amplitude, signal.phase, signal.real, signal.imaginary


def read_measurement(test: MeasuredTest) -> ResponseSurface:
    """Read a measured test.

    Velocity and acceleration are integrated in the frequency domain, X = V/(i omega) = -A/omega^2. The
    phase of the response counts from the force. Rows at 0 Hz are passed over. The mean is not measured by
    such a test and stands as 0; peaks, residual and error are unknown (NaN).

    Parameters
    ----------
    test
        Which file, and where in it what is found.

    Returns
    -------
    ResponseSurface
        One row a row of the file, in its order, with origin "measured".

    Raises
    ------
    MeasurementError
        The file cannot be read as the plan says; the message names file and line.
    """
    reader = _Reader(test)
    frequency = reader.column(test.frequency) * test.frequency_factor
    force = reader.signal(test.force, "force")
    response = reader.signal(test.response, "response")
    displacement = response / (2j * np.pi * frequency) ** _INTEGRATIONS[test.quantity]
    if test.level.value is not None:
        level = np.full(len(frequency), test.level.value)
    elif test.level.column is not None:
        level = reader.column(test.level.column) * test.level.factor
        reader.refuse(reader.columns, level <= 0, "level is not positive; levels above 0 are needed")
    else:
        level = group_levels(np.abs(force), test.level.spread)
    unknown = np.full(len(frequency), np.nan)
    return ResponseSurface(
        level=level,
        frequency=frequency,
        force=force,
        harmonics=np.stack([np.zeros_like(displacement), displacement], axis=1),
        peak=np.stack([unknown, unknown], axis=1),
        sweep=reader.directions(test.sweep, frequency, level),
        outcome=np.zeros(len(frequency), dtype=np.int8),
        residual=unknown,
        error=unknown,
        origin="measured",
    )
