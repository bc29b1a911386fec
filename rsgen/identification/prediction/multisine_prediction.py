"""Responses to a multisine: the periodic motion of the identified law under the force of a record."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, frozen_array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.text_table import TextTable, short
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.multisine.records import held_out_records
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.periodic_response import periodic_response
from rsgen.identification.lines import MultisineIdentification
from rsgen.identification.prediction.prediction_result import BEYOND, Prediction, severity_of_error
from rsgen.law.numeric import compile_law

__all__ = ["MultisinePrediction", "PredictedRecord", "predict_multisine"]


@dataclass(frozen=True, slots=True, eq=False)
class PredictedRecord:
    """Measured against predicted for one record that identification has not seen.

    Parameters
    ----------
    level
        Nominal root mean square of the force [N].
    frequency
        (H+1,) of the lines [Hz].
    measured, predicted
        (H+1,) complex displacement [m] under the measured force, the mean first.
    judged
        (H+1,) lines that are scored: those of the band, never the mean or what noise hides below the others.
    error
        Root mean square of predicted - measured over that of measured, at the judged lines [1]; NaN where
        nothing was predicted.
    noise
        The same of the noise of the measured mean [1]; NaN of one period.
    """

    level: float
    frequency: Array
    measured: ComplexArray
    predicted: ComplexArray
    judged: NDArray[np.bool_]
    error: float
    noise: float

    def __post_init__(self) -> None:
        for name, kind in (
            ("frequency", float),
            ("measured", complex),
            ("predicted", complex),
            ("judged", bool),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), kind))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MultisinePrediction(Prediction):
    """Predicted responses of records; ``curves`` and ``held_out``, which are of single sines, are empty.

    Parameters
    ----------
    records
        One a record, in their order.
    """

    records: tuple[PredictedRecord, ...] = ()

    def _table(self) -> TextTable:
        rows = tuple((short(one.level), short(one.error, 3), short(one.noise, 2)) for one in self.records)
        return TextTable(
            ("level rms [N]", "error rms", "noise rms"), rows, notes=tuple(map(repr, self.findings))
        )


def predict_multisine(
    found: MultisineIdentification, spectra: MultisineSpectra | ResponseSurface | None = None
) -> MultisinePrediction:
    """Predict the periodic responses to the measured forces of records, and score them.

    Parameters
    ----------
    found
        Its refined estimate is used.
    spectra
        Records; None: those of the held-out levels.

    Raises
    ------
    RsgenError
        The spectra are none.
    """
    own = found.spectra
    if spectra is None or spectra is own:
        held = held_out_records(own, found.model.observation.hold_out)
        spectra = own.select(np.flatnonzero(held)) if held.any() else None
    if spectra is None:
        return MultisinePrediction((), (), ())
    if not isinstance(spectra, MultisineSpectra):
        raise RsgenError(f"surface: {type(spectra).__name__}; a multisine is predicted for MultisineSpectra")
    records = tuple(_record(found, spectra, i) for i in range(len(spectra)))
    findings = _findings(found, records, np.sqrt(2) * spectra.rms_response())
    return MultisinePrediction((), (), tuple(findings), records)


def _record(found: MultisineIdentification, spectra: MultisineSpectra, row: int) -> PredictedRecord:
    law = compile_law(found.model.force)
    force = np.array(spectra.mean_force[row])
    measured = spectra.mean_response[row]
    if not spectra.mean_known:
        # a sensor without mean: the force has none either, as identification takes it
        force[0] = 0.0
    response = periodic_response(law, found.solution, found.mass, spectra.omega0, force)
    predicted = response.spectrum if response.converged else np.full(len(force), nan + 0j)
    low, high = found.model.observation.band or (0.0, inf)
    judged = (spectra.frequency >= low) & (spectra.frequency <= high)
    judged &= spectra.lines >= spectra.reach()[0][row]
    size = float(np.linalg.norm(measured[judged])) or nan
    error = float(np.linalg.norm((predicted - measured)[judged])) / size
    noise = float(np.linalg.norm(spectra.noise()[1][row][judged])) / size
    level = float(spectra.level[row])
    return PredictedRecord(level, spectra.frequency, measured, predicted, judged, error, noise)


def _findings(
    found: MultisineIdentification, records: tuple[PredictedRecord, ...], amplitudes: Array
) -> list[Finding]:
    findings = []
    reach = BEYOND * found.amplitude_range[1]
    for one, amplitude in zip(records, map(float, amplitudes), strict=True):
        level = Quantity(one.level, "N")
        if not np.isfinite(one.error):
            findings.append(Finding("record-not-predicted", "doubt", numbers=quantities(level=level)))
            continue
        if amplitude > reach:
            numbers = quantities(
                level=level,
                amplitude=Quantity(amplitude, "m"),
                tested=Quantity(found.amplitude_range[1], "m"),
            )
            findings.append(Finding("record-extrapolated", "warning", numbers=numbers))
        if severity := severity_of_error(one.error):
            numbers = quantities(level=level, error=one.error, misfit=found.residual)
            findings.append(Finding("record-missed", severity, numbers=numbers))
    return findings
