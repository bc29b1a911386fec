"""Sentences about surfaces, measured files and time histories."""

from __future__ import annotations

from rsgen.finding import Finding
from rsgen.report.wording.sentences import say_plainly, says

say_plainly(
    {
        "points-not-measured": (
            "{points:g} of {all:g} points have no measured force or response and are left out"
        ),
        "note": "{text}",
        "record-clipped": (
            "{record}: the {signal} is cut off at the end of its range in {samples:.0f} samples; amplitudes "
            "are too small there: measure with a wider range, or use start and stop"
        ),
        "sweep-not-corrected": (
            "the force was not corrected for the pace of the sweep: over this band the sweeps do not "
            "determine a moving mass, as they would with one mode in it; choose a band around one mode, or "
            "give the mass"
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
        "force-not-recorded": (
            "the force was not recorded and the nominal level stands for it; real forces fall at resonance, "
            "which then looks like damping and stiffness of the structure"
        ),
        "force-from-ratio": (
            "the files hold response over force, so the level stands for the force; where the real one "
            "fell, so did the amplitude, and laws of amplitude are off by as much"
        ),
        "unit-of-file": (
            "{file}: {column} was read in {unit}, as the file says ({source}); a unit in the case would win"
        ),
        "unit-of-file-unusable": (
            "{file}: {column} was read in {assumed}; the file says {unit}, which is another dimension: name "
            "the unit and the factor in the case"
        ),
    }
)


@says("response-stands-still")
def _(found: Finding) -> str:
    times = "once" if found["times"] == 1 else f"{found['times']:.0f} times"
    return (
        f"{found.names['record']}: the response stands still {times} while the force moves, longest at "
        f"{found['begin']:.5g} s for {found['length']:.3g} s: a drop-out; look at the points around it"
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
