"""Even forces: what recorded means and even harmonics say against a symmetric law, and what nobody can say
of them where these were not recorded."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from rsgen.common.distributions import t_quantile
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import CONFIDENCE, QUICK, SAME_NUMBER, SIGNIFICANT, START_ORDER
from rsgen.identification.fitting.fit import Fit
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.problem import Problem
from rsgen.identification.misfit import fit_near, law_with
from rsgen.identification.starting.asymmetric import is_hidden, records_even

__all__ = ["even_findings", "explain_hidden", "mirror_findings", "widen_squares"]


_POWERS = {"x**2": 2, "x**4": 4, "abs(x)": 1}
"""Even forces that are tried: those of weight, of one-sided gaps and of two stiffnesses; others are nearly
made up of them; and the power of the amplitude that they go with."""


def even_findings(fit: Fit) -> list[Finding]:
    """Find an even force that a symmetric law lacks, by the mean and the even harmonics that were recorded.

    A symmetric law leaves them out of its misfit, for it has none. Beside an even force each point weighs
    them against its noise, and the force stands where they say more for it than for an offset of the sensor.
    What it does not do to the fundamental itself its odd companion may: a stop on one side has both.

    Parameters
    ----------
    fit
        The refined one.
    """
    problem = fit.problem
    # of motions that are not odd the problem says so, of its law that alone does
    if problem.law.acts_across or not records_even(problem) or not law_with(problem, "").odd:
        return []
    chosen = problem.observed.points.spread(QUICK)
    few = problem.select(chosen[fit.regression.used[chosen]])
    trials = {term: _with_even(few, fit, term) for term in _POWERS}
    term = min(trials, key=lambda term: trials[term][1].regression.noise)
    place, best, without = trials[term]
    noise = max(best.regression.noise, 1e-300)
    gain = float(np.sum(without.residual**2) - np.sum(best.regression.residual**2)) / noise**2
    if not gain - _gain_of_offset(few, without) / noise**2 > SIGNIFICANT:
        return []
    points = few.observed.points
    largest = int(np.argmax(points.amplitude))
    size = float(points.amplitude[largest])
    spring = best.mass * float(points.omega[largest]) ** 2 * size
    share = abs(best.values[place]) * size ** _POWERS[term] / spring
    if not share > SAME_NUMBER:
        return []
    numbers = quantities(share=share, amplitude=Quantity(size, "m"), errors=np.sqrt(gain))
    return [Finding("even-force-missing", "doubt", numbers=numbers, names={"term": term})]


def _with_even(problem: Problem, fit: Fit, term: str) -> tuple[int, Fit, Regression]:
    """Place of an even force among the parameters, the fit with it, and that without it."""
    values, mass, background = problem.split(fit.regression.parameters)
    law, known = law_with(problem, term), dict(zip(problem.law.parameters, values, strict=True))
    (place,) = (i for i, name in enumerate(law.parameters) if name not in known)
    start = np.array([known.get(name, 0.0) for name in law.parameters])
    held = tuple(law.parameters.index(problem.law.parameters[i]) for i in problem.held)
    trial = replace(problem, law=replace(law, odd=False))
    begin = trial.join(start, mass, background)
    without, best = (
        fit_near(replace(trial, held=places), begin, order=START_ORDER) for places in ((*held, place), held)
    )
    return place, best, without.regression


def _gain_of_offset(problem: Problem, without: Regression) -> float:
    """How much of the sum of squares a constant offset of the displacement takes up."""
    if 0 not in problem.observed.points.measured:
        return 0.0
    used, unit = without.used, 1 / problem.observed.points.amplitude
    # behind the real parts of force and fundamental
    mean = without.residual[used, 2]
    return float(np.sum(mean * unit[used]) ** 2 / np.sum(unit[used] ** 2))


def explain_hidden(problem: Problem, reasons: Mapping[str, Finding | None]) -> dict[str, Finding | None]:
    """Say of an even force without effect that the fundamental shows its square alone."""
    names = [problem.law.parameters[i] for i in problem.law.even] if is_hidden(problem) else []
    return {
        name: Finding("even-force-not-seen", "warning", name, why.numbers)
        if why is not None and why.code == "no-effect" and name in names
        else why
        for name, why in reasons.items()
    }


def mirror_findings(problem: Problem, known: Collection[str]) -> tuple[Finding, ...]:
    """Say that the law of -x fits as well, where nothing even was recorded; name ``known`` parameters."""
    law = problem.law
    if not is_hidden(problem) or records_even(problem):
        return ()
    names = [law.parameters[i] for i in law.even if law.parameters[i] in known]
    if not law.mirrored:
        return (Finding("mirror-image-fits", "warning"),)
    return (
        (Finding("sign-not-identifiable", "warning", names={"parameters": ", ".join(names)}),)
        if names
        else ()
    )


def widen_squares(problem: Problem, found: Regression) -> Regression:
    """Widen the errors of values v that the points show by their squares alone.

    What is normally distributed is v^2, with a standard error of 2 |v| e where that of v is e by its slope,
    so that its interval is v^2 +- 2 w |v| e, w standard errors wide. Where that contains zero the interval of
    v does, and has both signs; else it is as long as that between the roots.
    """
    law = problem.law
    if not is_hidden(problem) or records_even(problem) or not law.mirrored:
        return found
    even, factor = list(law.even), np.ones(len(found.covariance))
    wide = float(t_quantile(found.freedom, CONFIDENCE))
    far = np.abs(found.parameters[even]) / (wide * np.sqrt(np.diag(found.covariance)[even]))
    low, high = np.sqrt(np.maximum(far**2 - 2 * far, 0.0)), np.sqrt(far**2 + 2 * far)
    factor[even] = np.fmax(np.where(low > 0, (high - low) / 2, high), 1.0)
    return replace(found, covariance=found.covariance * np.outer(factor, factor))
