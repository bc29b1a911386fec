"""Sentences about tests at phase resonance, and about continuations."""

from __future__ import annotations

from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly

_LAG = (
    "at {points:.0f} points of phase resonance the response lags the force by {lag:.2f} degrees, with a "
    "scatter of {scatter:.2f}"
)

say_plainly(
    {
        "phase-lag-held": f"{_LAG}: the loop held resonance",
        "phase-lag-off": (
            f"{_LAG}, not by 90: k/m read as omega^2 is off by {{shift:.1%}} of the damping ratio; it is "
            "corrected where the mass is known"
        ),
        "phase-not-resonant": (
            "no point of the phase-locked test lies near resonance: the response lags the force by {lag:.0f} "
            "degrees in place of 90"
        ),
        "phase-lock-lost": (
            "at {lost:.0f} of {points:.0f} points the response lags the force by {low:.0f} to {high:.0f} "
            "degrees, at forces that no other point has: where the loop lost the lock the motion was not "
            "steady; leave out such points, or measure them again"
        ),
        "phase-two-modes": (
            "the points of the phase-locked test lie on two backbones, near {low:.4g} and {high:.4g} Hz: "
            "they belong to two modes, and a law is of one"
        ),
        "phase-gap": (
            "points at phase resonance lie near {low:.4g} and near {high:.4g} Hz, at amplitudes that do not "
            "overlap, with nothing between: levels between were not tested, or the two belong to two modes"
        ),
        "phase-lag-assumed": (
            "no phase was recorded: all points of the phase-locked test are taken to lag by 90 degrees, and "
            "nothing shows whether the loop held them there; intervals allow for a lag of the whole test "
            "that is off by two degrees (one standard deviation)"
        ),
        "continuation-recognised": (
            "at some frequency the force falls while the amplitude grows, so the test is read as a "
            'control-based continuation; if it was none, write control = "force" under [test]'
        ),
        "mass-at-resonance": (
            "all {points:.0f} points lie at phase resonance, where k - m omega^2 vanishes whatever the mass "
            "is; the damping and the ratio of stiffness to mass are identified, no more. Give the mass under "
            "[system], or measure one slice off resonance, to have the stiffness itself"
        ),
        "mass-by-loops": (
            "all {points:.0f} points lie at phase resonance: the mass follows only from loops of the law, "
            "whose area has the stiffness in it, and is as right as the law"
        ),
        "ratio-to-mass": (
            "{parameter}: only {parameter}/m is identifiable at phase resonance: {ratio:.6q}, 95 % interval "
            "{low:.6q} to {high:.6q} for damping ratios up to {damping:.2p}"
        ),
        "ratios-hold-from": (
            "the intervals of the ratios to the mass hold if the damping ratio is at most {damping:.2p}, and "
            "with the damping found that is a mass of at least {least:.3q}; those of a lighter structure may "
            "not contain the truth"
        ),
        "needs-mass": "{parameter}: not identifiable at phase resonance without the mass, which scales it",
        "phase-resonance": (
            "all points lie within 20 degrees of phase resonance, so the test is read as phase-locked; if it "
            'was not, write control = "force" under [test]'
        ),
    }
)

NEXT_STEPS |= {
    "ratios-hold-from": (
        "See whether the structure has that mass; if it has not, give its mass under [system], even if it is "
        "known to a fifth only."
    ),
    "phase-two-modes": (
        "Take the rows of one mode: [identify] band between its frequencies, or a file of its own."
    ),
    "phase-gap": (
        "Test some levels between; or take the rows of one mode: [identify] band between its frequencies."
    ),
    "mass-at-resonance": (
        "Give the mass under [system], or measure one slice off resonance: some frequencies on both sides at "
        "one level."
    ),
    "phase-lag-off": (
        "Look at the phase of the loop's filters and at the sense and quantity of the response; the loop is "
        "to hold 90 degrees between force and displacement."
    ),
    "phase-not-resonant": (
        "Look at sense, sign and quantity of the response: at resonance a velocity is in phase with the "
        "force."
    ),
}
