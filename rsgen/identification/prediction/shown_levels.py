"""Levels that reports show, and their prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface, typical_amounts
from rsgen.identification.prediction.prediction_result import Prediction, ResonanceCurve
from rsgen.identification.prediction.resonance_curves import predict
from rsgen.identification.results import Identification


def choose_levels(surface: ResponseSurface, most: int = 6) -> list[float]:
    """Choose levels [N] to show from those that settled somewhere, evenly from lowest to highest.

    Parameters
    ----------
    most
        How many at most: more curves in one figure look alike.

    Examples
    --------
    >>> from rsgen.data.surface.response_surface import ResponseSurface, typical_amounts
    >>> surface = ResponseSurface(range(1, 10), [5.0] * 9, 1.0, [1.0 - 1.0j] * 9)
    >>> choose_levels(surface, 3)
    [1.0, 5.0, 9.0]
    """
    levels = np.unique(surface.level[surface.settled])
    if len(levels) > most:
        levels = levels[np.unique(np.linspace(0, len(levels) - 1, most).round().astype(int))]
    return [float(level) for level in levels]


def predict_shown(table: ResponseSurface | MultisineSpectra, identification: Identification) -> Prediction:
    """Predict what a report shows of a test: some tested levels, those held out, and those asked for."""
    asked = [] if identification.model.sensors else [*identification.model.observation.predict]
    if isinstance(table, MultisineSpectra):
        # of what identification has not seen; other spectra would count what it has seen as held out
        found = predict(identification, asked or None)
    else:
        levels = [] if identification.model.sensors else _levels(table, identification)
        found = predict(identification, sorted({*levels, *asked}) or None, table)
    largest = [_largest(found[level], table.base) for level in asked]
    return replace(found, findings=(*found.findings, *largest))


def _largest(curve: ResonanceCurve, base: str) -> Finding:
    """State the largest amplitude of a curve, its interval, and the frequencies of jumps."""
    numbers = {"level": Quantity(curve.level, curve.level_unit)}
    if len(curve.frequency):
        top = int(np.nanargmax(curve.amplitude))
        low, size, high = (float(of[top]) for of in (curve.lower, curve.amplitude, curve.upper))
        numbers |= quantities("m", amplitude=size) | quantities("Hz", at=float(curve.frequency[top]))
        numbers |= quantities("m", low=low, high=high) if low < high else {}
    jumps = ", ".join(f"{at:.5g}" for at in sorted(curve.folds[:, 0]))
    said = {"base": base, "jumps": jumps}
    return Finding(
        "level-predicted", "info", "", numbers, {name: text for name, text in said.items() if text}
    )


def _levels(surface: ResponseSurface, identification: Identification) -> list[float]:
    """Choose the levels to predict: as measured near the resonances of tested and held-out ones."""
    if surface.response_held:
        # its levels are no forces; those that the resonances needed are
        return [float(level) for level in identification.levels]
    held_out = surface.level[surface.held_out(identification.model.observation.hold_out)]
    chosen = np.isin(surface.levels, [*choose_levels(surface, 5), *held_out])
    forces = typical_amounts(surface)[chosen]
    if surface.base and not surface.per_mass:
        forces /= identification.mass
    return sorted({float(force) for force in forces if np.isfinite(force)})
