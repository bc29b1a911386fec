"""Whether a response has a part that does not depend on the force, found before any law is chosen."""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import NOTICEABLE
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.any_law import driven_points, fit_any_law

__all__ = ["has_levels", "offset_findings"]


_POWERS = (-1, 0, 1, 2, 3)
"""Powers of the amplitude in k(X) and c(X); the first is dry friction. Laws of one mode are nearly made up of
them at one harmonic."""
_FEWEST = 40
"""Points, at least: some three for each value that is fitted."""
_MOST = 400
"""Points looked at, spread over the test."""
_SPREAD = 1.3
"""Ratio of the forces above which a part that follows the force and one that does not differ."""
_WEAKEST = 0.3
"""Share of the points, those of least force, from whose median a search begins: an offset is large there."""
_LEFT = 0.5
"""The offset must leave less than this share of the misfit, and of the misfit beside a background."""


def has_levels(surface: ResponseSurface) -> bool:
    """Whether a test can show an offset: phases, levels of different force, points enough."""
    force = np.abs(surface.force[driven_points(surface)])
    enough = surface.phase_known and len(surface.levels) > 1 and len(force) >= _FEWEST
    return enough and bool(force.max() > _SPREAD * force.min())


def offset_findings(surface: ResponseSurface) -> list[Finding]:
    """Find a displacement of one size and phase at every point, whatever the force; one finding or none.

    Any law obeys F/X = k(X) - m omega^2 + i omega c(X) at one harmonic. What X = x - b leaves of that is
    compared with what X = x leaves, and with what a linear background in proportion to the force leaves.

    Parameters
    ----------
    surface
        Measured; without phases or with one level nothing is found.
    """
    if not has_levels(surface):
        return []
    rows = driven_points(surface)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST)).astype(int)]
    force, response = surface.force[rows], surface.harmonics[rows, 1]
    force = force / np.abs(force).max()
    rate = surface.omega[rows] / surface.omega[rows].max()
    response = response / np.median(np.abs(response))
    weak = response[np.abs(force) <= np.quantile(np.abs(force), _WEAKEST)]
    # a large offset is not found from zero
    begin = np.array([np.median(weak.real), np.median(weak.imag)])
    misfit = _misfit(force, response, rate)
    # most tests end here
    if misfit < NOTICEABLE:
        return []
    constant = [np.ones_like(force)]
    left = min(_best_misfit(force, response, rate, constant, start) for start in (np.zeros(2), begin))
    background = _best_misfit(force, response, rate, [force, force / rate**2], np.zeros(4))
    if left > _LEFT * min(misfit, background):
        return []
    numbers = quantities(misfit=misfit, left=left)
    return [Finding("offset-possible", "info", numbers=numbers, names={"kind": "phase+offset"})]


def _misfit(force: ComplexArray, response: ComplexArray, rate: Array) -> float:
    """Relative misfit of the best law."""
    residual, _ = fit_any_law(force, response, rate, _POWERS, 1 / np.abs(force), mass=True)
    return float(np.linalg.norm(residual) / np.sqrt(len(force)))


def _best_misfit(
    force: ComplexArray, response: ComplexArray, rate: Array, parts: list[ComplexArray], begin: Array
) -> float:
    """Relative misfit of the best law, the best multiples of ``parts``, sought from ``begin``, taken off."""
    from scipy.optimize import least_squares  # a third of a second, and needed where any law misfits

    typical, weight = float(np.median(np.abs(response))), 1 / np.abs(force)
    columns = np.array([part / np.median(np.abs(part)) for part in parts])

    def rest(values: Array) -> ComplexArray:
        taken: ComplexArray = typical * (values[::2] + 1j * values[1::2]) @ columns
        return response - taken

    def residual(values: Array) -> Array:
        return fit_any_law(force, rest(values), rate, _POWERS, weight, mass=True)[0]

    values = least_squares(residual, begin, x_scale=0.1, max_nfev=60).x
    return _misfit(force, rest(values), rate)
