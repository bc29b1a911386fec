"""What a test cannot say of even forces whose effect on the mean and the second harmonic was not recorded."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from rsgen.distributions import t_quantile
from rsgen.finding import Finding
from rsgen.fitting.least_squares import Regression
from rsgen.fitting.problem import Problem
from rsgen.starting.asymmetric import is_hidden, records_even
from rsgen.tolerances import CONFIDENCE

__all__ = ["explain_hidden", "mirror_findings", "widen_squares"]


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
