"""Dynamic stiffness  F/X = k(X) - m omega^2 + i omega c(X, omega)  solved for the parameters of a law.

The linear parameters are solved for exactly at every trial of the others (variable projection), so that only
breakpoints, exponents and the like have to be searched.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.equations import Equations, equation_rows
from rsgen.identification.least_squares import NULL_PART, solve_scaled
from rsgen.identification.search import search_nonlinear
from rsgen.law.numeric import ForceLaw

__all__ = ["Equations", "LinearSolution", "point_misfit", "solve_equations"]

Array = NDArray[np.float64]

_SEARCH_POINTS = 120


@dataclass(frozen=True, slots=True, eq=False)
class LinearSolution:
    """Values of all parameters, mass, relative misfit, and covariance of (values, mass if free)."""

    values: Array
    mass: float
    misfit: float
    covariance: Array


def solve_equations(
    equations: Equations, law: ForceLaw, mass: float | None, near: Array | None = None
) -> LinearSolution:
    """Solve for all parameters of the law, and for the mass where it is None.

    Parameters
    ----------
    equations, law, mass
        What is solved.
    near
        (p,) values whose nonlinear ones lead to the solution; None searches their whole range.
    """
    chosen = np.argsort(np.abs(equations.harmonics[:, 1]), kind="stable")
    few = chosen[np.unique(np.linspace(0, len(chosen) - 1, _SEARCH_POINTS).round().astype(np.intp))]
    nonlinear = np.zeros(0)
    if law.nonlinear:
        begin = None if near is None else near[list(law.nonlinear)]
        nonlinear = search_nonlinear(equations.select(few), law, mass, begin)
    matrix, right = equation_rows(equations, law, mass, nonlinear)
    solution, _, _ = solve_scaled(matrix, right)
    residual = right - matrix @ solution
    values = _assemble(law, nonlinear, solution)
    if law.nonlinear:
        matrix = np.column_stack([matrix, _nonlinear_columns(equations, law, mass, nonlinear, solution)])
    _, inverse, null = solve_scaled(matrix, right)
    freedom = max(len(right) - matrix.shape[1], 1)
    covariance = inverse @ inverse.T * float(residual @ residual) / freedom
    order = [*law.linear, *([len(values)] if mass is None else []), *law.nonlinear]
    lost = np.abs(null).max(axis=1, initial=0.0) > NULL_PART
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    sorted_covariance = np.empty_like(covariance)
    sorted_covariance[np.ix_(order, order)] = covariance
    misfit = float(np.sqrt(residual @ residual / max(len(right), 1)))
    return LinearSolution(values, float(solution[-1]) if mass is None else mass, misfit, sorted_covariance)


def point_misfit(equations: Equations, law: ForceLaw, solution: LinearSolution) -> Array:
    """(n,) how far each point is from the solution, relative to its force."""
    linear = np.append(solution.values[list(law.linear)], solution.mass)
    bare = replace(equations, mean=False, turning=np.zeros((0, 2)))
    matrix, right = equation_rows(bare, law, None, solution.values[list(law.nonlinear)])
    misfit = right - matrix @ linear
    return np.asarray(np.hypot(*np.split(misfit, 2)))


def _assemble(law: ForceLaw, nonlinear: Array, solution: Array) -> Array:
    values = np.zeros(len(law.parameters))
    values[list(law.linear)] = solution[: len(law.linear)]
    values[list(law.nonlinear)] = nonlinear
    return values


def _nonlinear_columns(
    equations: Equations, law: ForceLaw, mass: float | None, nonlinear: Array, solution: Array
) -> Array:
    columns = []
    for i in range(len(nonlinear)):
        step = np.zeros(len(nonlinear))
        step[i] = 1e-5 * max(abs(nonlinear[i]), 1e-300)
        high, low = (
            matrix @ solution - right
            for matrix, right in (
                equation_rows(equations, law, mass, nonlinear + step),
                equation_rows(equations, law, mass, nonlinear - step),
            )
        )
        columns.append((high - low) / (2 * step[i]))
    return np.stack(columns, axis=1)
