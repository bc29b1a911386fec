"""Checks before a run begins, and the progress of a run."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path
from typing import Any

from rsgen.cases import Case
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.data.multisine import MultisineSpectra, implausible
from rsgen.data.multisine.spectra import check_records
from rsgen.data.oscillator import refuse_across
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.identification.fitting.points import (
    Points,
    at_resonance_alone,
    mass_needs,
    per_unit_mass,
    select_points,
)
from rsgen.identification.fitting.repeats import gather_repeats
from rsgen.law.numeric import compile_law


def mass_findings(case: Case, surface: ResponseSurface) -> tuple[Finding, ...]:
    """Say that a measured test, of a mass that is not given, determines none; nothing where it does."""
    surface, model = per_unit_mass(surface, case.model)
    if model.mass is not None:
        return ()
    points = select_points(gather_repeats(surface)[0], model)
    # a law with memory has its stiffness in the area of its loops
    if not at_resonance_alone(points) or (not case.ranked and compile_law(case.model.force).remembers):
        return ()
    return (Finding("mass-at-resonance", "warning", "m", quantities(points=len(points))),)


def point_faults(case: Case, table: ResponseSurface | MultisineSpectra) -> list[str]:
    """Say why identification or ranking could not use the points of a test; nothing where they can.

    Parameters
    ----------
    case
        As it was read.
    table
        What was measured, or planned: of a virtual test all points count as settled, for none is simulated.

    Returns
    -------
    list of str
        One sentence a fault, ``file: place: what; what is allowed``.
    """
    try:
        faults = _faults_of(table, case)
    except RsgenError as fault:
        faults = [" ".join(str(fault).split())]
    return [f"{case.path.name}: {text}" for text in faults]


@singledispatch
def _faults_of(table: Any, case: Case) -> list[str]:
    points = select_points(gather_repeats(table)[0], case.model)
    return [f"model: {text}" for text in _rank_faults(case, table, points)]


@_faults_of.register
def _(table: MultisineSpectra, case: Case) -> list[str]:
    refuse_across(case.model.sensors, multisine=True)
    check_records(table, case.observation)
    return []


@singledispatch
def size_findings(table: Any, case: Case) -> list[Finding]:
    """Find what no vibration test can have, and a mass that the points do not tell."""
    odd = plausibility_findings(table, calibrated=case.observation.calibrated)
    return [*odd, *mass_findings(case, table)]


@size_findings.register
def _(table: MultisineSpectra, case: Case) -> list[Finding]:
    return list(implausible(table)) if case.observation.calibrated else []


def _rank_faults(case: Case, surface: ResponseSurface, points: Points) -> list[str]:
    if not case.ranked:
        return []
    surface.require_phase("model", "'rank' compares laws by force and phase; give a phase, or the law itself")
    needed = mass_needs(points, per_unit_mass(surface, case.model)[1])
    return [f"'rank' needs the mass, or {needed}"] if needed else []


# ----------------------------------------------------------------------------
# How far a run has come.

_PAUSE_SECONDS = 0.2
"""Minimum interval between progress messages of one stage."""


@dataclass(frozen=True, slots=True)
class Step:
    """A case has come to a stage, or to a share of it.

    Parameters
    ----------
    path
        The case file.
    stage
        "surface", "identification" or "report", in this order.
    share
        From 0 to 1; stays 0 in a stage that does not report its share.
    """

    path: Path
    stage: str
    share: float


Progress = Callable[[Step], None]


def stage_reporter(case: Case, progress: Progress | None) -> Callable[[str, float], None]:
    """Return a function of stage and share that reports every new stage, and shares now and then."""
    if progress is None:
        return lambda stage, share: None
    last = ("", 0.0)

    def report(stage: str, share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if last[0] != stage or now - last[1] > _PAUSE_SECONDS:
            last = (stage, now)
            progress(Step(case.path, stage, share))

    return report
