"""Whether a fit is worth its numbers: its misfit, the points it set aside, the signs of what it found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsgen.expression import parse
from rsgen.finding import Finding, Quantity, Severity, quantities
from rsgen.identification.agreement import Agreement
from rsgen.identification.data import Points
from rsgen.identification.fit import Fit, fit_balance
from rsgen.identification.least_squares import Regression
from rsgen.identification.observed import Observed
from rsgen.identification.result import Resonance
from rsgen.identification.tolerances import CHANCE, QUICK, SAMPLES, SAMPLES_SWITCHED, TURNED
from rsgen.law.numeric import compile_law
from rsgen.motion import Motion, cycle_work, project
from rsgen.observation import OFFSET
from rsgen.surface import ResponseSurface

__all__ = [
    "aside_findings",
    "feeds_exciter",
    "is_systematic",
    "misfit_findings",
    "phase_findings",
    "sign_findings",
]

Array = NDArray[np.float64]

_SYSTEMATIC = 0.3
"""Correlation of neighbouring misfits, or share of them, that is the law's, not the noise's."""

_PAIRS = 6
"""Pairs of neighbours below which their correlation says nothing."""

_PARTS = 2
"""Real and imaginary part: so many independent numbers a pair has, whatever was recorded."""

_NOTICEABLE = 1e-3
"""Misfits below this, relative, change no engineering number: a law may be as wrong."""

_POOR = 0.05
"""A systematic misfit beyond this share of force and response is more than what joints and sensors do to a
law that is right."""

_APART = 3.0
"""A level misfits so many times as much as half of the levels do: something of this level is wrong, or begins
there. Sound structures have misfits that differ by less than two."""

_SEVERAL = 4
"""Levels below which most of them cannot speak against one."""

_SCATTERS = 0.1
"""Any misfit beyond this share: noise as large hides what a law does wrong."""

_TELLING = 16
"""Points below which a pattern may not show: a damper missed by 5 % is found from here on, not at 12."""

_MEANINGLESS = 0.2
"""Any misfit beyond this share: a fifth of force and response is not what the law says."""

_TAKEN = 0.5
"""A single term that takes up more than this share of a misfit is missing from the law."""

_TERMS = ("x*abs(x)", "x**3", "x**5", "v*abs(v)", "v**3", "sign(v)")
"""Terms that are tried: the commonest nonlinear springs and dampers; others are nearly made up of them."""

_STEPS = 8
"""Gauss-Newton steps of a trial; it starts at the solution without the term."""

_REACH = 5.0
"""Half a band proposed for one mode, in widths of the resonance: there the mode has a tenth of its peak."""

_FEW_ASIDE = 0.05
"""Points set aside beyond this share are no chance outliers: a twentieth of the test is not explained."""

_MANY_ASIDE = 0.15
"""Points set aside beyond this share: what is left is a choice of points that suit the law."""

_SINGLE = 3
"""Points set aside up to this number may be single drop-outs of a small test."""

_STRETCH = 5
"""Neighbours set aside together from which on it is a piece of a run, not a jump that came early."""

_PIECE = 0.1
"""Share of a run from which on it is a piece of it."""

_WHOLE = 0.25
"""Share of a run set aside, wherever its points lie, from which on the run disagrees with the law."""

_SIGNS = 60
"""Points, evenly over the amplitude, at which the signs of k(X) and c(X) are looked at."""

_PLACES = 0.05
"""Share of the points with a wrong sign below which it is an end of the range."""

_MOST = 0.5
"""Share of the points with a wrong sign beyond which the law as a whole has it."""


def feeds_exciter(points: Points) -> bool:
    """Whether the structure works on the exciter, in sum and at most points."""
    work = cycle_work(points.force, points.harmonics[:, 1])
    return bool(np.mean(work <= 0) > 0.5 and np.sum(work) < 0)


def is_systematic(points: Points, regression: Regression, level: float | None = None) -> bool:
    """Tell whether misfits of any quantity go together between neighbours in frequency of one run.

    Of all levels, or of one.
    """
    pairs = points.neighbours
    counted = regression.used if level is None else regression.used & (points.level == level)
    pairs = pairs[counted[pairs].all(axis=1)]
    if len(pairs) < _PAIRS:
        return False
    first, second = (regression.residual[side] for side in pairs.T)
    # (M,) of force, fundamental and harmonics, real and imaginary parts
    power = np.mean(regression.residual[pairs] ** 2, axis=(0, 1))
    counts = power > _NOTICEABLE**2 / 2
    product = np.mean(first * second, axis=0)[counts]
    if not counts.any():
        return False
    each, together = np.max(product / power[counts]), product.sum() / power[counts].sum()
    return bool(each > _by_chance(len(pairs)) or together > _by_chance(_PARTS * len(pairs)))


def _by_chance(pairs: int) -> float:
    """Correlation of so many pairs that noise hardly reaches (Fisher, Metron 1, 1921: atanh r is normal)."""
    return max(_SYSTEMATIC, float(np.tanh(CHANCE / np.sqrt(pairs - 3))))


def relative_misfit(fit: Fit) -> float:
    """Root mean square of real and imaginary part together, as everywhere in the result."""
    return float(fit.regression.noise * np.sqrt(2))


def misfit_findings(
    surface: ResponseSurface, points: Points, fit: Fit, resonances: Sequence[Resonance]
) -> list[Finding]:
    """Judge the misfit by its size, and whether it is the law's or the noise's."""
    misfit, systematic = relative_misfit(fit), is_systematic(points, fit.regression)
    numbers = quantities(misfit=misfit)
    if not systematic:
        if not misfit > (_SCATTERS if len(points) >= _TELLING else _POOR):
            return []
        return [Finding("misfit-large", "error" if misfit > _MEANINGLESS else "doubt", numbers=numbers)]
    names, severity = dict[str, str](), _severity(misfit, _POOR, _MEANINGLESS)
    if severity != "error":
        term, left = _missing_term(fit)
        if left < (1 - _TAKEN) * misfit:
            names, severity = {"term": term}, "doubt"
            numbers |= quantities(left=left)
    found = [Finding("law-does-not-fit", severity, numbers=numbers, names=names)]
    observed = fit.problem.observed
    if surface.origin == "measured" and observed.kind == "none" and observed.phase_known:
        found.append(_background_proposal(points, resonances))
    return [*found, *_level_apart(points, fit.regression, surface.level_unit), *_offset_proposal(fit)]


def _level_apart(points: Points, regression: Regression, unit: str) -> list[Finding]:
    """Find the level that disagrees with the law while most others obey it; none or one."""
    used = points.select(regression.used)
    levels = np.unique(used.level)
    if len(levels) < _SEVERAL:
        return []
    square = regression.misfit[regression.used] ** 2
    sizes = np.sqrt([2 * np.mean(square[used.level == level]) for level in levels])
    worst, typical = int(np.argmax(sizes)), float(np.median(sizes))
    level, size = float(levels[worst]), float(sizes[worst])
    if not (size > max(_POOR, _APART * typical) and is_systematic(points, regression, level)):
        return []
    numbers = {"level": Quantity(level, unit), "misfit": Quantity(size), "typical": Quantity(typical)}
    return [Finding("level-apart", "doubt", numbers=numbers)]


def _severity(size: float, doubt: float, error: float) -> Severity:
    return "error" if size > error else "doubt" if size > doubt else "warning"


def _missing_term(fit: Fit) -> tuple[str, float]:
    """Find the term that takes up most of the misfit, and what misfit it leaves, at one harmonic."""
    chosen = fit.problem.observed.points.spread(QUICK)
    chosen = chosen[fit.regression.used[chosen]]
    problem = fit.problem.select(chosen)
    force = sum((element.force for element in problem.elements[1:]), problem.elements[0].force)
    values, mass, background = problem.split(fit.regression.parameters)
    left: dict[str, float] = {}
    for term in ("", *_TERMS):
        added = force if not term else force + parse(f"extra_term*({term})")
        law = compile_law(added)
        known = dict(zip(problem.law.parameters, values, strict=True))
        start = np.array([known.get(name, 0.0) for name in law.parameters])
        held = tuple(law.parameters.index(problem.law.parameters[place]) for place in problem.held)
        trial = replace(problem, law=replace(law, odd=problem.law.odd and law.odd), held=held)
        found = fit_balance(
            trial, trial.join(start, mass, background), order=1, reject=False, steps=_STEPS, correct=False
        )
        left[term] = relative_misfit(found)
    whole = left.pop("")
    best = min(left, key=lambda term: left[term])
    return best, relative_misfit(fit) * left[best] / whole if whole > 0 else np.inf


def _offset_proposal(fit: Fit) -> list[Finding]:
    """Whether an offset takes up most of the misfit, more than terms proportional to the force."""
    observed = fit.problem.observed
    if observed.kind.endswith(OFFSET):
        return []
    chosen = observed.points.spread(QUICK)
    problem = fit.problem.select(chosen[fit.regression.used[chosen]])
    values, mass, background = problem.split(fit.regression.parameters)
    left = {}
    plain = "phase" if observed.kind == "none" else observed.kind
    for kind in (observed.kind, "residuals", plain + OFFSET):
        seen = Observed.of(problem.observed.points, kind, phase_known=observed.phase_known)
        known = dict(zip(observed.background.names, background, strict=True))
        start = np.array([known.get(name, 0.0) for name in seen.background.names])
        trial = replace(problem, observed=replace(seen, band=observed.band))
        found = fit_balance(
            trial, trial.join(values, mass, start), order=3, reject=False, steps=_STEPS, correct=False
        )
        left[kind] = relative_misfit(found)
    whole, with_offset = left[observed.kind], left[plain + OFFSET]
    if not with_offset < (1 - _TAKEN) * min(whole, left["residuals"]):
        return []
    size = relative_misfit(fit)
    numbers = quantities(misfit=size, left=size * with_offset / whole)
    return [Finding("offset-possible", "info", numbers=numbers, names={"kind": plain + OFFSET})]


def _background_proposal(points: Points, resonances: Sequence[Resonance]) -> Finding:
    """In which band to look for a background."""
    tested = points.omega / (2 * np.pi)
    low, high = float(tested.min()), float(tested.max())
    if resonances:
        reach = [_REACH * 2 * abs(r.damping_ratio) * r.frequency for r in resonances]
        low = max(min(r.frequency - width for r, width in zip(resonances, reach, strict=True)), low)
        high = min(max(r.frequency + width for r, width in zip(resonances, reach, strict=True)), high)
        if not low < high:
            # resonances outside the tested frequencies say nothing about the band
            low, high = float(tested.min()), float(tested.max())
    numbers = {"low": Quantity(low, "Hz"), "high": Quantity(high, "Hz"), "widths": Quantity(_REACH)}
    return Finding("background-possible", "info", numbers=numbers)


def aside_findings(
    points: Points, regression: Regression, tested: int, level_unit: str, *, decays: bool = False
) -> list[Finding]:
    """Judge points set aside by their share, and by whether they lie together.

    Parameters
    ----------
    points, regression
        That were fitted.
    tested
        Points of the whole test.
    level_unit
        Of their levels: "N", or "m" where the response was held.
    decays
        True for a free decay. Noise does not fall with the motion, so that the small half of its points may
        be set aside for that alone; the large half is judged.
    """
    aside = ~regression.used
    if not aside.any():
        return []
    all_aside = int(np.count_nonzero(aside))
    if decays:
        aside = aside & (points.amplitude > np.median(points.amplitude))
    count = int(np.count_nonzero(aside))
    share = count / len(points)
    severity = _severity(share, _FEW_ASIDE, _MANY_ASIDE) if count > _SINGLE else "warning"
    numbers = quantities(aside=all_aside, points=len(points), all=tested)
    found = [Finding("points-set-aside", severity, numbers=numbers)]
    for level, sweep in sorted({*zip(points.level.tolist(), points.sweep.tolist(), strict=True)}):
        rows = np.flatnonzero((points.level == level) & (points.sweep == sweep))
        rows = rows[np.argsort(points.omega[rows], kind="stable")]
        first, longest = _longest(aside[rows])
        lost = int(np.count_nonzero(aside[rows]))
        together = longest >= max(_STRETCH, _PIECE * len(rows))
        if together or (lost > _SINGLE and lost > _WHOLE * len(rows)):
            piece = np.arange(first, first + longest) if together else np.flatnonzero(aside[rows])
            ends = points.omega[rows[piece[[0, -1]]]] / (2 * np.pi)
            data = {"low": Quantity(float(ends[0]), "Hz"), "high": Quantity(float(ends[1]), "Hz")}
            data |= quantities(aside=lost, points=len(rows), together=longest)
            found.append(
                Finding("run-set-aside", "doubt", numbers=data | {"level": Quantity(level, level_unit)})
            )
    return found


def _longest(marks: NDArray[np.bool_]) -> tuple[int, int]:
    """Where the longest stretch of True begins, and its length."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marks.astype(int), [0]])))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    if not len(starts):
        return 0, 0
    best = int(np.argmax(lengths))
    return int(starts[best]), int(lengths[best])


def sign_findings(points: Points, fit: Fit, agreement: Agreement) -> list[Finding]:
    """Find a negative mass, and k(X) or c(X) that are negative over the tested amplitudes."""
    regression, problem = fit.regression, fit.problem
    basis = regression.basis * regression.noise * agreement.wider[:, None]
    found = []
    if problem.given is None:
        error = float(np.linalg.norm(basis[len(problem.law.parameters)]))
        if fit.mass < -CHANCE * error:
            found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(fit.mass, "kg")}))
    used = np.flatnonzero(regression.used & np.isfinite(fit.harmonics).all(axis=1))
    some = used[points.select(used).spread(_SIGNS)]
    if not len(some):
        return found
    motion = Motion(points.omega[some], fit.harmonics[some])
    size = motion.harmonics[:, 1]
    sample = problem.law.along(motion, fit.values, SAMPLES_SWITCHED if problem.law.switched else SAMPLES)
    ratio = project(sample.force, 1) / size
    slopes = np.zeros((len(size), len(sample.by_parameter)), dtype=complex)
    for column, by in enumerate(sample.by_parameter):
        slopes[:, column] = project(by, 1) / size
    rows = basis[: slopes.shape[1]]
    stiffness = _negative(np.abs(size), ratio.real, slopes.real @ rows, "N/m")
    if stiffness:
        found.append(Finding("stiffness-negative", _sign_severity(stiffness), numbers=stiffness))
    rates = motion.omega
    damping = _negative(np.abs(size), ratio.imag / rates, slopes.imag / rates[:, None] @ rows, "N*s/m")
    if damping:
        found.append(Finding("damping-negative", _sign_severity(damping), numbers=damping))
    return found


def phase_findings(fit: Fit) -> list[Finding]:
    """Find a phase error that is a sign, a sense or another quantity, taken up by the background."""
    turned = float(np.angle(np.exp(1j * fit.background[0]))) if len(fit.background) else 0.0
    if not (fit.problem.observed.phase_known and abs(turned) > TURNED):
        return []
    return [Finding("phase-turned", "doubt", "psi", {"phase": Quantity(turned, "rad")})]


def _negative(size: Array, value: Array, spread: Array, unit: str) -> dict[str, Quantity]:
    """Where k(X) or c(X) is negative beyond its error; empty where it is at hardly any point."""
    wrong = value < -CHANCE * np.linalg.norm(spread, axis=1)
    share = float(np.mean(wrong))
    if not share > _PLACES:
        return {}
    return {
        "least": Quantity(float(value[wrong].min()), unit),
        "low": Quantity(float(size[wrong].min()), "m"),
        "high": Quantity(float(size[wrong].max()), "m"),
        "share": Quantity(share),
    }


def _sign_severity(found: dict[str, Quantity]) -> Severity:
    return "error" if found["share"].value > _MOST else "doubt"
