"""Sentences about identifications."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units import count_text, number_text, quantity_text
from rsgen.report.wording.sentences import says


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
    "background of the second sensor": 'a background "{}" of the second sensor',
    "halves": "the difference of {}, identified separately,",
}


@says("law-ambiguous")
def _law_ambiguous(found: Finding) -> str:
    kinds = [text.format(found.names[kind]) for kind, text in _ALTERNATIVES.items() if kind in found.names]
    (said, *_) = (*kinds, "another law")
    if "shift" in found.numbers:
        shift = quantity_text(*found.numbers["shift"], 3)
        if "parameters" in found.names:
            return (
                f"{said} that the noise hides would move {found.parameter} by up to {shift}, "
                f"{found['times']:.2g} times its standard error: {found.names['parameters']} and their "
                "intervals hold if the response contains no other modes"
            )
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
        "a force k2*x**2, as of weight or of unequal springs, is not seen in fundamentals: at "
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
        f"identified separately, {found.names['parts']} differ by up to {found['z']:.2g} standard errors"
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
