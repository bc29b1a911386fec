"""How long a run takes, said before it begins, and how far it has come, said while it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rsgen.case import Case
from rsgen.law.pieces import normal_form
from rsgen.simulation import SimulatedTest
from rsgen.surface import ResponseSurface

__all__ = ["STAGES", "Expectation", "Progress", "Step", "expect", "stage_reporter"]

STAGES = ("surface", "identification", "report")
"""What a run goes through, in this order."""

# Measured on one core of 2020; a law that is met for the first time is derived and compiled
_COMPILE_SECONDS = 8.0
_SURFACE_POINTS_A_SECOND = 5_000
_SMOOTH_POINTS_A_SECOND = 4_000
_SWITCHED_POINTS_A_SECOND = 1_500
_READ_SECONDS = 1.0
_IDENTIFY_SECONDS = 1.5
_REPORT_SECONDS = 5.0
_PROGRAM_MEGABYTES = 250
_BYTES_A_HARMONIC = 500
"""Copies that identification makes of a point, for each of its harmonics."""

_PAUSE_SECONDS = 0.2
"""Between two messages of one stage: no eye follows more, and a pipe takes a limited number."""


@dataclass(frozen=True, slots=True)
class Expectation:
    """Seconds of each stage and the largest memory [MB], to a factor of about three; on the high side."""

    seconds: dict[str, float]
    megabytes: int

    @property
    def total(self) -> float:
        """Seconds of the whole run."""
        return sum(self.seconds.values())


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


def expect(case: Case, surface: ResponseSurface | None = None) -> Expectation:
    """Say what a run of a case will take.

    Parameters
    ----------
    case
        The case; laws with corners and jumps take longer.
    surface
        Of a measured case, once it was read; without it nothing is known of its points.
    """
    points, harmonics = 0, 1
    if isinstance(case.test, SimulatedTest):
        points, harmonics = len(case.test.level) * len(case.test.frequency), case.test.harmonics
        simulation = _COMPILE_SECONDS + points / _SURFACE_POINTS_A_SECOND
    else:
        simulation = _READ_SECONDS
        if surface is not None:
            points, harmonics = len(surface), surface.harmonics.shape[1] - 1
    switched = any(piece.switches for piece in normal_form(case.model.force).pieces)
    rate = _SWITCHED_POINTS_A_SECOND if switched else _SMOOTH_POINTS_A_SECOND
    seconds = (simulation, _IDENTIFY_SECONDS + points / rate, _REPORT_SECONDS)
    megabytes = _PROGRAM_MEGABYTES + round(points * (harmonics + 2) * _BYTES_A_HARMONIC / 1e6)
    return Expectation(dict(zip(STAGES, seconds, strict=True)), megabytes)


def stage_reporter(case: Case, progress: Progress | None) -> Callable[[str, float], None]:
    """Give a function of stage and share that reports every new stage, and shares now and then."""
    if progress is None:
        return lambda stage, share: None
    expected = expect(case).seconds
    last = ("", 0.0)

    def report(stage: str, share: float) -> None:
        nonlocal last
        now = time.monotonic()
        if last[0] != stage or now - last[1] > _PAUSE_SECONDS:
            last = (stage, now)
            progress(Step(case.path, stage, share, expected))

    return report
