"""The proof of a closed form: random cycles in all regimes, and quadrature of the law as it is written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.describing.closed import ClosedPart
from rsgen.describing.quadrature import Cycle, Projections, project
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.pieces import NormalForm

__all__ = ["LEAST_SETS", "PROOF_TOLERANCE", "Trial", "draw_trial", "worst_error"]

PROOF_TOLERANCE = 1e-10
"""Largest difference between a closed form and quadrature, relative to the mean absolute force."""

LEAST_SETS = 20
"""Parameter sets on which a law must be defined for a proof to count."""

SETS_A_REGIME = 12

_SHRUNK = (1.0, 0.3, 0.09, 0.0025)
"""Factors of the amplitudes that are tried in turn: a law may be defined for small motions only."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Random cycles of a law, and what quadrature of the law as written gives on them.

    ``reference`` are stiffness, damping and mean force; ``size`` the mean absolute force in the same units.
    """

    cycle: Cycle
    reference: tuple[Array, Array, Array]
    size: tuple[Array, Array, Array]


def _thresholds(form: NormalForm, parameters: tuple[sympy.Symbol, ...], cycle: Cycle) -> Array:
    """Give (n, t) amplitudes at which switches start to act, in ascending order."""
    columns = []
    for switch in form.switches:
        if switch.threshold is None or switch.threshold.is_zero:
            continue
        (level,) = compiled((switch.threshold,), parameters)(*cycle.parameters)
        columns.append(np.abs(level - cycle.mean) if switch.variable == "x" else np.abs(level) / cycle.omega)
    if not columns:
        return np.empty((len(cycle.X), 0))
    return np.sort(np.stack(np.broadcast_arrays(*columns, cycle.X)[:-1], axis=-1), axis=1)


def draw_trial(
    force: sympy.Expr,
    form: NormalForm,
    parameters: tuple[sympy.Symbol, ...],
    centred: bool,
    seed: int,
) -> Trial:
    """Draw parameters of sizes around one, and amplitudes between all thresholds in turn.

    Parameters known as positive to sympy are drawn positive, others of either sign. Sets on which the law is
    not defined are left out; when hardly any is left, smaller amplitudes are tried.
    """
    rng = np.random.default_rng(seed)
    slots = 1 + sum(s.threshold is not None and not s.threshold.is_zero for s in form.switches)
    n = max(2 * LEAST_SETS, SETS_A_REGIME * slots)
    for shrink in _SHRUNK:
        sizes = tuple(
            np.exp(rng.uniform(-1, 1, n)) * (1 if p.is_positive else rng.choice((-1.0, 1.0), n))
            for p in parameters
        )
        omega = np.exp(rng.uniform(-1, 1, n))
        amplitude = np.exp(rng.uniform(-1.2, 1.2, n)) * shrink
        mean = np.zeros(n) if centred else rng.normal(0, 0.5, n) * amplitude
        cycle = Cycle(amplitude, mean, omega, sizes)
        edges = _thresholds(form, parameters, cycle)
        if edges.shape[1]:
            edges = np.concatenate((0.2 * edges[:, :1], edges, 3 * edges[:, -1:]), axis=1)
            slot = np.arange(n) % (edges.shape[1] - 1)
            low, high = edges[np.arange(n), slot], edges[np.arange(n), slot + 1]
            # thresholds that coincide, or are beyond all numbers, leave nothing between them
            with np.errstate(invalid="ignore"):
                spread = (low + (high - low) * rng.uniform(0.05, 0.95, n)) * shrink**0.5
                amplitude = np.where(high - low > 1e-6 * high, spread, amplitude)
            cycle = cycle._replace(X=amplitude)
        found = project(force, form, parameters, cycle)
        valid = np.isfinite(found.size) & (found.error <= 1e-11 * found.size)
        if np.count_nonzero(valid) >= LEAST_SETS:
            break
    rows = np.flatnonzero(valid)
    kept = Cycle(amplitude[rows], mean[rows], omega[rows], tuple(p[rows] for p in sizes))
    return _trial(kept, Projections(*(column[rows] for column in found)))


def _trial(cycle: Cycle, found: Projections) -> Trial:
    k, c, m = 1 / (np.pi * cycle.X), 1 / (np.pi * cycle.omega * cycle.X), 1 / (2 * np.pi)
    with np.errstate(over="ignore"):
        return Trial(
            cycle,
            (found.sine * k, found.cosine * c, found.mean * m),
            (found.size * k, found.size * c, found.size * m),
        )


def _differences(values: list[Array], trial: Trial) -> float:
    worst = 0.0
    for value, reference, size in zip(values, trial.reference, trial.size, strict=True):
        with np.errstate(all="ignore"):
            error = np.abs(value - reference) / np.maximum(size, 1e-300)
        # where no switch is on there is no force: both must be zero
        error = np.where(size > 1e-200, error, np.abs(value))
        worst = max(worst, float(np.max(np.where(np.isfinite(error), error, np.inf), initial=0.0)))
    return worst


def worst_error(
    trial: Trial,
    parameters: tuple[sympy.Symbol, ...],
    closed: ClosedPart | None,
    formulas: tuple[sympy.Expr, ...] | None,
) -> float:
    """Compare what is evaluated (closed part) or shown (formulas) with the quadrature of a trial."""
    cycle = trial.cycle
    values: list[Array] = []
    if closed is not None:
        named = dict(zip(parameters, cycle.parameters, strict=True))
        values = closed.evaluate(cycle.X, cycle.mean, cycle.omega, named)
    elif formulas is not None:
        arguments = (symbol("X"), symbol("X0"), symbol("omega"), *parameters)
        shown = compiled(formulas, arguments)(cycle.X, cycle.mean, cycle.omega, *cycle.parameters)
        values = [np.broadcast_to(value, cycle.X.shape) for value in shown]
    return _differences(values, trial)
