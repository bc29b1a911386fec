"""Sentences about predictions."""

from __future__ import annotations

from rsgen.finding import Finding
from rsgen.report.wording.sentences import quantity, says


@says("curve-extrapolated")
def _(found: Finding) -> str:
    return (
        f"the curve of {quantity(found, 'level')} leaves the tested amplitudes ({quantity(found, 'low')} to "
        f"{quantity(found, 'high')}): nothing is known of the law there"
    )


@says("no-steady-state")
def _(found: Finding) -> str:
    return f"no steady state in the tested frequencies under {quantity(found, 'level')}"


@says("held-out-points-missing")
def _(found: Finding) -> str:
    return (
        f"{found['missing']:.0f} of {found['points']:.0f} points of the held-out level "
        f"{quantity(found, 'level')} (sweep {found.names['sweep']}) have no predicted steady state near the "
        "measured one"
    )
