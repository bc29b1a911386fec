"""Estimates with their intervals, and what a reader should know of them, as data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsgen.common.finding import Finding, Quantity, Severity, quantities
from rsgen.common.tolerances import ERRORS, EXCESS, LARGE
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.identification.even_forces import even_findings
from rsgen.identification.fitting.fit import Fit
from rsgen.identification.fitting.phase_resonance import gap_of
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.repeats import Repeats
from rsgen.identification.misfit import misfit_findings
from rsgen.identification.results import Resonance
from rsgen.identification.results.agreement import Agreement
from rsgen.identification.results.estimates import phase_findings
from rsgen.identification.soundness import (
    aside_findings,
    feeds_exciter,
    limit_findings,
    sign_findings,
)

__all__ = [
    "Findings",
    "repeat_findings",
]


_STRONG = 0.05
"""Higher harmonics beyond this share of the fundamental bias every first-order estimate by per cents."""

_DRIFT = 0.02
"""Mean displacement, relative to the amplitude, beyond which a symmetric law misses more than an offset."""

_NO_SINE = 0.5
"""Harmonics beyond this share of the fundamental at half of the points: hardly the answer to a sine."""

_NOISE_AS_SINE = 2 * _NO_SINE
"""Harmonics beyond this share at half of the points: noise or a transient, taken for a steady sine."""

_FEW = 5
"""Points within the width of a resonance below which one outlier decides the damping."""


def of_one_mode(findings: tuple[Finding, ...], points: Points, misfit: float) -> tuple[Finding, ...]:
    """Findings of a test, with what the points that were chosen and the misfit [1] say of two modes.

    Two groups of different amplitudes are of one mode where one law fits both.
    """
    codes = {"phase-two-modes", "phase-gap"}
    rest = tuple(finding for finding in findings if finding.code not in codes)
    gap = gap_of(points)
    if len(rest) == len(findings) or gap is None or (not gap.overlap and misfit < LARGE):
        return rest
    return (*rest, gap.finding(severity="doubt"))


def repeat_findings(repeats: Repeats, misfit: float, wider: float) -> tuple[Finding, ...]:
    """How the misfit of the means compares with the scatter of repeats, and what that does to the errors.

    Parameters
    ----------
    repeats
        Readings that were joined to means.
    misfit
        Relative, of force and response together [1].
    wider
        How many times wider than by the scatter the standard errors are, half of them.
    """
    typical = float(np.median(repeats.count))
    expected = repeats.noise / np.sqrt(typical)
    found = [
        Finding(
            "repeats-scatter",
            "info",
            numbers=quantities(
                readings=len(repeats.row),
                points=len(repeats.count),
                repeats=typical,
                of_reading=repeats.noise,
                of_mean=expected,
                aside=repeats.aside,
            ),
        )
    ]
    numbers = quantities(misfit=misfit, times=misfit / expected)
    if misfit < EXCESS * expected:
        found.append(Finding("misfit-is-scatter", "info", numbers=numbers))
    else:
        found.append(Finding("misfit-beyond-scatter", "warning", numbers=quantities(**numbers, wider=wider)))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What is looked at for findings about data and fit.

    Parameters
    ----------
    surface, points
        All points of the test, and those that were fitted, without the background.
    fit
        The refined one.
    resonances
        Of all runs.
    agreement
        Of the parts of the test.
    """

    surface: ResponseSurface
    points: Points
    fit: Fit
    resonances: tuple[Resonance, ...]
    agreement: Agreement

    def collect(
        self, of_parameters: tuple[Finding, ...], about: tuple[Finding, ...], *, calibrated: bool
    ) -> tuple[Finding, ...]:
        """All findings, those about parameters first, but for what others that are known explain."""
        found = [*of_parameters, *(self._small_shift() if of_parameters else ())]
        misfit = float(self.fit.regression.noise * np.sqrt(2))
        found += of_one_mode(self.surface.findings, self.points, misfit)
        if not self.surface.phase_known:
            found.append(Finding("phase-not-recorded", "info"))
        elif feeds_exciter(self.points) and not any(
            f.code in ("base-misread", "base-scaled") for f in self.surface.findings
        ):
            found.append(Finding("structure-feeds-exciter", "error"))
        if not calibrated:
            found.append(Finding("not-calibrated", "info"))
        counts = quantities(all=len(self.surface), points=len(self.points))
        unsettled = int(np.count_nonzero(~self.surface.settled))
        if unsettled:
            found.append(
                Finding("points-not-settled", "info", numbers=quantities(unsettled=unsettled, **counts))
            )
        found += aside_findings(
            self.points,
            self.fit.regression,
            len(self.surface),
            self.surface.level_unit,
            decays=self._decays(),
        )
        found += limit_findings(self.surface.findings, self.fit)
        if not self.fit.regression.converged:
            # where the steps ended says nothing of the best values, nor do the errors there
            found.append(Finding("not-converged", "doubt"))
        wider = self.agreement.wider
        found += misfit_findings(self.surface, self.points, self.fit, self.resonances, wider)
        found += even_findings(self.fit)
        found += self.agreement.findings
        found += sign_findings(self.points, self.fit, self.agreement.wider)
        found += phase_findings(self.fit.background) if self.fit.problem.observed.phase_known else []
        found += self._motion()
        found += self._implausible(calibrated, {finding.parameter for finding in of_parameters})
        found += self._runs()
        if any(f.code == "harmonics-across-left-out" and f.severity == "doubt" for f in about):
            # what harmonics leave of the misfit another mass may take up, and is as wrong for it
            found = [finding for finding in found if finding.code != "mass-contradicted"]
        return tuple(found)

    def _implausible(self, calibrated: bool, not_identifiable: set[str]) -> Iterator[Finding]:
        mass = None if "m" in not_identifiable else self.fit.mass
        damping = min((r.damping_ratio for r in self.resonances if r.damping_ratio > 0), default=None)
        return plausibility_findings(self.surface, calibrated=calibrated, mass=mass, damping=damping)

    def _motion(self) -> list[Finding]:
        points, found = self.points, list[Finding]()
        size, noise = points.amplitude, self.fit.regression.noise
        if points.harmonics.shape[1] > 2:
            higher = np.abs(points.harmonics[:, 2:]) / size[:, None]
            # the largest of as many harmonics that are only noise
            chance = ERRORS * noise * np.sqrt(2 * np.log(max(higher.size, 2)))
            row, order = np.unravel_index(int(np.argmax(higher)), higher.shape)
            largest = float(np.median(higher.max(axis=1)))
            if largest > _NO_SINE:
                numbers = quantities(share=largest)
                severity: Severity = "error" if largest > _NOISE_AS_SINE else "doubt"
                found.append(Finding("not-a-steady-sine", severity, numbers=numbers))
            elif higher[row, order] > max(_STRONG, chance):
                numbers = quantities(
                    harmonic=2 + int(order),
                    share=float(higher[row, order]),
                    level=Quantity(float(points.level[row]), self.surface.level_unit),
                    frequency=Quantity(float(points.omega[row] / 2 / np.pi), "Hz"),
                )
                found.append(Finding("harmonic-strong", "info", numbers=numbers))
        drift = float(np.median(np.abs(points.harmonics[:, 0]) / size))
        if self.fit.problem.law.parts[0].law.odd and drift > max(_DRIFT, ERRORS * noise):
            found.append(Finding("mean-of-symmetric-law", "warning", numbers=quantities(share=drift)))
        return found

    def _decays(self) -> bool:
        """Whether the points are those of a free decay."""
        return any(finding.code == "force-of-decay" for finding in self.surface.findings)

    def _runs(self) -> list[Finding]:
        found, runs = [], len(self.resonances)
        jumps = sum(resonance.jump for resonance in self.resonances)
        # the points of a decay lie along the resonance, on neither side of it
        if jumps and not self._decays():
            found.append(Finding("resonance-jumped", "info", numbers=quantities(jumps=jumps, runs=runs)))
        few = sum(self._near(resonance) < _FEW for resonance in self.resonances)
        # loops and continuations have few points a level, and many levels
        if few and self.surface.control not in ("phase", "continuation"):
            numbers = quantities(few=few, runs=runs, points=_FEW)
            found.append(Finding("resonance-sparse", "warning", numbers=numbers))
        return found

    def _near(self, resonance: Resonance) -> int:
        """Points of the run within the width of its resonance."""
        points = self.points
        near = (points.level == resonance.level) & (points.sweep == resonance.sweep)
        width = max(2 * abs(resonance.damping_ratio), 1e-12) * resonance.frequency
        return int(np.count_nonzero(near & (np.abs(points.omega / 2 / np.pi - resonance.frequency) < width)))

    def _small_shift(self) -> list[Finding]:
        """A resonance that shifts by less than its width says little of a spring."""
        frequency = np.array([resonance.frequency for resonance in self.resonances])
        if len(frequency) < 2:
            return []
        width = float(np.median([2 * abs(r.damping_ratio) * r.frequency for r in self.resonances]))
        shift = float(np.ptp(frequency))
        if not shift < width:
            return []
        level = max(resonance.level for resonance in self.resonances)
        numbers = {
            "shift": Quantity(shift, "Hz"),
            "width": Quantity(width, "Hz"),
            "level": Quantity(level, self.surface.level_unit),
        }
        return [Finding("shift-small", "info", numbers=numbers)]
