"""Sentences about identifications."""

from __future__ import annotations

from rsgen.figures.scale import number_text
from rsgen.finding import Finding
from rsgen.report.wording.sentences import say_plainly, says

_TESTED = "X up to {amplitude:.3q}, levels up to {level:.3q}"

say_plainly(
    {
        "values-given": "all parameters are given, none was identified",
        "confounded": (
            "{parameter}: only a combination with {with} is identifiable; give one of them, or test wider"
        ),
        "confounded-with-background": (
            "{parameter}: only a combination with the background is identifiable; test wider, or fit a "
            "simpler background"
        ),
        "no-effect": (
            f"{{parameter}}: the response does not depend on it in the tested range ({_TESTED}); raise the "
            "level until it does"
        ),
        "not-distinct-from-zero": (
            "{parameter}: {value:.2g} with standard error {standard_error:.2g} cannot be distinguished from "
            f"zero ({_TESTED}); raise the level or take more points near the resonance"
        ),
        "not-determined": "{parameter}: not determined by the points that this method uses",
        "shift-small": (
            "the resonance shifts by {shift:.2g} Hz over all levels, less than its width of {width:.2g} Hz; "
            "raise the level above {level:.4q}"
        ),
        "phase-not-recorded": (
            "phase not recorded: only amplitudes were fitted; damping is taken as positive, k(X) and c(X) of "
            "single points rest on the phase that the law predicts, and a law that is wrong in phase is not "
            "seen to be"
        ),
        "not-calibrated": (
            "arbitrary scale: force or response are not calibrated, so m and every parameter are per unit of "
            "the drive and of the response; frequencies and damping ratios hold as they are"
        ),
        "points-not-settled": (
            "{unsettled:.0f} of {all:.0f} points have no settled response and were left out"
        ),
        "points-set-aside": (
            "{aside:.0f} of {points:.0f} points were set aside: they disagree with the others or lie too "
            "near a jump to be followed"
        ),
        "not-converged": (
            "the refined fit did not converge: compare with the first-order estimates and doubt both"
        ),
        "law-does-not-fit": (
            "the law does not fit: the misfit of {misfit:.1%} is systematic over amplitude and frequency, "
            "not noise; intervals are too narrow, try another law"
        ),
        "harmonic-strong": (
            "harmonic {harmonic:.0f} reaches {share:.0%} of the fundamental (at {level:.4q}, "
            "{frequency:.4g} Hz): first-order estimates are biased there"
        ),
        "mean-of-symmetric-law": (
            "the mean displacement is {share:.0%} of the amplitude, but the law is symmetric: an asymmetric "
            "part is missing or the sensor drifts"
        ),
        "resonance-jumped": (
            "the response jumps across the resonance, or does not reach it, in {jumps:.0f} of {runs:.0f} "
            "runs: there the paper's points are extrapolated from one side"
        ),
        "resonance-sparse": (
            "{few:.0f} of {runs:.0f} runs have fewer than {points:.0f} points within the width of the "
            "resonance: damping rests on little there"
        ),
        "misfit-is-scatter": (
            "the misfit of {misfit:.2g} is no more than the scatter of the means: the law leaves nothing over"
        ),
        "misfit-beyond-scatter": (
            "the misfit of {misfit:.2g} is {times:.2g} times the scatter of the means: model error beyond "
            "the noise. Standard errors are those of doing the test again with this law; were the misfit "
            "noise, they would be {wider:.2g} times wider"
        ),
    }
)


@says("identified")
def _(found: Finding) -> str:
    levels = f"{found['levels']:.0f} {'level' if found['levels'] == 1 else 'levels'}"
    return (
        f"{found['identified']:.0f} of {found['parameters']:.0f} parameters identified from "
        f"{found['used']:.0f} of {found['points']:.0f} points at {levels}; force and response agree with the "
        f"law within {number_text(100 * found['misfit'], 2)} % of their size"
    )


@says("background-possible")
def _(found: Finding) -> str:
    # as it is typed into a case
    low, high = (f"{float(found[end]):.4g} Hz" for end in ("low", "high"))
    return (
        'a sensor may see more than the mode: try [identify] background = "phase", "constant" or '
        f'"residuals", and band = ["{low}", "{high}"], which is '
        f"{found['widths']:g} widths of the resonance to either side"
    )


@says("repeats-scatter")
def _(found: Finding) -> str:
    aside = (
        f" ({found['aside']:.0f} more lie far off the others of their point, as before a response has "
        "settled, and were set aside)"
        if found["aside"]
        else ""
    )
    return (
        f"{found['readings']:.0f} readings of {found['points']:.0f} points: one reading scatters by "
        f"{found['of_reading']:.2g} of its size, the mean of {found['repeats']:g} by {found['of_mean']:.2g}"
        f"{aside}"
    )
