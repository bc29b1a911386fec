"""Sentences about surfaces, measured files and time histories."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly, says

say_plainly(
    {
        "points-not-measured": (
            "{points:g} of {all:g} points have no measured force or response and are left out"
        ),
        "rows-copied": (
            "{copies:g} of {all:g} rows repeat another of the same level and frequency to the last digit: "
            "written twice, not measured twice, and left out"
        ),
        "note": "{text}",
        "direction-from-branch": (
            "runs of one level lie on two branches in one order of frequency: {points:.0f} points are taken "
            "as swept the other way; where that is wrong, say in the case how they were swept "
            "(sweep.direction, or sweep.column)"
        ),
        "record-clipped": (
            "{record}: the {signal} is cut off at the end of its range in {samples:.0f} samples; amplitudes "
            "are too small there: measure with a wider range, or use start and stop"
        ),
        "sweep-not-corrected": (
            "the force was not corrected for the sweep rate: over this band the sweeps do not "
            "determine a moving mass, as they would with one mode in it; choose a band around one mode, or "
            "give the mass"
        ),
        "motion-mainly-free": (
            "at {aside:.0f} of {points:.0f} swept points, between {low:.5g} and {high:.5g} Hz, the motion is "
            "mainly a free one, as after a jump or a fast passage; these points are left out"
        ),
        "force-in-noise": (
            "at {aside:.0f} of {points:.0f} swept points, between {low:.5g} and {high:.5g} Hz, the force "
            "does not stand out of its noise; these points are left out"
        ),
        "another-maximum": (
            "{record}: response over force has another maximum near {frequency:.4g} Hz, of another mode "
            "perhaps; choose a band around one mode, or fit a background"
        ),
        "force-distorted": (
            "{record}: harmonics of the force reach {harmonics:.0%} of its fundamental; laws are fitted as "
            "if it were a sine"
        ),
        "force-of-decay": (
            "{record}: points of a free decay; the force of each is the one that would have held its "
            "motion, computed with the given mass"
        ),
        "several-decays": (
            "{record}: {found:.0f} decays, one after each blow or drive, {used:.0f} of which are used; each "
            "is a level of its own"
        ),
        "decay-rises": (
            "{record}: the amplitude rises again, more slowly than by a blow, from {end:.4g} s on: two modes "
            "beat, or something drives the structure"
        ),
        "drive-after-start": (
            "{record}: the decay is taken from {begin:.4g} s on, as the case says, but the structure is "
            "still driven then"
        ),
        "force-not-sine": (
            "{record}: only {share:.0%} of the power of the force is at its line and harmonics; the rest, "
            "noise or other lines, drives the structure, too"
        ),
        "response-not-at-drive": (
            "{record}: only {share:.0%} of the power of the response is at the lines of the force; the rest "
            "is noise, another source, or motion that is not periodic"
        ),
        "force-not-recorded": (
            "the force was not recorded and the nominal level stands for it; real forces fall at resonance, "
            "which then looks like damping and stiffness of the structure"
        ),
        "force-from-ratio": (
            "the files hold response over force, so the level stands for the force; where the real force "
            "was smaller, so was the amplitude, and k(X) and c(X) are shifted in amplitude by as much"
        ),
        "unit-of-file": (
            "{file}: {column} was read in {unit}, as the file says ({source}); a unit in the case would win"
        ),
        "unit-of-file-unusable": (
            "{file}: {column} was read in {assumed}; the file says {unit}, which is another dimension: name "
            "the unit and the factor in the case"
        ),
        "rows-of-words": (
            "{file}: rows of words among the numbers, as a header that repeats, passed over: {rows:.0f}; the "
            "first is line {line:.0f}"
        ),
        "rows-twice": (
            "{file}: {rows:.0f} of {all:.0f} rows repeat the row before to the last digit: written twice, "
            "not measured twice, and left out"
        ),
        "rows-without-number": (
            "{file}: {rows:.0f} of {all:.0f} rows left out, without a number where one is needed; the first "
            "is {first}"
        ),
        "response-stands-still": (
            "{record}: the response stands still while the force moves, {times:.0f} times, longest at "
            "{begin:.5g} s for {length:.3g} s: a drop-out; look at the points around it"
        ),
        "last-line-open": (
            "{file}: the last line has no line end, as where a file was cut off; see that nothing is missing"
        ),
        "frequency-angular": (
            "{file}: {column} was read in Hz, but its name says an angular frequency in rad/s; masses would "
            "be off by a factor of 39"
        ),
        "levels-are-labels": (
            "the levels {labels} are labels, not amounts of what was measured; in this order the levels are "
            "{amounts}, measured near the resonance"
        ),
        "levels-disagree": (
            "the levels are said to be {labels} {unit}, but {amounts} were measured; the measured ones are "
            "used"
        ),
        "levels-of-one-force": "{count:.0f} levels of different names were all measured at {amount:.3q}",
        "unit-contradicts-title": "{file}: {column} is read in {unit}, but its title says {title}",
        "levels-swapped": (
            "the level of {low:.3q} was driven harder than that of {high:.3q}: measured {low_measured:.3q} "
            "and {high_measured:.3q}"
        ),
        "response-held": (
            "within each run the amplitude of the response is constant and the force varies, so the test is "
            'read as response-controlled; if it was not, write control = "force" under [test]'
        ),
        "run-repeated": (
            "{first} and {second} hold the same numbers row by row: one run was copied in place of another"
        ),
        "runs-of-other-size": (
            "response over force differs by a factor of about {factor:.0f} between {first} and {second}: "
            "their units differ, as m and mm do"
        ),
        "response-not-held": (
            "the case says that the response was held within a level, but it varies by {moved:.0%} at "
            "{level:.3q}"
        ),
    }
)
NEXT_STEPS.update(
    {
        "frequency-angular": 'Write unit = "rad/s" under [test.frequency], or unit = "Hz" where it is in Hz.',
        "levels-disagree": (
            'Write unit = "label" under [test.level] where the levels are names of runs; otherwise look for '
            "a wrong unit or factor of the level or of what was measured."
        ),
        "levels-of-one-force": (
            'Look whether the force was recorded at all; write unit = "label" under [test.level] if these '
            "are repeats of one level."
        ),
        "unit-contradicts-title": "Look which of the two is right, and change the case or the title.",
        "levels-swapped": "Look whether two files, or two numbers of [test.level], are swapped.",
        "run-repeated": "Look for the run that is missing, and take the copy out.",
        "runs-of-other-size": "Bring the files to one unit, or read them in cases of their own.",
        "response-not-held": 'Leave out control = "response" if the test held the force.',
        "decay-rises": "Choose a band around one mode, or use stop to end the record before the rise.",
        "drive-after-start": "Leave the start out, so that the end of the drive is found, or move it.",
        "force-not-sine": "Measure with a stepped or swept sine, and look for what else is in the force.",
        "response-not-at-drive": (
            "Look at the spectrum of the response, choose a band, or remove what else moves the structure."
        ),
        "motion-mainly-free": "Sweep slower, or step the frequency and wait until the response is steady.",
        "force-in-noise": (
            "Measure the force with less noise or a smaller range, or keep it from falling at the resonance."
        ),
    }
)


@says("decay-taken")
def _(found: Finding) -> str:
    begins = {
        "drive": f"a drive ends at {found['begin']:.4g} s",
        "start": f"it begins at {found['begin']:.4g} s, as given",
        "blow": f"it begins at {found['begin']:.4g} s",
    }[found.names["after"]]
    floor = f", above a floor of {found['floor']:.2g} m" if found["floor"] > 0 else ""
    return (
        f"{found.names['record']}: {begins}; the decay is followed from {found['first']:.4g} s "
        f"({found['large']:.3g} m) to {found['last']:.4g} s ({found['small']:.3g} m){floor}"
    )


@says("sweep-fast")
def _(found: Finding) -> str:
    beyond = (
        f"; beyond {found['proved_up_to']:g} this leaves errors of some percent in c(X): sweep slower"
        if found["pace"] > found["proved_up_to"]
        else ""
    )
    return (
        f"{found.names['record']}: the sweep {found.names['direction']} at {found['rate']:.3g} Hz/s is fast "
        f"for a resonance at {found['resonance']:.4g} Hz with half width {found['half_width']:.2g} Hz: "
        f"rate/(half width)^2 = {found['pace']:.2g}, which shifts it by {found['shift']:.2g} half widths. "
        f"The force was corrected for that, by {found['correction']:.1%} at the resonance, with the mass "
        f"{found['mass']:.4g} kg ({found.names['mass']}){beyond}"
    )


@says("not-passive")
def _(found: Finding) -> str:
    against = {
        "power": "the structure would feed energy into the shaker",
        "mass": "the moving mass would be negative",
    }
    odd = " and ".join(against[fault] for fault in found.names["against"].split(" and "))
    turn = f'set test.response.phase_sense = "{found.names.get("phase_sense", "")}"'
    sign = "give test.response.factor the other sign"
    advice = {
        "channel": f"a channel is probably reversed; {sign}",
        "phase": f"the phase is probably reversed; {turn}",
        "channel and phase": f"a channel and its phase are probably reversed; {turn} and {sign}",
        "unknown": "the channels are probably late against each other, or one is reversed",
    }[found.names["reversed"]]
    return f"as the case reads force and response, {odd}: {advice}"
