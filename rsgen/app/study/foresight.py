"""What is said of a run before it begins, what it would refuse and how long it takes; and how far it is."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, singledispatch
from pathlib import Path
from typing import Any

import numpy as np
import sympy

from rsgen.cases import Case
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.data.multisine import MultisineSpectra, implausible
from rsgen.data.multisine.spectra import check_records, refuse_across
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.dynamics.kernel import generate, is_stored
from rsgen.dynamics.simulation import MultisineTest, SimulatedTest
from rsgen.dynamics.steady_state import LOCATED
from rsgen.formula.names import remembers
from rsgen.identification.fitting.points import Points, at_resonance_alone, select_points
from rsgen.identification.fitting.repeats import gather_repeats
from rsgen.law.memory import rates_of
from rsgen.law.numeric import compile_law
from rsgen.law.pieces import normal_form

__all__ = [
    "STAGES",
    "Expectation",
    "Progress",
    "Step",
    "expect",
    "mass_findings",
    "point_faults",
    "size_findings",
    "stage_reporter",
]


def mass_findings(case: Case, surface: ResponseSurface) -> tuple[Finding, ...]:
    """Say that a measured test, of a mass that is not given, determines none; nothing where it does."""
    if case.model.mass is not None or surface.per_mass or not surface.phase_known:
        return ()
    points = select_points(gather_repeats(surface)[0], case.model)
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
    refuse_across(case.model)
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
    faults = []
    if not surface.phase_known:
        faults.append("'rank' compares laws by force and phase; a phase, or the law itself, is needed")
    if case.model.mass is None and np.ptp(points.omega) == 0:
        faults.append("'rank' needs the mass, or tests at more than one frequency")
    elif mass_findings(case, surface):
        faults.append("'rank' needs the mass, or points off phase resonance")
    return faults


# ----------------------------------------------------------------------------
# How long a run takes, and how far it has come.

STAGES = ("surface", "identification", "report")
"""What a run goes through, in this order."""

# Processor seconds of the eight cases and five measured tests, on a machine that needs _PROBE_SECONDS.
_START_SECONDS = 3.0
"""The program and its libraries are loaded."""
_COMPILE_SECONDS = {False: 2.2, True: 5.0}
"""A law without and with switches is compiled; once, then it is in the cache."""
_SURFACE_POINTS_A_SECOND = 20_000
_IDENTIFY_SECONDS = {False: 0.5, True: 1.2}
_POINTS_A_SECOND = {False: 5_000, True: 2_000}
_SEARCH_SECONDS = {False: 2.2, True: 5.0}
"""Of a law with memory, for each searched parameter after the first: without and with states."""
_SECONDS_A_LOOP = 0.002
"""A point whose loop is closed, for each searched parameter of a law with memory."""
_STATES_REPORT_SECONDS = 12.0
"""More for figures of laws with states, whose loops have no closed form."""
_RANK_SECONDS_A_POINT = {False: 0.03, True: 0.1}
"""All laws together, without and with a background, which is fitted with each."""
_RANKED_REPORT_SECONDS = 15.0
"""More for the curves of a law that a ranking puts together beside a background."""
_RANK_POINTS = 500
"""More points than these are thinned out before laws are ranked."""
_SECONDS_A_RECORD = {False: 0.2, True: 1.5}
"""Of a virtual multisine."""
_LINES_A_POINT = 100
"""Lines of single periods that cost as much as a point of a surface."""
_REPORT_SECONDS = 4.0
_PROGRAM_MEGABYTES = 250
_BYTES_A_HARMONIC = 500
"""Copies that identification makes of a point, for each of its harmonics."""

_PROBE_STEPS = 20_000
"""Of a loop by which the speed of a machine is measured: short against a program's turn on a processor."""
_PROBES = 5
"""Loops, of which the shortest counts: no other program had a turn in it."""
_PROBE_SECONDS = 0.00115
"""What the loop took where the seconds above were measured."""

_PAUSE_SECONDS = 0.2
"""Between two messages of one stage: no eye follows more, and a pipe takes a limited number."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """How long a run takes on this machine now, to a factor of about two.

    Parameters
    ----------
    seconds
        Of the processor, by stage.
    megabytes
        The largest memory [MB].
    crowding
        Programs that share a processor, at least 1: the factor by which it takes longer.
    """

    seconds: dict[str, float]
    megabytes: int
    crowding: float = 1.0

    @property
    def total(self) -> float:
        """Seconds of the processor for the whole run."""
        return sum(self.seconds.values())


@lru_cache(maxsize=1)
def _slowness() -> float:
    """Time that this machine takes over that of the machine where the constants were measured."""

    def probe() -> float:
        started, total = time.perf_counter(), 0
        for step in range(_PROBE_STEPS):
            total += step * step % 7
        return time.perf_counter() - started

    return min(probe() for _ in range(_PROBES)) / _PROBE_SECONDS


def _crowding() -> float:
    """Programs that want a processor, the run among them, over processors; 1 where nobody says."""
    if not hasattr(os, "getloadavg"):
        return 1.0
    return max(1.0, (os.getloadavg()[0] + 1) / (os.cpu_count() or 1))


@dataclass(frozen=True, slots=True)
class Step:
    """A case has come to a stage, or to a share of it.

    Parameters
    ----------
    path
        The case file.
    stage
        One of ``STAGES``.
    share
        From 0 to 1; stays 0 in a stage that does not report its share.
    expected
        Seconds of each stage, as expected before the run.
    """

    path: Path
    stage: str
    share: float
    expected: dict[str, float]


Progress = Callable[[Step], None]


def expect(
    case: Case, surface: ResponseSurface | MultisineSpectra | None = None, reading: float = 0.0
) -> Expectation:
    """Say what a run of a case will take.

    Parameters
    ----------
    case
        The case; laws with corners and jumps take longer.
    surface
        Of a measured case, once it was read; without it nothing is known of its points.
    reading
        Processor seconds that reading it took.
    """
    law, test = case.model.force, case.test
    switched = any(piece.switches for piece in normal_form(law).pieces)
    points, harmonics, simulation = 0, 1, reading / _slowness()
    if isinstance(test, SimulatedTest):
        points, harmonics = len(test.level) * test.per_level, test.harmonics
        simulation = points / _SURFACE_POINTS_A_SECOND
        if case.oscillator is not None and test.method == "time":
            located = test.accuracy < LOCATED
            source = generate(law, values=case.oscillator.values, locate_all=located)
            simulation += 0.0 if is_stored(source) else _COMPILE_SECONDS[switched]
    elif isinstance(test, MultisineTest):
        records = len(test.level) * test.realisations
        points = records * test.periods * test.highest // _LINES_A_POINT
        simulation = records * _SECONDS_A_RECORD[switched]
    elif isinstance(surface, MultisineSpectra):
        points = len(surface) * surface.periods * len(surface.lines) // _LINES_A_POINT
    elif surface is not None:
        points, harmonics = len(surface), surface.harmonics.shape[1] - 1
    identification, report = _of_law(law, switched, points)
    if case.ranked:
        behind = case.observation.background != "none"
        identification += _RANK_SECONDS_A_POINT[behind] * min(points, _RANK_POINTS)
        report += _RANKED_REPORT_SECONDS * behind
    seconds = (_START_SECONDS + simulation, identification, report)
    megabytes = _PROGRAM_MEGABYTES + round(points * (harmonics + 2) * _BYTES_A_HARMONIC / 1e6)
    here = {stage: second * _slowness() for stage, second in zip(STAGES, seconds, strict=True)}
    return Expectation(here, megabytes, _crowding())


def _of_law(force: sympy.Expr, switched: bool, points: int) -> tuple[float, float]:
    """Processor seconds of identification and report, by what the law is."""
    identification = _IDENTIFY_SECONDS[switched] + points / _POINTS_A_SECOND[switched]
    if not remembers(force):
        return identification, _REPORT_SECONDS
    law, states = compile_law(force), bool(rates_of(force))
    searched = max(len(law.nonlinear) - len(law.scaled), 1)
    identification += _SEARCH_SECONDS[states] * (searched - 1) + _SECONDS_A_LOOP * searched * points
    return identification, _REPORT_SECONDS + _STATES_REPORT_SECONDS * states


def stage_reporter(case: Case, progress: Progress | None) -> Callable[[str, float], None]:
    """Give a function of stage and share that reports every new stage, and shares now and then."""
    if progress is None:
        return lambda stage, share: None
    expectation = expect(case)
    expected = {stage: s * expectation.crowding for stage, s in expectation.seconds.items()}
    last = ("", 0.0)

    def report(stage: str, share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if last[0] != stage or now - last[1] > _PAUSE_SECONDS:
            last = (stage, now)
            progress(Step(case.path, stage, share, expected))

    return report
