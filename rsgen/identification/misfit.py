"""Is a misfit noise or an error of the law? Its pattern, its size, and the changes that would reduce it.

Residuals of neighbours in frequency are correlated if the law is wrong (``observed.is_systematic``). A
missing term, background, offset or even force is a column c of the linearised fit; to first order it reduces
the sum of squares by (c_o.r)^2/|c_o|^2, with c_o its part outside the span of the parameters and r the
residual (score test; ``terms`` has the columns). A change that takes up more than half is named as the cause.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import inf, nan

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import listed
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.tolerances import (
    DEVIATING_MISFIT_RATIO,
    MIN_LEVELS_FOR_JACKKNIFE,
    MIN_MISFIT_REDUCTION,
    MIN_SIGNIFICANT_GAIN,
    MISFIT_DOUBTFUL_PATTERN_UNSEEN,
    MISFIT_DOUBTFUL_WITH_PATTERN,
    MISFIT_DOUBTFUL_WITHOUT_PATTERN,
    MISFIT_EXPLAINED,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    NOISE_LIMIT_SIGMAS,
    RELATIVE_CHANGE_NEGLIGIBLE,
    STANDARD_ERRORS_OF_DIFFERENCE,
    START_HARMONICS,
    SUBSAMPLE_POINTS,
    interval_sigmas,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import BACKGROUNDS
from rsgen.data.surface.mode_findings import fixed_contradicted
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.formula.names import symbol
from rsgen.formula.printing import write
from rsgen.formula.units import number_text
from rsgen.identification.fitting.across import misfit_of_joint
from rsgen.identification.fitting.fit import Fit, linearise_extended
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Problem, constant_mean, is_systematic, systematic_columns
from rsgen.identification.fitting.points import Points
from rsgen.identification.results import Estimate
from rsgen.identification.results.alternatives import Agreement, Alternative, Alternatives, largest_move
from rsgen.identification.starting.start import (
    even_directions,
    even_part_unobservable,
    records_even,
    start_fit,
)
from rsgen.identification.terms import (
    EVEN_SHARE,
    MIRRORED,
    channel_finding,
    even_force_shift,
    few_points,
    fit_missing_terms,
    fit_near,
    force_factors,
    free_curves_leave,
    gain_of,
    joint_alternatives,
    law_with,
    other_gain,
    ratio_finding,
    share_left_by,
    simplest_background,
    with_background,
    with_terms,
)

_MIN_POINTS_OF_PATTERN = 16
"""Number of points for the residual-pattern test: at 16 a 5 % damping error is detected, at 12 it is not."""

CODES_OF_RESPONSE = frozenset({"another-quantity", "base-misread", "not-passive"})
"""Findings about sign or quantity of the response, which a background would only conceal."""

_LIKE_EVEN = ("x*abs(x)", "x**3", "x**5")
"""Springs that do to fundamentals what an even force does, whose square shows there."""

_GAIN_WORTH_A_FIT = 0.1
"""Share of the largest gain to first order: where drag is missing dry friction has twice its gain, and leaves
50 times as much."""


def law_misses(fit: Fit) -> bool:
    """Return True if a misfit is systematic and above a hundredth, so that intervals are too narrow."""
    return fit.systematic and fit.regression.rms_misfit > MISFIT_DOUBTFUL_WITH_PATTERN


def is_misread(test: ResponseSurface | MultisineSpectra) -> bool:
    """Return True if channels of a driven base were misread, so that no law is to be refined."""
    return any(finding.code == "base-misread" for finding in test.findings)


def misfit_findings(
    surface: ResponseSurface, points: Points, fit: Fit, others: Alternatives
) -> list[Finding]:
    """Judge the misfit by its size, and say whose it is: of the noise, a fixed value, the law, a background.

    Noise has no pattern along the frequency (``is_systematic``). Of a misfit that has one, ``_cause`` says
    what takes up most. A fixed value is blamed in place of the law where another leaves less than any term.

    Parameters
    ----------
    surface, points
        All points of the test, and those that were fitted.
    fit
        The refined one.
    others
        Alternatives to the fit, each to first order.
    """
    misfit = fit.regression.rms_misfit
    # the pattern that a fit leaves whose values grow without limit is no fault of a law with memory
    diverges = fit.problem.law.remembers and not fit.regression.converged and misfit < MISFIT_REJECTED
    if diverges or not fit.systematic:
        return _noise_findings(surface, points, fit)
    size = _of_systematic_columns(fit) if surface.decays else misfit
    # above a hundredth intervals are too narrow, of a joint from its noise on
    across = fit.problem.law.parts[1:]
    limits = [misfit_of_joint(fit.problem.observed.points, part.sensors) for part in across]
    severity = severity_of(size, min([MISFIT_DOUBTFUL_WITH_PATTERN, *limits]), MISFIT_REJECTED)
    rejected = severity == "error"
    left_by_term, left_by_cause, names = _cause(
        fit, points, others, only_terms=rejected, decays=surface.decays
    )
    gain = other_gain(fit, surface.level_unit) if "levels" in names else {}
    numbers = quantities(misfit=misfit) | gain | (quantities(left=left_by_cause) if names else {})
    if names:
        # gains of the levels are no other law: they are as doubtful as the misfit is large
        severity = severity if "levels" in names or rejected else "doubt"
    known = not any(finding.code in CODES_OF_RESPONSE for finding in surface.findings)
    # a wrong fixed value is no other gain of a single level that takes up most, and no fault of the law
    alone = "gain" in gain and left_by_cause < (1 - MIN_MISFIT_REDUCTION) * misfit
    most = left_by_cause if alone else min(left_by_term, MISFIT_EXPLAINED if rejected else inf)
    compared = known and not surface.decays
    if compared and (fixed := _contradicted(surface, fit, most, law_fits=severity == "warning")):
        return [replace(finding, severity=severity) for finding in fixed] if rejected else fixed
    # an offset of the sensor is simpler than any background
    backgrounds = {**others.kinds.get("offset of the sensor", {}), **others.kinds["background"]}
    left_by = {kind: misfit * one.left for kind, one in backgrounds.items()}
    if compared:
        off = channel_finding(fit, misfit, (left_by_term, left_by_cause), left_by, surface.base)
        if off := off or ratio_finding(fit, surface.base):
            return [replace(off, severity=severity if rejected else "doubt")]
    found = [Finding("law-does-not-fit", severity, numbers=numbers, names=names | _carrier(fit))]
    if not names.keys() & {"term", "free", "side"}:
        # a term that is missing misses some levels more than others, as dry friction the lowest
        found += _level_apart(points, fit.regression, surface.level_unit)
    if backgrounds and fit.regression.converged:
        found += background_findings(
            backgrounds,
            left_by,
            fit.regression.first(fit.problem.count),
            others.names,
            misfit=misfit,
            left_by_term=left_by_term if known else 0.0,
        )
    return found


def _noise_findings(surface: ResponseSurface, points: Points, fit: Fit) -> list[Finding]:
    """Find a large misfit without a pattern, wrong fixed values, a fault of channels behind a background."""
    # one point a level shows no pattern either, and a loop holds each until its noise is gone
    patterns = len(points) >= _MIN_POINTS_OF_PATTERN and surface.control != "phase"
    misfit = fit.regression.rms_misfit
    # the forces of a free decay are those of the given mass; steps that ended anywhere compare with no fit
    compared = fit.regression.converged and not surface.decays
    found = _contradicted(surface, fit, misfit) if compared else []
    if misfit > (MISFIT_DOUBTFUL_WITHOUT_PATTERN if patterns else MISFIT_DOUBTFUL_PATTERN_UNSEEN):
        severity: Severity = "error" if misfit > MISFIT_REJECTED else "doubt"
        found.append(Finding("misfit-large", severity, numbers=quantities(misfit=misfit)))
    if off := ratio_finding(fit, surface.base):
        found.append(off)
    return found


def _cause(
    fit: Fit, points: Points, others: Alternatives, *, only_terms: bool, decays: bool
) -> tuple[float, float, dict[str, str]]:
    """Return what takes up most of a systematic misfit: a term, or free curves or factors of the levels.

    Returns
    -------
    left_by_term, left_by_cause, names
        The misfit that the best term leaves, and the best cause; its names, none if it takes up too little.
    """
    misfit, terms, problem = fit.regression.rms_misfit, others.kinds["term"], fit.problem
    # to first order large terms are misjudged, as a linear damper; a joint they would leave without values
    linear = fit_missing_terms(fit, max(fit.regression.sigma, 1e-300), ("x", "v"))
    tried = [name for name, one in linear.items() if np.isfinite(one.error)]
    most = max(one.gain for one in terms.values())
    tried += [name for name, one in terms.items() if one.gain >= _GAIN_WORTH_A_FIT * most]
    if records_even(problem) and not (problem.law.odd or problem.law.acts_across):
        tried.append(MIRRORED)
    by_term = {name: misfit * share_left_by(fit, name) for name in tried}
    term = min(by_term, key=by_term.__getitem__)
    left_by_term = left_by_cause = by_term[term]
    names = {"side": "other"} if term == MIRRORED else {"term": term}
    enough = (1 - MIN_MISFIT_REDUCTION) * misfit
    # on as many points as were fitted
    more = MIN_SIGNIFICANT_GAIN / min(fit.regression.freedom, 2 * SUBSAMPLE_POINTS)
    rivals = [name for name in by_term if name not in (MIRRORED, term)]
    alike = [name for name in rivals if by_term[name] ** 2 < (1 + more) * left_by_term**2]
    if term != MIRRORED and alike:
        names["also"] = listed(alike)
    if not (only_terms or left_by_term < enough):
        curves = free_curves_leave(fit, points)
        factors, _, most_left = (inf, {}, inf) if decays else force_factors(fit)
        names = {"free": "curves"} if curves < factors else {"levels": "force"}
        left_by_cause = min(curves, factors) * misfit
        enough = min(most_left * misfit, left_by_term) if "levels" in names else enough
    if names.get("term") in _LIKE_EVEN and not records_even(problem) and _is_symmetric(problem):
        names["even"] = "k2*x**2"
    return left_by_term, left_by_cause, names if left_by_cause < enough else {}


def _carrier(fit: Fit) -> dict[str, str]:
    """Return as "where" the harmonic that carries most of a systematic misfit; none of the force.

    Force and fundamental of a point share its residual, so that neither of them carries it alone.
    """
    found, points = fit.regression, fit.problem.observed.points
    names, count = list[str](), found.residual.shape[1]
    for step in (1, 2):
        # harmonics that are compared, of an odd law the odd ones; real parts of all, then imaginary parts
        others = [h for h in fit.problem.observed.recorded if h != 1 and (step == 1 or h % 2)]
        real = ["", "", *(f"harmonic {h}" if h else "the mean" for h in others), *[""] * points.far.shape[1]]
        every = [*real, *(name for name in real if name != "the mean")]
        names = every if len(every) == count else names
    power = np.sum(found.residual[found.used] ** 2, axis=0)
    power *= systematic_columns(found.residual, points.pairs(found.used))
    of_name = {name: power[[other == name for other in names]].sum() for name in names if name}
    most = max(of_name, key=of_name.__getitem__, default="")
    return {"where": most} if most and of_name[most] > power.sum() / 2 else {}


def _of_systematic_columns(fit: Fit) -> float:
    """Relative misfit of the correlated quantities: the force of a decay has nearly all of its noise."""
    found = fit.regression
    chosen = systematic_columns(found.residual, fit.problem.observed.points.pairs(found.used))
    power = np.sum(found.residual[found.used] ** 2, axis=0)
    return fit.regression.rms_misfit * float(np.sqrt(np.sum(power[chosen]) / np.sum(power)))


def _level_apart(points: Points, regression: Regression, unit: str) -> list[Finding]:
    """Find the level that disagrees with the law while most others obey it; none or one."""
    used = points.select(regression.used)
    levels = np.unique(used.level)
    if len(levels) < MIN_LEVELS_FOR_JACKKNIFE:
        return []
    square = regression.misfit[regression.used] ** 2
    sizes = np.sqrt([2 * np.mean(square[used.level == level]) for level in levels])
    worst, typical = int(np.argmax(sizes)), float(np.median(sizes))
    level, size = float(levels[worst]), float(sizes[worst])
    pairs = points.pairs(regression.used & (points.level == level))
    if not (
        size > max(MISFIT_EXPLAINED, DEVIATING_MISFIT_RATIO * typical)
        and is_systematic(regression.residual, pairs)
    ):
        return []
    numbers = {"level": Quantity(level, unit), "misfit": Quantity(size), "typical": Quantity(typical)}
    return [Finding("level-deviates", "doubt", numbers=numbers)]


def _freed(problem: Problem, start: Array, name: str) -> Fit:
    """Fit with a given value free, from values that are near, or anew where these lead nowhere."""
    others = {other: value for other, value in problem.fixed.items() if other != name}
    # what no step could tell next to a wrong value may be told next to another one
    freed = replace(problem.unweighed if name == "m" else problem, fixed=others, frozen=())
    found = fit_near(freed, start, order=START_HARMONICS)
    if found.regression.converged:
        return found
    # a wrong value may have led far off
    anew = fit_near(*start_fit(freed), order=START_HARMONICS)
    return anew if anew.regression.rms_misfit < found.regression.rms_misfit else found


def consequences(fit: Fit, name: str) -> set[str]:
    """Return codes of what is found because of a wrong fixed value: a fit with it free does not show them."""
    free = _freed(few_points(fit), fit.regression.parameters, name)
    points, found = free.problem.observed.points, free.regression
    agreement = Agreement.of(found, points, found.covariance, misfits=False)
    converged = {"not-converged"} if found.converged else set()
    return converged if agreement.findings else {*converged, "parts-disagree"}


def _contradicted(surface: ResponseSurface, fit: Fit, left: float, *, law_fits: bool = True) -> list[Finding]:
    """Find given values that the points contradict: another leaves less misfit than a term (``left``) does.

    A weighed mass is compared with that of the points alone, where the law fits: a pattern below a hundredth
    moves it by less than a hundredth. The kilogram of a force per mass was not given.
    """
    weighed = fit.problem.observed.points.weighed
    if not (fit.problem.known_values and (weighed or fit.regression.rms_misfit > MISFIT_NEGLIGIBLE)):
        return []
    problem, names = few_points(fit), (*fit.problem.law.parameters, "m")
    start, size = fit.regression.parameters, fit.regression.rms_misfit
    kept = fit_near(problem, start, order=START_HARMONICS).regression
    whole, found = kept.rms_misfit, []
    for name, given in problem.known_values.items():
        if name == "m" and surface.per_mass:
            continue
        error = weighed[1] if weighed and name not in problem.fixed else 0.0
        free = _freed(problem, start, name).regression
        place, best = names.index(name), free.rms_misfit
        leaves = size * best / whole if whole > 0 else np.inf
        # with noise the gain counts in units of that noise
        gain = ((whole / best) ** 2 - 1) * free.freedom if best > 0 else np.inf
        moved = float(free.parameters[place]) - given
        times = abs(moved) / float(np.hypot(np.sqrt(free.covariance[place, place]), error))
        # next to a wrong law, background or gain no other value leaves nothing but noise
        patterned = fit.shared or is_systematic(free.residual, problem.observed.points.pairs(free.used))
        far = abs(moved) > RELATIVE_CHANGE_NEGLIGIBLE * abs(given) or (fit.systematic and not patterned)
        # a small change may move the stiffness of each side by much
        moves = {} if far else largest_move(kept.parameters, free, names)
        clear = gain > MIN_SIGNIFICANT_GAIN and times > STANDARD_ERRORS_OF_DIFFERENCE and leaves <= left
        # a mass gives way to the points as far as its error lets it
        off = error > 0 and times > NOISE_LIMIT_SIGMAS and law_fits and (far or not fit.systematic)
        if off or (clear and (far or moves)):
            one = fixed_contradicted(name, given, moved, misfit=size, left=leaves, times=times, error=error)
            found.append(replace(one, names={**one.names, **moves}))
    return found


_MAX_MOVE = 10.0
"""Times its value by which no first-order step moves a parameter: another law or another test is meant."""


def background_findings(
    others: Mapping[str, Alternative],
    left_by_kind: Mapping[str, float],
    found: Regression,
    names: Sequence[str],
    *,
    misfit: float,
    left_by_term: float,
) -> list[Finding]:
    """Find a background that takes up the misfit, more than a term does, and moves a parameter.

    Parameters
    ----------
    others, left_by_kind
        Alternatives with more of a background by kind, and the misfit that each leaves.
    found, names
        Of the law and the mass.
    misfit, left_by_term
        Of the fit, and what the best term would leave.
    """
    kind = simplest_background(left_by_kind, misfit)
    least = left_by_kind[kind]
    if not least < min((1 - MIN_MISFIT_REDUCTION) * misfit, left_by_term):
        return []
    change = others[kind].shift[: len(names)]
    # halves that differ by the same background widen the errors, and are no reason against it
    times = np.abs(change) / np.sqrt(np.diag(found.covariance))
    share = change / found.parameters
    clear = (times > STANDARD_ERRORS_OF_DIFFERENCE) & (np.abs(share) > RELATIVE_CHANGE_NEGLIGIBLE)
    worst = int(np.argmax(np.where(clear, np.abs(share), 0.0)))
    if not (clear.any() and abs(share[worst]) <= _MAX_MOVE):
        return []
    numbers = quantities(misfit=misfit, left=least, moved=share[worst], times=times[worst])
    if kind == "mean":
        numbers["offset"] = Quantity(float(others[kind].shift[-1]), "m")
    return [Finding("background-missing", "doubt", names[worst], numbers, {"kind": kind})]


# ----------------------------------------------------------------------------
# Even forces: what recorded means and even harmonics say against a symmetric law, and what is not known
# of them where these were not recorded.

_POWERS = {"x**2": 2, "x**4": 4, "abs(x)": 1}
"""Even forces that are tried: those of weight, of one-sided gaps and of two stiffnesses; others are nearly
made up of them; and the power of the amplitude that they go with."""


def _is_symmetric(problem: Problem) -> bool:
    """Return True if the law is odd and acts along the response alone."""
    return law_with(problem).odd and not problem.law.acts_across


def even_findings(fit: Fit) -> list[Finding]:
    """Find an even force that a symmetric law lacks, by the mean and the even harmonics that were recorded.

    The misfit of a symmetric law does not contain them. With an even force each point weighs
    them against its noise, and the force stands where they say more for it than for an offset of the sensor.
    What it does not do to the fundamental itself its odd companion may: a stop on one side has both.
    ``fit`` is the refined one.
    """
    problem = fit.problem
    # of motions that are not odd the problem says so, of its law that alone does
    if not (records_even(problem) and _is_symmetric(problem)):
        return []
    chosen = problem.observed.points.spread(SUBSAMPLE_POINTS)
    chosen = chosen[(fit.regression.used & ~fit.symmetry_broken)[chosen]]
    if not len(chosen) or _gain_of_all(fit.select(chosen)) < MIN_SIGNIFICANT_GAIN / 2:
        return []
    few = problem.select(chosen)
    trials = {term: _with_even(few, fit, term) for term in _POWERS}
    term = min(trials, key=lambda term: trials[term][1].regression.sigma)
    place, best, without = trials[term]
    noise = max(best.regression.sigma, 1e-300)
    gain = float(np.sum(without.residual**2) - np.sum(best.regression.residual**2)) / noise**2
    if not gain - _gain_of_offset(few, without) / noise**2 > MIN_SIGNIFICANT_GAIN:
        return []
    points, recorded = few.observed.points, few.observed.recorded
    largest = int(np.argmax(points.amplitude))
    size = float(points.amplitude[largest])
    spring = best.mass * float(points.omega[largest]) ** 2 * size
    share = abs(best.values[place]) * size ** _POWERS[term] / spring
    if not share > RELATIVE_CHANGE_NEGLIGIBLE:
        return []
    numbers = quantities(share=share, amplitude=Quantity(size, "m"), errors=np.sqrt(gain))
    names = {"term": term} | ({"mean": "recorded"} if 0 in recorded else {})
    return [Finding("even-force-missing", "doubt", numbers=numbers, names=names)]


def _gain_of_all(fit: Fit) -> float:
    """Sum of squares that all even forces together take up to first order, in units of the noise.

    None of them takes up more, and where that is little the first order is all: none needs a fit.
    """
    trial, begin, places = with_terms(fit.problem, fit, tuple(_POWERS))
    # to first order an even force moves the mean and the second harmonic
    residual, matrix = linearise_extended(fit, trial, begin, order=2)
    right, rows = residual.reshape(-1), matrix.reshape(residual.size, len(begin))
    others = np.setdiff1d(np.flatnonzero(trial.free), places).tolist()
    gain = joint_alternatives(right, rows, others, {"even": [*others, *places]}, 0)["even"].gain
    # the noise is what they leave
    freedom = len(residual) * (residual.shape[1] - fit.regression.nuisance.shape[1])
    freedom -= len(others) + len(places)
    return float(gain / max(float(right @ right) - gain, 1e-300) * freedom)


def _with_even(problem: Problem, fit: Fit, term: str) -> tuple[int, Fit, Regression]:
    """Place of an even force among the parameters, the fit with it, and that without it."""
    trial, begin, (place,) = with_terms(problem, fit, (term,))
    without, best = (
        fit_near(replace(trial, frozen=frozen), begin, order=START_HARMONICS)
        for frozen in ((*trial.frozen, place), trial.frozen)
    )
    return place, best, without.regression


def _gain_of_offset(problem: Problem, without: Regression) -> float:
    """How much of the sum of squares a constant offset of the displacement takes up."""
    if 0 not in problem.observed.recorded:
        return 0.0
    used, amplitude = without.used, problem.observed.points.amplitude
    # behind the real parts of force and fundamental
    mean = without.residual[used, 2]
    _, left = constant_mean(mean * amplitude[used], amplitude[used])
    return float(np.sum(mean**2) * (1 - left**2))


def unseen_findings(fit: Fit, estimates: Sequence[Estimate]) -> list[Finding]:
    """Say what an even force would move that a symmetric law lacks and fundamentals do not show.

    Of a cubic spring the points determine k3 - a k2^2/k, a = 10/9 for small motions (Nayfeh and Mook,
    Nonlinear Oscillations, Wiley 1979, section 2.3): the stated k3 and its interval are of that.
    """
    problem = fit.problem
    if not fit.regression.converged or records_even(problem) or not _is_symmetric(problem):
        return []
    (k2, moved), series, x = even_force_shift(fit), problem.law.expression.expand(), symbol("x")
    change_of = dict(zip((*problem.law.parameters, "m"), moved.tolist(), strict=False))
    shares = {one.name: change_of[one.name] / one.value for one in estimates if one.identifiable}
    shares = {name: share for name, share in shares.items() if abs(share) > RELATIVE_CHANGE_NEGLIGIBLE}
    if not shares:
        return []
    names, cubic = dict[str, str](), [name for name in shares if series.coeff(x, 3) == symbol(name)]
    if cubic and (linear := series.coeff(x, 1)):
        spring = float(problem.law.still(np.zeros(1), fit.values).by_x[0])
        combined = write(symbol("k2") ** 2 / linear)
        factor = change_of[cubic[0]] * spring / k2**2
        names = {"determined": f"{cubic[0]} {'+-'[factor < 0]} {abs(factor):.3g}*{combined}"}
    first, *others = sorted(shares, key=lambda name: (name not in cubic, -abs(shares[name])))
    names["side"] = "below" if change_of[first] < 0 else "above"
    if others:
        names["others"] = listed([f"{name} {number_text(100 * shares[name], 2)} %" for name in others])
    largest = Quantity(float(problem.observed.points.amplitude.max()), "m")
    numbers = quantities(even=EVEN_SHARE, amplitude=largest, moved=shares[first])
    numbers |= quantities(**{f"moved {name}": shares[name] for name in others})
    return [Finding("even-terms-not-seen", "info", first, numbers, names)]


def explain_hidden(problem: Problem, reasons: Mapping[str, Finding | None]) -> dict[str, Finding | None]:
    """Doubt values of a law with an even force without effect: the fundamental shows its square alone."""
    names = [problem.law.parameters[i] for i in problem.law.even] if even_part_unobservable(problem) else []
    return {
        name: Finding("even-terms-not-seen", "doubt", name, why.numbers)
        if why is not None and why.code == "no-effect" and name in names
        else why
        for name, why in reasons.items()
    }


def mirror_findings(problem: Problem, known: Collection[str], symmetric: Array) -> tuple[Finding, ...]:
    """Say that the law of -x fits as well, where nothing even was recorded; name ``known`` parameters.

    ``symmetric`` is the shift to a symmetric law that fits as well; see ``symmetric_shift``.
    """
    law = problem.law
    fixed = [place for place in law.even if not problem.free[place]]
    if not even_part_unobservable(problem) or records_even(problem) or fixed:
        return ()
    names = [law.parameters[i] for i in law.even if law.parameters[i] in known]
    if law.mirrored and not names:
        return ()
    said = {"parameters": ", ".join(names)} if law.mirrored else {}
    if symmetric.any():
        said = {"background": BACKGROUNDS[-2]}
    return (Finding("mirror-image-fits", "warning", names=said),)


def symmetric_shift(fit: Fit) -> Array:
    """Return the shift (q,) to the symmetric law with a background, where that fits as well; else zeros.

    Of a one-sided spring, whose resonance does not depend on the amplitude, fundamentals show what its
    harmonics do to the shape of the resonance, as a neighbouring mode does. It is far, so that the law is
    fitted again: without even forces, and with the largest background.
    """
    none, own = np.zeros(fit.problem.count), fit.problem.observed.background
    if not even_part_unobservable(fit.problem) or records_even(fit.problem):
        return none
    few = fit.select(np.flatnonzero(fit.regression.used))
    hidden = even_directions(few.problem, few.regression.parameters)
    if not hidden.symmetric or own.kind.startswith(BACKGROUNDS[-1]):
        return none
    problem, start = with_background(few)
    start[: len(none)] = hidden.centre[: len(none)]
    frozen = tuple({*problem.law.even, *hidden.uneven} - {-1})
    other = fit_near(replace(problem, frozen=frozen), start, order=max(few.order, START_HARMONICS))
    if gain_of(other, few) is None:
        return none
    return other.regression.parameters[: len(none)] - few.regression.parameters[: len(none)]


def widen_squares(fit: Fit, found: Regression, symmetric: Array) -> Regression:
    """Widen the errors of values v that the points show by their squares alone, and of what goes with them.

    What is normally distributed is v^2, with a standard error of 2 |v| e where that of v is e by its slope,
    so that its interval is v^2 ± 2 w |v| e, w standard errors wide. Where that contains zero the interval of
    v does, and has both signs; else it is as long as that between the roots. Of k*x + kb*Max(x, 0) the points
    show k + kb/2 by its slope: k is as uncertain as half of kb.

    Parameters
    ----------
    fit
        What is judged.
    found
        The errors of its law (q,).
    symmetric
        (q,) shift to a symmetric law that fits as well, which the errors contain.
    """
    problem, count = fit.problem, len(found.covariance)
    if not even_part_unobservable(problem) or records_even(problem):
        return found
    hidden = even_directions(problem, fit.regression.parameters)
    if not hidden.symmetric:
        return found
    wide = float(interval_sigmas(found.freedom))
    covariance = found.covariance + np.outer(symmetric, symmetric)
    for place, direction in zip(hidden.uneven, hidden.directions[:, :count], strict=True):
        error = float(np.sqrt(found.covariance[place, place])) if place >= 0 else nan
        if not 0 < error < inf:
            continue
        far = abs(found.parameters[place] - hidden.centre[place]) / (wide * error)
        low, high = np.sqrt(max(far**2 - 2 * far, 0.0)), np.sqrt(far**2 + 2 * far)
        more = max((high - low) / 2 if low > 0 else high, 1.0) ** 2 - 1
        along = direction / direction[place] * error
        covariance += more * np.outer(along, along)
    return replace(found, covariance=covariance)
