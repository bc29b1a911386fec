"""Sentences of a page about the whole: the test, the proof of a derivation."""

from __future__ import annotations

import math

import numpy as np

from rsgen.common.finding import Finding, State, Verdict
from rsgen.data.surface import ResponseSurface
from rsgen.formula.units.quantities import count_text, number_text, quantity_text
from rsgen.report.wording.sentences import says, sentence

__all__ = ["MARKED", "error_text", "headline", "proof_sentence", "share_text", "surface_sentence"]


def error_text(error: float | None, digits: int = 2) -> str:
    """Print a relative error in per cent.

    Examples
    --------
    >>> error_text(0.0026), error_text(None)
    ('0.26 %', '–')
    """
    return "–" if error is None or not math.isfinite(error) else f"{number_text(100 * error, digits)} %"


def share_text(share: float, bound: float) -> str:
    """Print a share in per cent, and where nothing of it is seen what it is below.

    Examples
    --------
    >>> share_text(0.012, 0.013), share_text(0.0, 0.0026)
    ('1.2 %', '< 0.26 %')
    """
    hidden = share == 0 and math.isfinite(bound) and bound > 0
    return f"< {error_text(bound)}" if hidden else error_text(share)


def surface_sentence(surface: ResponseSurface) -> str:
    """Say how many points of which levels and frequencies the test has, and whether they settled."""
    settled = int(np.count_nonzero(surface.settled))
    made = "simulated to the steady state" if surface.origin == "simulated" else "measured"
    lowest, highest = (quantity_text(float(f(surface.level)), surface.level_unit) for f in (np.min, np.max))
    forces = f"from {lowest} to {highest}" if len(surface.levels) > 1 else f"of {highest}"
    was = "was" if len(surface) == 1 else "were"
    text = (
        f"{count_text(len(surface), 'test point')} {was} {made}: {count_text(len(surface.levels), 'level')} "
        f"{forces}, {number_text(surface.frequency.min(), 5)} to "
        f"{number_text(surface.frequency.max(), 5)} Hz, "
        f"{count_text(surface.harmonics.shape[1] - 1, 'harmonic')}. "
    )
    if settled == len(surface):
        return text + "All of them settled."
    return text + f"{len(surface) - settled} did not settle and are not used."


def proof_sentence(closed_form: bool, checked_to: float | None) -> str:
    """Say how a describing function was proved, and to which relative deviation [1]."""
    form = "closed form" if closed_form else "by quadrature, no closed form is known"
    if checked_to is None or not math.isfinite(checked_to):
        return form
    deviation = number_text(checked_to, 2)
    return f"{form}; checked against independent quadrature, largest relative deviation {deviation}"


# ----------------------------------------------------------------------------
# Sentences about the verdict on a result: the headline, and what to do about what decided.

_HEADLINES: dict[State, str] = {
    "accepted": "Accepted: every judged value is within tolerance",
    "identified": "Identified: nothing was judged against a truth",
    "missed": "Missed: a judged value is outside tolerance",
    "doubtful": "Doubtful: look before you use these numbers",
    "rejected": "Rejected: these numbers are not to be used",
}
"""The headline of a state, where nothing more is known or matters."""

MARKED: dict[str, str] = {"doubtful": "Doubtful: ", "rejected": "Not to be used: "}
"""What stands before every table and figure with numbers of such a result."""


@says("values-within-tolerance")
def _(found: Finding) -> str:
    count = f"{found['judged']:.0f}"
    counted = {"1": "the one judged value", "2": "both judged values"}.get(count, f"all {count} values")
    return f"{counted} within tolerance, largest error {number_text(100 * found['largest'], 2)} %"


@says("values-outside-tolerance")
def _(found: Finding) -> str:
    return f"{found.names['values']} outside tolerance"


def headline(verdict: Verdict) -> str:
    """Say a verdict in one line, without a full stop; it begins with the state."""
    summary = verdict.summary
    if summary is None or verdict.state in ("doubtful", "rejected"):
        return _HEADLINES[verdict.state]
    if summary.code == "identified":
        return (
            f"Identified: {summary['identified']:.0f} of {summary['parameters']:.0f} parameters, misfit "
            f"{number_text(100 * summary['misfit'], 2)} %, nothing judged against a truth"
        )
    return f"{verdict.state.capitalize()}: {sentence(summary)}"  # of judged values, or of a ranking
