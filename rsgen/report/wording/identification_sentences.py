"""Sentences about identifications."""

from __future__ import annotations

from rsgen.figures.scale import quantity_text
from rsgen.finding import Finding
from rsgen.report.wording.sentences import number, says


def _tested(found: Finding) -> str:
    amplitude, level = (quantity_text(*found.numbers[name], 3) for name in ("amplitude", "level"))
    return f"X up to {amplitude}, levels up to {level}"


@says("identified")
def _(found: Finding) -> str:
    levels = f"{found['levels']:.0f} {'level' if found['levels'] == 1 else 'levels'}"
    return (
        f"{found['identified']:.0f} of {found['parameters']:.0f} parameters identified from "
        f"{found['used']:.0f} of {found['points']:.0f} points at {levels}; force and response agree with the "
        f"law within {number(100 * found['misfit'], 2)} % of their size"
    )


@says("values-given")
def _(_: Finding) -> str:
    return "all parameters are given, none was identified"


@says("confounded")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: only a combination with {found.names['with']} is identifiable; give one of "
        "them, or test wider"
    )


@says("confounded-with-background")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: only a combination with the background is identifiable; test wider, or fit a "
        "simpler background"
    )


@says("no-effect")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: the response does not depend on it in the tested range ({_tested(found)}); "
        "raise the level until it does"
    )


@says("not-distinct-from-zero")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: {found['value']:.2g} with standard error {found['standard_error']:.2g} cannot "
        f"be distinguished from zero ({_tested(found)}); raise the level or take more points near the "
        "resonance"
    )


@says("not-determined")
def _(found: Finding) -> str:
    return f"{found.parameter}: not determined by the points that this method uses"


@says("shift-small")
def _(found: Finding) -> str:
    return (
        f"the resonance shifts by {found['shift']:.2g} Hz over all levels, less than its width of "
        f"{found['width']:.2g} Hz; raise the level above {quantity_text(*found.numbers['level'])}"
    )


@says("phase-not-recorded")
def _(_: Finding) -> str:
    return (
        "phase not recorded: only amplitudes were fitted; damping is taken as positive, k(X) and c(X) of "
        "single points rest on the phase that the law predicts, and a law that is wrong in phase is not seen "
        "to be"
    )


@says("not-calibrated")
def _(_: Finding) -> str:
    return (
        "arbitrary scale: force or response are not calibrated, so m and every parameter are per unit of the "
        "drive and of the response; frequencies and damping ratios hold as they are"
    )


@says("points-not-settled")
def _(found: Finding) -> str:
    return f"{found['unsettled']:.0f} of {found['all']:.0f} points have no settled response and were left out"


@says("points-set-aside")
def _(found: Finding) -> str:
    return (
        f"{found['aside']:.0f} of {found['points']:.0f} points were set aside: they disagree with the others "
        "or lie too near a jump to be followed"
    )


@says("not-converged")
def _(_: Finding) -> str:
    return "the refined fit did not converge: compare with the first-order estimates and doubt both"


@says("law-does-not-fit")
def _(found: Finding) -> str:
    return (
        f"the law does not fit: the misfit of {found['misfit']:.1%} is systematic over amplitude and "
        "frequency, not noise; intervals are too narrow, try another law"
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


@says("harmonic-strong")
def _(found: Finding) -> str:
    return (
        f"harmonic {found['harmonic']:.0f} reaches {found['share']:.0%} of the fundamental (at "
        f"{quantity_text(*found.numbers['level'])}, {found['frequency']:.4g} Hz): first-order estimates are "
        "biased there"
    )


@says("mean-of-symmetric-law")
def _(found: Finding) -> str:
    return (
        f"the mean displacement is {found['share']:.0%} of the amplitude, but the law is symmetric: an "
        "asymmetric part is missing or the sensor drifts"
    )


@says("resonance-jumped")
def _(found: Finding) -> str:
    return (
        f"the response jumps across the resonance, or does not reach it, in {found['jumps']:.0f} of "
        f"{found['runs']:.0f} runs: there the paper's points are extrapolated from one side"
    )


@says("resonance-sparse")
def _(found: Finding) -> str:
    return (
        f"{found['few']:.0f} of {found['runs']:.0f} runs have fewer than {found['points']:.0f} points within "
        "the width of the resonance: damping rests on little there"
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


@says("misfit-is-scatter")
def _(found: Finding) -> str:
    return (
        f"the misfit of {found['misfit']:.2g} is no more than the scatter of the means: the law leaves "
        "nothing over"
    )


@says("misfit-beyond-scatter")
def _(found: Finding) -> str:
    return (
        f"the misfit of {found['misfit']:.2g} is {found['times']:.2g} times the scatter of the means: model "
        "error beyond the noise. Standard errors are those of doing the test again with this law; were the "
        f"misfit noise, they would be {found['wider']:.2g} times wider"
    )
