"""Records of a multisine as a ranking sees them: every law is compared at the lines of all records.

The reference motion is the measured mean motion of each record, with the lines that noise hides or that were
not recorded as the best law so far gives them (``lines.line_balance``). Along it the balance of forces is
linear in mass and coefficients of any law. Lines are weighted by the noise that the scatter of the periods
shows, and what noise of the motion does to the force of the best law is taken off all laws.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import MISFIT_NEGLIGIBLE
from rsgen.data.multisine.spectra import MultisineSpectra, check_records
from rsgen.data.oscillator import Model
from rsgen.identification.fitting.across import law_of
from rsgen.identification.lines.line_balance import LawAlongRecord, SpectralLines, along_records, select_lines
from rsgen.identification.lines.line_fit import (
    LineFit,
    fit_lines,
    max_misfit_of_noise,
    relative_to_force,
    start_values,
)
from rsgen.identification.lines.line_identification import mean_may_be_offset, offset_findings
from rsgen.identification.ranking.balance import MAX_MOTION_DISTANCE, Trajectory, WhitenedBalance
from rsgen.identification.ranking.candidate_fit import (
    MAX_UNEXPLAINED,
    CandidateFit,
    CandidateLaw,
    Misfit,
    RankedTest,
    Round,
    fit_candidate,
)
from rsgen.identification.ranking.library_sums import base_elements, surrogates
from rsgen.law.element import Element
from rsgen.law.numeric import ForceLaw


@dataclass(frozen=True, slots=True, eq=False)
class LineBalance(WhitenedBalance):
    """The balance at the used lines of all records, a motion a record and two rows a line.

    Parameters
    ----------
    fit
        The law of the motion, fitted to the lines.
    records
        That law along the motion of each record.
    """

    fit: LineFit
    records: tuple[LawAlongRecord, ...]

    @classmethod
    def along(cls, fit: LineFit) -> LineBalance:
        """Return the balance along the motions of a fitted law."""
        mode, spectra, law = fit.mode, fit.mode.spectra, len(fit.values)
        records = along_records(mode, fit.law, fit.values.tobytes(), fit.mass)
        motions = [[record.mean.trajectory for record in records]]
        if mode.far is not None:
            share = fit.law.parts[1].share
            far = map(mode.far_waves, range(len(mode)))
            moved = (
                (share * np.array(own[:3]) + other, own[3])
                for own, other in zip(motions[0], far, strict=True)
            )
            motions.append([(*waves, step) for waves, step in moved])
        line = fit.linearise(fit.parameters, fit.nuisance)
        inertia = line.by_parameter[:, :, law]
        rows = cls(
            trajectories=tuple(_joined(motion) for motion in motions),
            inertia=inertia,
            right=np.empty_like(inertia),
            background=line.by_parameter[:, :, law + 1 :],
            background_at=fit.background,
            background_weight=_background_effect(mode) / MAX_MOTION_DISTANCE,
            compared=np.ones(2, dtype=bool),
            level=np.repeat(spectra.level, fit.lines.used.sum(axis=1)),
            sensors=fit.law.parts[-1].sensors,
            weighed=mode.weighed,
            fit=fit,
            records=records,
        )
        # at the values of the fit the rows leave what the fit leaves, without the bias by noise
        own = [rows.of_law(part.law, fit.values[part.parameters], part.sensors)[0] for part in fit.law.parts]
        return replace(rows, right=line.residual + fit.mass * inertia + sum(own))

    def project(self, forces: Array) -> Array:
        """Return the rows (lines, 2, j) of j forces (r, samples, j) along the trajectory."""
        used, weight = self.fit.lines.used, np.sqrt(2 / self.fit.variance)
        parts = zip(self.records, forces, weight, used, strict=True)
        found = [
            (record.lines_of(np.ascontiguousarray(f.T)) * scale)[:, own].T for record, f, scale, own in parts
        ]
        lines = np.concatenate(found)
        return np.stack([lines.real, lines.imag], axis=1)

    def power(self, residual: Array) -> Array:
        """Return the power (r, H+1) [N^2] at each line of a residual (lines, 2)."""
        used = self.fit.lines.used
        power = np.zeros(used.shape)
        power[used] = np.sum(residual**2, axis=1) * self.fit.variance[used] / 2
        return power


def _joined(motions: Sequence[Trajectory]) -> Trajectory:
    """Return the trajectories of records, each a row of one array."""
    x, v, a, step = (np.concatenate(parts) for parts in zip(*motions, strict=True))
    return x, v, a, step


def _background_effect(mode: SpectralLines) -> Array:
    """Root mean square relative change (b,) of force and motion by the values of the background."""
    force, motion = mode.spectra.mean_force, mode.spectra.mean_response
    changes = [mode.change_of_mode(record, force[record]) for record in range(len(mode))]
    sizes = [
        [
            np.linalg.norm(part, axis=1) / np.linalg.norm(whole[record, 1:])
            for part, whole in zip(change, (force, motion), strict=True)
        ]
        for record, change in enumerate(changes)
    ]
    return np.asarray(np.sqrt(np.mean(np.sum(np.square(sizes), axis=1), axis=0)))


@dataclass(frozen=True, slots=True, eq=False)
class RecordRound(Round):
    """A round at the lines of records."""

    rows: LineBalance
    counted: ClassVar[str] = "lines"

    @property
    def mean_unbalanced(self) -> bool:
        """True if the leader has a mean force that was not recorded."""
        return bool(offset_findings(self.rows.fit))

    @property
    def noise(self) -> float:
        """Noise of the balance of the mean periods, relative to the force; NaN with one period."""
        return self.rows.fit.relative_noise

    def relative(self, residual: Array) -> float:
        """Return the root mean square of a residual (lines, 2), relative to the force of each record."""
        return relative_to_force(self.rows.fit.lines, self.rows.power(residual))

    def misfit(self, fitted: CandidateFit) -> Misfit:
        """Return what a law leaves beyond the scatter of the periods."""
        fit, total = self.rows.fit, self.relative(fitted.residual)
        known = bool(np.isfinite(self.noise)) or total <= MISFIT_NEGLIGIBLE
        by_chance = float(np.sqrt(np.mean(fitted.residual**2))) < max_misfit_of_noise(fit)
        beyond = max(total**2 - np.nan_to_num(self.noise) ** 2, 0)
        systematic = 0.0 if known and by_chance else float(np.sqrt(beyond))
        fits = not known or systematic <= MAX_UNEXPLAINED
        return Misfit(systematic, 0.0 if fits else systematic, {}, known)


class RecordTest(RankedTest):
    """Records of a multisine.

    Parameters
    ----------
    spectra
        The test.
    base
        A model with observation and mass.
    given
        Laws of the user.
    sensors
        Between which elements act; "" where all follow the response.

    Raises
    ------
    RsgenError
        A held-out level is not in the records, or too few lines are left.
    """

    def __init__(
        self,
        spectra: MultisineSpectra,
        base: Model,
        given: Collection[tuple[Element, ...]] = (),
        sensors: str = "",
    ) -> None:
        held_out = check_records(spectra, base.observation)
        self._spectra = spectra.select(np.flatnonzero(~held_out))
        self._base, self._given, self._sensors = base, given, sensors
        self.fixed, self.means = base.fixed, spectra.means
        for elements in given:
            law_of(elements, self.means)
        linear = law_of(tuple(base_elements(sensors).values()))
        self._lines = self._select(linear)
        if 2 * self._lines.used.sum() <= len(linear.parameters) + 1:
            raise RsgenError("ranking: no more lines than parameters in the band")
        with np.errstate(all="ignore"):
            # a linear law would put its misfit into a background
            laws = map(law_of, surrogates(sensors)) if len(self._lines.subtracted) else [linear]
            fits = [self._fit(law) for law in laws]
        self.first = LineBalance.along(min(fits, key=lambda fit: fit.misfit if fit.mass > 0 else np.inf))
        self._lines = self.first.fit.mode

    def without_mean(self) -> RecordTest | None:
        """Return the records without their mean, if that of the force is zero; None where it is another."""
        if not mean_may_be_offset(self._spectra):
            return None
        spectra = replace(self._spectra, mean_known=False)
        return RecordTest(spectra, self._base, self._given, self._sensors)

    def _select(self, law: ForceLaw) -> SpectralLines:
        share = law.parts[-1].share
        return select_lines(self._spectra, self._base, switched=law.switched, share=share)

    def _fit(self, law: ForceLaw) -> LineFit:
        lines = self._select(law)
        return fit_lines(lines, law, self.fixed, *start_values(lines, law, self.fixed))

    def start(self, name: str, elements: tuple[Element, ...]) -> CandidateLaw:
        """Return a law with initial values from the balance at sampled instants."""
        candidate = CandidateLaw(name, elements, {})
        law = candidate.law
        with np.errstate(all="ignore"):
            values, mass = start_values(self._lines, law, self.fixed)
        return replace(candidate, values={**law.named(values), "m": mass})

    def along(self, candidate: CandidateLaw, before: Round | None) -> RecordRound | None:
        """Fit a law to all lines; None if the fit does not stay finite."""
        law = candidate.law
        with np.errstate(all="ignore"):
            begin = law.ordered(candidate.values), candidate.values["m"]
            fit = fit_lines(self._select(law), law, self.fixed, *begin)
            if not np.isfinite(fit.parameters).all():
                return None
            # a misfit of this law must not hide that another fits better
            floor = MISFIT_NEGLIGIBLE**2 * fit.mode.power(fit.mass)
            known = np.isfinite(fit.noise.variance)
            fit = replace(fit, variance=np.where(known, np.maximum(fit.noise.variance, floor), fit.variance))
            rows = LineBalance.along(fit)
            found = replace(candidate, values={**law.named(fit.values), "m": fit.mass})
            leader = fit_candidate(found, rows, self.fixed)
        return None if leader.fault else RecordRound(rows, leader)
