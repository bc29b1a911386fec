"""Fit of a mode without a law: stiffness and damping are free functions of the amplitude.

At one harmonic any law of one mode obeys (Krylov and Bogoliubov; docs/method.md, 4)

    F = k(X) X + c(X) V + m A,

where a steady motion has V = i omega X and A = -omega^2 X; those of a slow sweep follow from its envelopes.
With k and c sums of shapes of |X| all is linear in their coefficients and in the mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import nan

import numpy as np

from rsgen.common.arrays import Array, Chosen, ComplexArray
from rsgen.common.solvers import solve_scaled
from rsgen.common.tolerances import (
    DEVIATING_MISFIT_RATIO,
    MIN_NULL_COMPONENT,
    POINTS_PER_KNOT,
    ROUND_OFF,
    STANDARD_ERRORS_OF_DIFFERENCE,
)

_MAX_KNOTS = 32
"""Of piecewise linear curves: ten a decade follow the onset of every slider of a joint."""

MIN_RELATIVE_FORCE = 1e-3
"""Force, relative to its median, below which it is noise: errors do not shrink with it."""

_REWEIGHTINGS = 4
"""Fits with new weights; more change the mass by less than its error."""


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """Displacement [m], velocity [m/s] and acceleration [m/s^2] (n,) of one harmonic, complex."""

    displacement: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray

    @property
    def omega(self) -> Array:
        """(n,) angular frequency of the steady motion with this acceleration [rad/s].

        omega^2 = -Re(A/X), which does not depend on a slow change of the amplitude.
        """
        # NaN where nothing moves, as in a drop-out
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            ratio = np.real(self.acceleration / self.displacement)
        return np.asarray(np.sqrt(np.maximum(-ratio, 0.0)))

    def select(self, chosen: Chosen) -> Kinematics:
        """Return some of the points."""
        return Kinematics(*(getattr(self, entry.name)[chosen] for entry in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[Kinematics]) -> Kinematics:
        """Return the points of all parts, one after the other."""
        return cls(*(np.concatenate([getattr(p, entry.name) for p in parts]) for entry in fields(cls)))


def steady(force: ComplexArray, response: ComplexArray, omega: Array) -> tuple[ComplexArray, Kinematics]:
    """Return force (n,) [N] and kinematics (n,) of steady motions, with the phase of the response as zero."""
    size = np.abs(response).astype(np.complex128)
    return force * np.exp(-1j * np.angle(response)), Kinematics(size, 1j * omega * size, -(omega**2) * size)


@dataclass(frozen=True, slots=True, eq=False)
class FreeMode:
    """Fitted coefficients, curves and mass, and the residual.

    Parameters
    ----------
    values
        (q,) coefficients of k [N/m], then of the damping of each order, then the mass [kg].
    stiffness, damping
        (n,) k(X) [N/m] and, of the first order that was asked for, c(X) at every point.
    mass, mass_error
        m [kg] and its standard error, zero where the mass is given.
    left
        (n,) complex residual of the force times its weight.
    unknowns, missing
        Number of values that are not given, and of directions among these that the points do not determine.
    """

    values: Array
    stiffness: Array
    damping: Array
    mass: float
    mass_error: float
    left: ComplexArray
    unknowns: int
    missing: int

    @property
    def misfit(self) -> float:
        """Root mean square of the weighted residual."""
        return float(np.linalg.norm(self.left) / np.sqrt(len(self.left)))

    @property
    def passive(self) -> tuple[bool, bool, bool]:
        """Return whether the mass, the median of k and the median of c are positive."""
        return self.mass > 0, bool(np.median(self.stiffness) > 0), bool(np.median(self.damping) > 0)


def fit_mode(
    force: ComplexArray,
    motion: Kinematics,
    shapes: Array,
    weight: Array,
    *,
    mass: float = nan,
    orders: Sequence[int] = (1,),
) -> FreeMode:
    """Fit k(X), c(X) and m, where that is not given.

    Parameters
    ----------
    force, motion
        (n,) of one harmonic; per unit mass, the mass is 1.
    shapes
        (n, f) functions of the amplitude whose sums are k and c, at every point.
    weight
        (n,) of the residual of the force.
    mass
        m [kg]; NaN where it is free.
    orders
        Powers of the frequency with which the damping force grows at constant amplitude, 1 of dampers.
    """
    rates = [motion.velocity * (1 if order == 1 else motion.omega ** (order - 1)) for order in orders]
    factors = [factor * weight for factor in (motion.displacement, *rates, motion.acceleration)]
    real, imaginary = (
        np.column_stack([*(shapes * part[:, None] for part in parts[:-1]), parts[-1]])
        for parts in ([factor.real for factor in factors], [factor.imag for factor in factors])
    )
    right, known = force * weight, np.append(np.full(real.shape[1] - 1, nan), mass)
    values, errors, missing = _solve(real, imaginary, right, known)
    count = shapes.shape[1]
    return FreeMode(
        values,
        shapes @ values[:count],
        shapes @ values[count : 2 * count],
        float(values[-1]),
        float(errors[-1]),
        right - real @ values - 1j * (imaginary @ values),
        int(np.count_nonzero(np.isnan(known))),
        missing,
    )


def _solve(real: Array, imaginary: Array, right: ComplexArray, known: Array) -> tuple[Array, Array, int]:
    """Return real values (q,), their errors (q,), and how many directions the points do not determine.

    Columns that are real and columns that are imaginary at all points are two problems, each solved alone.

    ``known`` (q,) are values that are given, NaN of the others.
    """
    count, turned = real.shape[1], np.any(imaginary, axis=0)
    parts = [(~turned, real, right.real), (turned, imaginary, right.imag)]
    if np.any(real[:, turned]):
        matrix = np.concatenate([real, imaginary])
        parts = [(np.ones(count, dtype=bool), matrix, np.concatenate([right.real, right.imag]))]
    values, errors, missing = np.zeros(count), np.zeros(count), 0
    for chosen, matrix, target in parts:
        matrix = matrix[:, chosen]
        values[chosen], inverse, null = solve_scaled(matrix, target, known=known[chosen])
        left = np.linalg.norm(target - matrix @ values[chosen])
        freedom = max(len(target) - int(np.count_nonzero(np.isnan(known[chosen]))), 1)
        lost = np.abs(null).max(axis=1, initial=0.0) > MIN_NULL_COMPONENT
        errors[chosen] = np.where(lost, np.inf, np.hypot.reduce(inverse, axis=1) * left / np.sqrt(freedom))
        missing += null.shape[1]
    return values, errors, missing


def fit_powers(
    force: ComplexArray,
    response: ComplexArray,
    omega: Array,
    powers: Sequence[int],
    weight: Array,
    *,
    mass: float = nan,
) -> FreeMode:
    """Fit k(X), c(X) and m as ``fit_mode``, with powers of the relative amplitude as shapes."""
    largest = float(np.abs(response).max()) or 1.0
    response = response / largest
    # powers of a zero response stay above zero
    size = np.maximum(np.abs(response), np.finfo(float).tiny ** 0.25)
    shapes = np.stack([size**power for power in powers], axis=1)
    return fit_mode(*steady(force, response, omega), shapes, weight, mass=mass * largest)


def hats(amplitude: Array) -> Array:
    """Return piecewise linear functions (n, k) of the amplitude (n,), with knots at its quantiles."""
    count = int(np.clip(len(amplitude) // POINTS_PER_KNOT, 2, _MAX_KNOTS))
    knots = np.unique(np.quantile(amplitude, np.linspace(0, 1, count)))
    if len(knots) < 2:
        return np.ones((len(amplitude), 1))
    return np.stack([np.interp(amplitude, knots, row) for row in np.eye(len(knots))], axis=1)


def estimate_mass(force: ComplexArray, motion: Kinematics, shapes: Array | None = None) -> FreeMode | None:
    """Find the mass together with free curves k(X), c(X), outliers reweighted; None if it is not determined.

    With points near resonance only, curves of few knots may leave a larger misfit than the inertia: None
    where the mass does not differ significantly from zero.

    Parameters
    ----------
    force, motion
        (n,) of the fundamental, at points of one or several levels.
    shapes
        As in ``fit_mode``; None for piecewise linear ones.
    """
    if len(force) < 2 * POINTS_PER_KNOT:
        return None
    shapes = hats(np.abs(motion.displacement)) if shapes is None else shapes
    least = MIN_RELATIVE_FORCE * np.median(np.abs(force))
    weight = 1 / np.maximum(np.abs(force), least)
    for _ in range(_REWEIGHTINGS):
        found = fit_mode(force, motion, shapes, weight)
        if not (np.isfinite(found.mass) and np.isfinite(found.mass_error)):
            return None
        # relative to the force of the fit: relative to the measured one, noise of the motion biases m low
        left = found.left / weight
        scale = 1 / np.maximum(np.abs(force - left), least)
        residual = np.abs(left) * scale
        weight = scale / np.maximum(
            1.0, residual / (DEVIATING_MISFIT_RATIO * max(float(np.median(residual)), ROUND_OFF))
        )
    return found if abs(found.mass) > STANDARD_ERRORS_OF_DIFFERENCE * found.mass_error else None
