"""Sentences about identifications."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units import count_text, number_text, quantity_text
from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly, says

_TESTED = "X up to {amplitude:.3q}, levels up to {level:.3q}"

say_plainly(
    {
        "per-unit-mass": (
            "the base was driven and no mass is given: parameters are per unit mass, N/m/kg in place of N/m; "
            "give the mass to have them whole"
        ),
        "curves-of-constant-acceleration": (
            "the test held the {base} of the base; predicted curves are those of a constant acceleration, "
            "the one measured near the resonance of each level, and differ off resonance; held-out levels "
            "are predicted with the measured motion of the base"
        ),
        "predicted-along-measured": (
            "the law acts across {sensors}: held-out levels are predicted with what was measured there of "
            "the motion across, and there are no curves, which would need it everywhere"
        ),
        "no-effect": (
            f"{{parameter}}: the response does not depend on it in the tested range ({_TESTED}); raise the "
            "level until it does"
        ),
        "not-distinct-from-zero": (
            "{parameter}: {value:.2g} with standard error {standard_error:.2g} cannot be distinguished from "
            f"zero ({_TESTED}); raise the level, or take more points near the resonance or more periods"
        ),
        "even-force-missing": (
            "the mean and the even harmonics that were recorded contradict a law that is the same on both "
            "sides: a force {term} stands out of their noise by {errors:.2g} standard errors, and is "
            "{share:.2p} of the spring's at {amplitude:.3q}"
        ),
        "fixed-contradicted": (
            "with {parameter} = {fitted:.4q} in place of the given {given:.4q} ({moved:+.1%}, {times:.2g} "
            "standard errors) the misfit is {left:.2p} in place of {misfit:.2p}"
        ),
        "not-determined": "{parameter}: not determined by the points that this method uses",
        "shift-small": (
            "the resonance shifts by {shift:.2g} Hz over all levels, less than its width of {width:.2g} Hz; "
            "raise the level above {level:.4q}"
        ),
        "not-calibrated": (
            "arbitrary scale: force or response are not calibrated, so m and every parameter are per unit of "
            "the drive and of the response; frequencies and damping ratios do not depend on the scale"
        ),
        "not-converged": (
            "the fit did not converge: the values are those at which its steps ended, without intervals"
        ),
        "misfit-large": (
            "force and response differ from the law by {misfit:.1%}, without a pattern: noise this large "
            "would hide an error of the law"
        ),
        "intervals-widened": (
            "the misfit is not random noise, so the intervals hold what {by} would move, too: they are "
            "typically {wider:.2g} times wider than noise makes them"
        ),
        "level-deviates": (
            "level {level:.4q} misses the law by {misfit:.1%}, half of the levels by at most {typical:.1%}"
        ),
        "gain-may-change": (
            "a gain that changes by {change:.2p} over the band would leave what the background takes up for "
            "other modes, and is not told from them; if it is such a gain, stiffness, damping and mass are "
            "off by up to {off:.2p}, a cubic term by three times that: calibrate at both ends of the band"
        ),
        "nothing-identifiable": "the test determines none of the parameters of the law",
        "not-a-steady-sine": (
            "harmonics reach {share:.0%} of the fundamental at half of the points: the response is hardly "
            "that to a steady sine"
        ),
        "resonance-sparse": (
            "{few:.0f} of {runs:.0f} runs have fewer than {points:.0f} points within the width of the "
            "resonance: damping rests on few points there"
        ),
    }
)

_OTHER_LAW = "Try another law, `rsgen rank` among those of the library, or fewer levels."
_SIGN = (
    "Check signs and units of force and response in the case, and of each sensor of a sum of two: mounted "
    "upside down it needs factor = -1, and the sum is written so that the response counts positive; then "
    "take out terms that are not needed."
)

NEXT_STEPS |= {
    "law-does-not-fit": _OTHER_LAW,
    "nothing-identifiable": (
        "Give the mass if it is known, take a law with fewer parameters, or test more frequencies around "
        "the resonance at more levels."
    ),
    "background-missing": (
        "Identify with this background, or in a narrower band around the mode, and compare: where the "
        "values differ, the sensor sees more than the mode."
    ),
    "fixed-contradicted": (
        "Measure the value again (weigh a mass), and check the frequency axis and the factors of force "
        "and response; or leave the value out, so that it is identified."
    ),
    "law-ambiguous": (
        "Identify with the term or background as well, and others in its place (rsgen rank), or the "
        "halves separately, and compare (rs.compare_fits); more and higher levels distinguish them."
    ),
    "even-force-missing": (
        "Add an even term to the law, such as k2*x**2, or a stop on one side; where the sensor has an "
        "offset, take it off."
    ),
    "range-reached": (
        "Measure with a wider range; until then leave these levels, or this part of the band, out."
    ),
    "misfit-large": (
        "Look at the points in the response figure: average more readings, wait longer before each, or "
        "check that force and response belong together."
    ),
    "parts-disagree": (
        "Identify the levels separately, and look for one whose force, label or set-up differs, or for a "
        "gain that changed on the way; if none does, try another law."
    ),
    "points-excluded": (
        "Look at the points that were not used in the figure of responses: repeat them (in a sweep more "
        "slowly, or with less noise of the force), or leave them out by the case and say so; if they are "
        "sound, or one run or one end of the band, the law is wrong."
    ),
    "level-deviates": (
        "Check force, unit and frequencies of this level, and whether the sensor was overloaded; or hold "
        "it out and compare."
    ),
    "not-converged": (
        "Compare with the first-order estimates; fewer parameters, or a given mass, let the fit settle."
    ),
    "structure-feeds-exciter": (
        "Read the phase of a table in the other sense (test.response.phase_sense), or give "
        "test.response.factor the other sign; a time history has no phase that is read."
    ),
    "not-passive": (
        "Correct the sense of the phase, or the sign of the channel, that is named above, and run the "
        "case again."
    ),
    "harmonics-across-left-out": (
        "Record the harmonics of both sensors (time histories give them), or leave out the levels and "
        "frequencies at which the joint distorts the motion."
    ),
    "noise-across": (
        "Measure with less noise, or the motion across by one sensor; take frequencies and levels at "
        "which the joint moves more, or give what is known, such as the mass."
    ),
    "curve-negative": _SIGN,
    "not-a-steady-sine": (
        "Check the excitation that the case declares: noise and transients are not read as stepped sines."
    ),
}


@says("bounded-to-one-side")
def _bounded_to_one_side(found: Finding) -> str:
    said = f"{found.names['side']} {quantity_text(*found.numbers['bound'], 3)}"
    if "reach" not in found.numbers:
        return f"{found.parameter}: the test says only that it is {said}"
    reach = quantity_text(*found.numbers["reach"], 3)
    return (
        f"{found.parameter} is {said}; beyond {reach} the balance, not the test, ends: the law has no motion "
        "of the measured amplitude there"
    )


@says("mirror-image-fits")
def _mirror_image_fits(found: Finding) -> str:
    if "parameters" in found.names:
        return (
            f"the sign of {found.names['parameters']} is not identifiable: neither the mean nor an even "
            "harmonic was recorded, and with the other sign -x fits as well as x; record the mean or the "
            "second harmonic"
        )
    return (
        "the mirror image of the law, x and v with the other sign, fits as well: neither the mean nor an "
        "even harmonic was recorded, which distinguish the two sides"
    )


@says("range-reached")
def _range_reached(found: Finding) -> str:
    if "record" in found.names:
        return (
            f"{found.names['record']}: the {found.names['signal']} is cut off at the end of its range in "
            f"{found['samples']:.0f} samples; amplitudes are too small there: measure with a wider range, or "
            "use start and stop"
        )
    return (
        f"{found['at']:.0f} of {found['points']:.0f} points have a response of "
        f"{quantity_text(*found.numbers['limit'], 3)}, as a sensor or amplifier at the end of its range has"
    )


@says("curve-negative")
def _curve_negative(found: Finding) -> str:
    curve = found.names["curve"]
    if "share" not in found.numbers:
        return (
            f"{curve} turns negative where x is large: its loop is that of a joint only as far as the virgin "
            "curve rises"
        )
    of = f" of the elements across {found.names['sensors']}" if "sensors" in found.names else ""
    least, low, high = (quantity_text(*found.numbers[name], 3) for name in ("least", "low", "high"))
    return (
        f"{curve}{of} is negative, down to {least}, for X of {low} to {high} ({found['share']:.0%} of the "
        f"points){_FED if curve == 'c(X)' else ''}"
    )


_FED = ": the structure would feed energy into the exciter there"


@says("harmonics-across-left-out")
def _harmonics_across_left_out(found: Finding) -> str:
    sensors = found.names["sensors"]
    if "moved" in found.numbers:
        return (
            f"of the motion across {sensors} no harmonic above {found['recorded']:.0f} was recorded; with "
            f"those that the joint makes between two masses, harmonic {found['order']:.0f} up to "
            f"{found['share']:.1%} of the fundamental, {found.parameter} would differ by "
            f"{found['moved']:+.1%}, {found['times']:.2g} standard errors"
        )
    misfit, noise = (number_text(100 * found[name], 2) for name in ("misfit", "noise"))
    return (
        f"the law leaves {misfit} %, and the two sensors of {sensors} have {noise} % of noise: only the "
        "fundamental across was recorded, and a joint that bends this motion may fit with values that are "
        "far off; noise of the difference may be more than the joint says, too"
    )


_EXCLUDED_BY = {
    "": "they disagree with the others or lie too near a jump to be followed",
    "ranking": "no candidate explains them",
    "settling": "their response did not settle",
    "friction": "friction takes nearly all of the force there, and noise decides how far the mass moves",
    "free motion": "the motion is mainly a free one, as after a jump or a fast passage",
    "noise of the force": "the force does not stand out of its noise",
}


@says("points-excluded")
def _points_excluded(found: Finding) -> str:
    counted = f"{found['excluded']:.0f} of {found['points']:.0f} points"
    if "level" in found.numbers:
        level, low, high = (quantity_text(*found.numbers[name], 4) for name in ("level", "low", "high"))
        return (
            f"{counted} of the level {level} were excluded, up to {found['together']:.0f} of them "
            f"neighbours, from {low} to {high}: this run disagrees with the law"
        )
    between = (
        f" between {found['low']:.5g} and {found['high']:.5g} Hz"
        if {"low", "high"} <= found.numbers.keys()
        else ""
    )
    return f"{counted}{between} were excluded: {_EXCLUDED_BY[found.names.get('by', '')]}"


@says("confounded")
def _confounded(found: Finding) -> str:
    partners, determined = found.names["with"], found.names.get("determined", "")
    if not found.parameter:
        if not determined:
            return f"no test separates {partners}: they act together in this law"
        return f"only {determined} can be identified, not {partners} separately: the law depends on no more"
    if determined:
        return (
            f"{found.parameter}: any test determines only {determined}; write one name for "
            f"each of these, or give one of {found.parameter}, {partners}"
        )
    return (
        f"{found.parameter}: only a combination with {partners} is identifiable; give one of them, test "
        "wider, or fit a simpler background"
    )


@says("noise-across")
def _noise_across(found: Finding) -> str:
    noise, part = (number_text(100 * found[name], 2) for name in ("noise", "part"))
    return (
        f"the motion across {found.names['sensors']} has {noise} % of noise of its sensors, and that noise "
        f"makes up to {part} % of what the fit rests on: the joint cannot be distinguished from it, and no "
        "value is what it seems"
    )


@says("damping-feeds-energy")
def _damping_feeds_energy(found: Finding) -> str:
    if "curve" in found.names:
        return (
            f"{found.names['curve']} gives energy to every motion: of Masing laws only virgin curves that "
            "flatten dissipate"
        )
    if found.parameter:
        return (
            f"{found.parameter} is negative, {quantity_text(*found.numbers['value'], 3)}, and its damper "
            f"feeds into the motion {found['share']:.0%} of what the whole law takes out of it"
        )
    return (
        f"{found.names['law']} feeds energy into the motion and {found.names['other']} takes it away, "
        f"{found['share']:.0%} of what the structure dissipates: such a pair can be bent to any curve"
    )


@says("law-does-not-fit")
def _law_does_not_fit(found: Finding) -> str:
    better = {
        "term": "a term {}",
        "free": "a stiffness and a damping free to follow the amplitude",
        "levels": "another factor of the {} at each level, as of a shaker whose force was not measured,",
    }
    missing = "".join(
        f"; {text.format(found.names[kind])} would leave {number_text(100 * found['left'], 2)} %"
        for kind, text in better.items()
        if kind in found.names
    )
    times = f", {found['times']:.2g} times what the periods scatter" if "times" in found.numbers else ""
    if found.severity == "warning":
        return (
            f"the law fits to {found['misfit']:.1%}, and what it leaves is systematic, not "
            f"noise{times}{missing}"
        )
    return (
        f"the law does not fit: the misfit of {found['misfit']:.1%} is systematic, not noise{times}{missing}"
    )


_ALTERNATIVES = {
    "term": "a term {} added to the law",
    "background": 'a background "{}"',
    "halves": "the difference of {}, identified separately,",
}


@says("law-ambiguous")
def _law_ambiguous(found: Finding) -> str:
    kinds = [text.format(found.names[kind]) for kind, text in _ALTERNATIVES.items() if kind in found.names]
    (said, *_) = (*kinds, "another law")
    if "shift" in found.numbers:
        shift = quantity_text(*found.numbers["shift"], 3)
        return (
            f"{said} would move {found.parameter} by {shift}, {found['times']:.2g} times its standard error, "
            f"and stands out of the noise by only {found['errors']:.2g}: the test does not tell whether the "
            "law has it, and no interval contains this shift"
        )
    left = ", and leave a tenth of the value open" if found.severity == "doubt" else ""
    moved = number_text(100 * abs(found["moved"]), 2)
    return (
        f"{said} stands out of the noise by {found['errors']:.2g} standard errors, and "
        f"moves {found.parameter} by {moved} %; the intervals hold what such alternatives move{left}"
    )


@says("even-terms-not-seen")
def _even_terms_not_seen(found: Finding) -> str:
    if "even" not in found.numbers:
        return (
            f"{found.parameter}: an even force changes the fundamental only by the square of its size, and "
            "the test is fitted as well without it; record the mean or the second harmonic"
        )
    only = found.names.get("determined", "")
    combined = f"; determined is {only}, with the interval of {found.parameter}" if only else ""
    return (
        "a force k2*x**2, as of weight or of two stiffnesses, is not seen in fundamentals: at "
        f"{found['even']:.0%} of the spring's at {quantity_text(*found.numbers['amplitude'], 3)} it moves "
        f"{found.parameter} by {number_text(100 * found['moved'], 2)} %, and as its square{combined}; "
        "record the mean or the second harmonic"
    )


@says("parts-disagree")
def _parts_disagree(found: Finding) -> str:
    meaning = (
        "too little to separate parts" if found.severity == "warning" else "one law does not hold for all"
    )
    after = f" ({found['after']:.2g} of the widened ones)" if "after" in found.numbers else ""
    return (
        f"{found.names['parts']}, identified separately, differ by up to {found['z']:.2g} standard errors"
        f"{after}, or {found['size']:.1%} of force and response: {meaning}"
    )


@says("identified")
def _identified(found: Finding) -> str:
    levels = count_text(int(found["levels"]), "level")
    if "lines" not in found.numbers:
        of, size = f"{found['used']:.0f} of {found['points']:.0f} points", "their size"
    else:
        records = count_text(int(found["records"]), "record")
        of = f"{found['lines']:.0f} lines, {found['excited']:.0f} of them excited, of {records}"
        size = "the force"
    return (
        f"{found['identified']:.0f} of {found['parameters']:.0f} parameters have a value from {of} at "
        f"{levels}; force and response differ from the law by {number_text(100 * found['misfit'], 2)} % of "
        f"{size}"
    )


@says("background-missing")
def _background_missing(found: Finding) -> str:
    if "moved" in found.numbers:
        misfit, left = (number_text(100 * found[name], 2) for name in ("misfit", "left"))
        return (
            f'with [identify] background = "{found.names["kind"]}" the misfit is {left} % in place of '
            f"{misfit} %, and {found.parameter} differs by {found['moved']:+.1%}, {found['times']:.2g} "
            "standard errors"
        )
    if "kind" in found.names:
        misfit, left = (number_text(found[name], 2) for name in ("misfit", "left"))
        return (
            "a response that does not depend on the force, as pick-up from the generator leaves it, would "
            f'take the misfit from {misfit} to {left}: try [identify] background = "{found.names["kind"]}"'
        )
    # as it is typed into a case
    low, high = (f"{float(found[end]):.4g} Hz" for end in ("low", "high"))
    return (
        'a sensor may see more than the mode: try [identify] background = "phase", "constant" or '
        f'"residuals", and band = ["{low}", "{high}"], which is '
        f"{found['widths']:g} widths of the resonance to either side"
    )


@says("repeats-scatter")
def _repeats_scatter(found: Finding) -> str:
    early = (
        f" ({found['excluded']:.0f} more lie far off the others of their point, as before a response has "
        "settled, and were excluded)"
        if found["excluded"]
        else ""
    )
    scatter = (
        f"{found['readings']:.0f} readings of {found['points']:.0f} points: one reading scatters by "
        f"{found['of_reading']:.2g} of its size, the mean of {found['repeats']:g} by {found['of_mean']:.2g}"
        f"{early}"
    )
    if "misfit" not in found.numbers:
        return scatter
    if found.severity == "info":
        return f"{scatter}; the misfit of {found['misfit']:.2g} is no larger than the scatter of the means"
    return (
        f"{scatter}; the misfit of {found['misfit']:.2g} is {found['times']:.2g} times the scatter of the "
        "means, so that the law is not exact, or the readings of a point share an error: half of the "
        f"standard errors, which contain what the law leaves, are more than {found['wider']:.2g} times as "
        "wide as the scatter alone would make them"
    )


# ----------------------------------------------------------------------------
# Sentences about tests at phase resonance, and about continuations.

say_plainly(
    {
        "needs-mass": (
            "the mass is not known, so that neither resonance curves nor held-out levels are predicted: off "
            "resonance both depend on it"
        ),
        "phase-not-resonant": (
            "no point of the phase-locked test lies near resonance: the response lags the force by {lag:.3q} "
            "in place of 90 deg"
        ),
        "phase-lock-lost": (
            "at {lost:.0f} of {points:.0f} points the response lags the force by {low:.3q} to "
            "{high:.3q}, at forces that no other point has: where the loop lost the lock the motion was not "
            "steady; leave out such points, or measure them again"
        ),
    }
)

NEXT_STEPS |= {
    "phase-gap": (
        "Take the rows of one mode: [identify] band between its frequencies, or a file of its own; where it "
        "is one mode, test some levels between."
    ),
    "mass-at-resonance": (
        "Give the mass under [system], or measure one slice off resonance: some frequencies on both sides at "
        "one level."
    ),
    "phase-lag": (
        "Look at the phase of the loop's filters and at the sense and quantity of the response; the loop is "
        "to hold 90 degrees between force and displacement."
    ),
    "phase-not-resonant": (
        "Look at sense, sign and quantity of the response: at resonance a velocity is in phase with the "
        "force."
    ),
}


@says("mass-at-resonance")
def _mass_at_resonance(found: Finding) -> str:
    at = f"all {found['points']:.0f} points lie at phase resonance"
    if found.names.get("by") == "loops":
        return (
            f"{at}: the mass follows only from loops of the law, whose area has the stiffness in it, and is "
            "as right as the law"
        )
    return (
        f"{at}, where k - m omega^2 vanishes whatever the mass is: only the damping and the ratio of "
        "stiffness to mass follow. Give the mass under [system], or measure one slice off resonance, to have "
        "the stiffness itself"
    )


@says("phase-lag")
def _phase_lag(found: Finding) -> str:
    if found.names.get("by") == "assumed":
        return (
            "no phase was recorded: all points of the phase-locked test are taken to lag by 90 degrees, and "
            "nothing shows whether the loop held them there; intervals allow for a lag of the whole test "
            "that is off by two degrees (one standard deviation)"
        )
    middle, scatter = (quantity_text(*found.numbers[name], 4) for name in ("lag", "scatter"))
    lag = (
        f"at {found['points']:.0f} points of phase resonance the response lags the force by {middle}, with a "
        f"scatter of {scatter}"
    )
    if found.severity == "info":
        return f"{lag}: the loop held resonance"
    return (
        f"{lag}, not by 90 deg: k/m read as omega^2 is off by {found['shift']:.1%} of the damping ratio; "
        "it is corrected where the mass is known"
    )


@says("phase-gap")
def _phase_gap(found: Finding) -> str:
    low, high = (number_text(float(found[end]), 4) for end in ("low", "high"))
    if "overlap" in found.names:
        return (
            f"the points of the phase-locked test lie on two backbones, near {low} and {high} Hz: they "
            "belong to two modes, and a law is of one"
        )
    return (
        f"points at phase resonance lie near {low} and near {high} Hz, at amplitudes that do not overlap, "
        "with nothing between: levels between were not tested, or the two belong to two modes"
    )


# ----------------------------------------------------------------------------
# Sentences about modal tables.

say_plainly(
    {
        "modal-scattered": (
            "the points of the modal table depart by {misfit:.1%} from one curve k(X) and one curve c(X): "
            "noise, several modes in the band, or a response that depends on more than its amplitude"
        ),
    }
)
