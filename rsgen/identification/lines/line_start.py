"""Values to start from: the law along sampled motions, linear in all that is linear, the rest searched."""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import TRIALS
from rsgen.data.multisine.spectra import rms
from rsgen.identification.fitting.scaled_columns import solve_scaled
from rsgen.identification.lines.line_balance import Lines
from rsgen.law.motion import Motion
from rsgen.law.natural_sizes import DECADES, natural_sizes
from rsgen.law.numeric import ForceLaw

__all__ = ["start_values"]

_SAMPLES = 1500
"""Instants at which a law without memory is tried: many times its parameters, spread over all motions."""
_PER_DECADE = 24
"""Values a decade where one parameter is searched alone."""
_POLISHED = 3
"""Best trials from which a descent begins."""


class _Instants:
    """Force and motion at instants of all records, each in units of its record's force."""

    def __init__(self, lines: Lines, law: ForceLaw, given: float | None) -> None:
        self.law, self.given = law, given
        spectra = lines.spectra
        samples = lines.samples
        motion = Motion(np.full(len(spectra), spectra.omega0), _cut(spectra.mean_response, lines))
        force = Motion(motion.omega, _cut(spectra.mean_force, lines)).waveforms(samples)[0]
        self.force = force - force.mean(axis=1, keepdims=True)
        self.x, self.v, self.a = motion.waveforms(samples)
        if not spectra.mean_known:
            self.x = self.x - self.x.mean(axis=1, keepdims=True)
        self.step = motion.interval(samples)
        every = max(1, self.x.size // _SAMPLES)
        self.chosen = np.zeros(self.x.shape, dtype=bool)
        # an odd stride meets all phases
        self.chosen.reshape(-1)[:: every | 1] = True
        self.weight = np.broadcast_to(1 / np.std(self.force, axis=1, keepdims=True), self.x.shape)
        size = float(np.max(rms(spectra.mean_response)))
        speed = float(np.max(np.std(self.v, axis=1)))
        self.natural = natural_sizes(law, size, speed / size, float(np.max(np.std(self.force, axis=1))))

    def rows(self, nonlinear: Array) -> tuple[Array, Array]:
        """Rows of f = m a + n + constant, a constant a record: the force has no mean worth trusting."""
        law = self.law
        values = np.zeros(len(law.parameters))
        values[list(law.nonlinear)] = nonlinear
        if law.remembers:
            sample = law.sample(self.x, self.v, self.a, self.step, values)
            pick = self.chosen
            still, slopes = sample.force[pick], [sample.by_parameter[i][pick] for i in law.linear]
        else:
            pick = self.chosen
            step = np.broadcast_to(self.step, self.x.shape)[pick][None]
            sample = law.sample(self.x[pick][None], self.v[pick][None], self.a[pick][None], step, values)
            still = np.broadcast_to(sample.force, step.shape)[0]
            slopes = [np.broadcast_to(sample.by_parameter[i], step.shape)[0] for i in law.linear]
        a, weight = self.a[pick], self.weight[pick]
        right = self.force[pick] - still - (0 if self.given is None else self.given * a)
        record = np.nonzero(pick)[0]
        constants = [(record == i).astype(float) for i in range(len(self.x))]
        columns = [*slopes, *([a] if self.given is None else []), *constants]
        return np.stack(columns, axis=1) * weight[:, None], right * weight

    def solve(self, nonlinear: Array) -> tuple[Array, float]:
        """Linear parameters and mass, and the mean square that they leave; infinite where there is none."""
        matrix, right = self.rows(nonlinear)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return np.full(matrix.shape[1], np.nan), float("inf")
        solution = solve_scaled(matrix, right)[0]
        left = right - matrix @ solution
        return solution, float(left @ left) / len(right)


def _cut(spectrum: ComplexArray, lines: Lines) -> ComplexArray:
    """The lines from the lowest clear one to the highest used; the rest is mostly noise."""
    highest = int(np.flatnonzero(lines.used.any(axis=0))[-1])
    hidden = (lines.spectra.lines > 0) & (lines.spectra.lines < lines.first[:, None])
    return np.asarray(np.where(hidden, 0, spectrum)[:, : highest + 1])


def start_values(lines: Lines, law: ForceLaw, given: float | None) -> tuple[Array, float]:
    """Find values (p,) of the law and a mass [kg] near the solution.

    Parameters
    ----------
    lines
        What is fitted.
    law
        As array functions.
    given
        m [kg]; None where it is free.
    """
    instants = _Instants(lines, law, given)
    nonlinear = _search(instants) if law.nonlinear else np.zeros(0)
    solution, _ = instants.solve(nonlinear)
    mass = float(solution[len(law.linear)]) if given is None else given
    return law.values_of(solution, nonlinear), mass


def _search(instants: _Instants) -> Array:
    """Try values around their natural sizes, and descend from the best ones."""
    from scipy.optimize import least_squares
    from scipy.stats import qmc

    law = instants.law
    natural = instants.natural[list(law.nonlinear)]
    natural = np.where(np.isfinite(natural) & (natural > 0), natural, 1.0)
    count = TRIALS // (4 if law.remembers else 1)
    if len(natural) == 1:
        shares = np.linspace(-DECADES, DECADES, int(2 * DECADES * _PER_DECADE) + 1)[:, None]
    else:
        shares = (2 * qmc.Halton(len(natural), seed=1).random(count) - 1) * DECADES
    trials = natural * 10**shares
    costs = np.array([instants.solve(trial)[1] for trial in trials])
    best, lowest = trials[int(np.argmin(costs))], float(costs.min())
    for trial in trials[np.argsort(costs, kind="stable")[:_POLISHED]]:

        def left(logs: Array) -> Array:
            matrix, right = instants.rows(np.exp(logs))
            if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
                return np.full(len(right), 1e6)
            return np.asarray(right - matrix @ solve_scaled(matrix, right)[0])

        found = least_squares(left, np.log(trial), diff_step=[1e-4] * len(trial), x_scale=0.1, max_nfev=30)
        cost = 2 * float(found.cost) / max(len(found.fun), 1)
        if cost < lowest:
            best, lowest = np.exp(found.x), cost
    return np.asarray(best)
