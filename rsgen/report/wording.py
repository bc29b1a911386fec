"""Every sentence that rsgen says about a result, one function a finding.

The numerical layers make findings (``rsgen.finding``); pages, notebooks, ``result.json`` and the command line
take their sentences from here. Nothing reads a sentence back.
"""

from __future__ import annotations

from collections.abc import Callable

from rsgen.figures.scale import quantity_text
from rsgen.finding import Finding

__all__ = ["sentence"]

_SENTENCES: dict[str, Callable[[Finding], str]] = {}


def _says(code: str) -> Callable[[Callable[[Finding], str]], Callable[[Finding], str]]:
    """Register the sentence of a code."""

    def register(function: Callable[[Finding], str]) -> Callable[[Finding], str]:
        _SENTENCES[code] = function
        return function

    return register


def sentence(finding: Finding) -> str:
    """Say a finding in one sentence; a code without a sentence is shown as data."""
    say = _SENTENCES.get(finding.code)
    return repr(finding) if say is None else say(finding)


def quantity(found: Finding, name: str, digits: int = 3) -> str:
    """Print a number of a finding with its unit, as a book does."""
    value, unit = found.numbers[name]
    return quantity_text(value, unit, digits)


# --- surface, measurement and history ---


@_says("points-not-measured")
def _(f: Finding) -> str:
    return f"{f['points']:g} of {f['all']:g} points have no measured force or response and are left out"


@_says("note")
def _(found: Finding) -> str:
    return found.names["text"]


@_says("record-clipped")
def _(found: Finding) -> str:
    return (
        f"{found.names['record']}: the {found.names['signal']} is cut off at the end of its range in "
        f"{found['samples']:.0f} samples; amplitudes are too small there: measure with a wider range, or use "
        "start and stop"
    )


@_says("response-stands-still")
def _(found: Finding) -> str:
    times = "once" if found["times"] == 1 else f"{found['times']:.0f} times"
    return (
        f"{found.names['record']}: the response stands still {times} while the force moves, longest at "
        f"{found['begin']:.5g} s for {found['length']:.3g} s: a drop-out; look at the points around it"
    )


@_says("sweep-fast")
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


@_says("sweep-not-corrected")
def _(_: Finding) -> str:
    return (
        "the force was not corrected for the pace of the sweep: over this band the sweeps do not determine "
        "a moving mass, as they would with one mode in it; choose a band around one mode, or give the mass"
    )


@_says("another-maximum")
def _(found: Finding) -> str:
    return (
        f"{found.names['record']}: response over force has another maximum near {found['frequency']:.4g} Hz, "
        "of another mode perhaps; choose a band around one mode, or fit a background"
    )


@_says("force-distorted")
def _(found: Finding) -> str:
    return (
        f"{found.names['record']}: harmonics of the force reach {found['harmonics']:.0%} of its fundamental; "
        "laws are fitted as if it were a sine"
    )


@_says("force-of-decay")
def _(found: Finding) -> str:
    return (
        f"{found.names['record']}: points of a free decay; the force of each is the one that would have held "
        "its motion, computed with the given mass"
    )


@_says("force-not-recorded")
def _(_: Finding) -> str:
    return (
        "the force was not recorded and the nominal level stands for it; real forces fall at resonance, "
        "which then looks like damping and stiffness of the structure"
    )


@_says("force-from-ratio")
def _(_: Finding) -> str:
    return (
        "the files hold response over force, so the level stands for the force; where the real one fell, so "
        "did the amplitude, and laws of amplitude are off by as much"
    )


@_says("unit-of-file")
def _(found: Finding) -> str:
    return (
        f"{found.names['file']}: {found.names['column']} was read in {found.names['unit']}, as the file says "
        f"({found.names['source']}); a unit in the case would win"
    )


@_says("unit-of-file-unusable")
def _(found: Finding) -> str:
    return (
        f"{found.names['file']}: {found.names['column']} was read in {found.names['assumed']}; the file says "
        f"{found.names['unit']}, which is another dimension: name the unit and the factor in the case"
    )


@_says("not-passive")
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


# --- identification ---


def _tested(found: Finding) -> str:
    amplitude, level = (quantity_text(*found.numbers[name], 3) for name in ("amplitude", "level"))
    return f"X up to {amplitude}, levels up to {level}"


@_says("identified")
def _(found: Finding) -> str:
    levels = f"{found['levels']:.0f} {'level' if found['levels'] == 1 else 'levels'}"
    return (
        f"{found['identified']:.0f} of {found['parameters']:.0f} parameters identified from "
        f"{found['used']:.0f} of {found['points']:.0f} points at {levels}; force and response agree with the "
        f"law within {100 * found['misfit']:.2g} % of their size"
    )


@_says("values-given")
def _(_: Finding) -> str:
    return "all parameters are given, none was identified"


@_says("confounded")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: only a combination with {found.names['with']} is identifiable; give one of "
        "them, or test wider"
    )


@_says("confounded-with-background")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: only a combination with the background is identifiable; test wider, or fit a "
        "simpler background"
    )


@_says("no-effect")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: the response does not depend on it in the tested range ({_tested(found)}); "
        "raise the level until it does"
    )


@_says("not-distinct-from-zero")
def _(found: Finding) -> str:
    return (
        f"{found.parameter}: {found['value']:.2g} with standard error {found['standard_error']:.2g} cannot "
        f"be distinguished from zero ({_tested(found)}); raise the level or take more points near the "
        "resonance"
    )


@_says("not-determined")
def _(found: Finding) -> str:
    return f"{found.parameter}: not determined by the points that this method uses"


@_says("shift-small")
def _(found: Finding) -> str:
    return (
        f"the resonance shifts by {found['shift']:.2g} Hz over all levels, less than its width of "
        f"{found['width']:.2g} Hz; raise the level above {quantity_text(*found.numbers['level'])}"
    )


@_says("phase-not-recorded")
def _(_: Finding) -> str:
    return (
        "phase not recorded: only amplitudes were fitted; damping is taken as positive, k(X) and c(X) of "
        "single points rest on the phase that the law predicts, and a law that is wrong in phase is not seen "
        "to be"
    )


@_says("not-calibrated")
def _(_: Finding) -> str:
    return (
        "arbitrary scale: force or response are not calibrated, so m and every parameter are per unit of the "
        "drive and of the response; frequencies and damping ratios hold as they are"
    )


@_says("points-not-settled")
def _(found: Finding) -> str:
    return f"{found['unsettled']:.0f} of {found['all']:.0f} points have no settled response and were left out"


@_says("points-set-aside")
def _(found: Finding) -> str:
    return (
        f"{found['aside']:.0f} of {found['points']:.0f} points were set aside: they disagree with the others "
        "or lie too near a jump to be followed"
    )


@_says("not-converged")
def _(_: Finding) -> str:
    return "the refined fit did not converge: compare with the first-order estimates and doubt both"


@_says("law-does-not-fit")
def _(found: Finding) -> str:
    return (
        f"the law does not fit: the misfit of {found['misfit']:.1%} is systematic over amplitude and "
        "frequency, not noise; intervals are too narrow, try another law"
    )


@_says("background-possible")
def _(found: Finding) -> str:
    return (
        'a sensor may see more than the mode: try [identify] background = "phase", "constant" or '
        f'"residuals", and band = ["{found["low"]:.4g} Hz", "{found["high"]:.4g} Hz"], which is '
        f"{found['widths']:g} widths of the resonance to either side"
    )


@_says("harmonic-strong")
def _(found: Finding) -> str:
    return (
        f"harmonic {found['harmonic']:.0f} reaches {found['share']:.0%} of the fundamental (at "
        f"{quantity_text(*found.numbers['level'])}, {found['frequency']:.4g} Hz): first-order estimates are "
        "biased there"
    )


@_says("mean-of-symmetric-law")
def _(found: Finding) -> str:
    return (
        f"the mean displacement is {found['share']:.0%} of the amplitude, but the law is symmetric: an "
        "asymmetric part is missing or the sensor drifts"
    )


@_says("resonance-jumped")
def _(found: Finding) -> str:
    return (
        f"the response jumps across the resonance, or does not reach it, in {found['jumps']:.0f} of "
        f"{found['runs']:.0f} runs: there the paper's points are extrapolated from one side"
    )


@_says("resonance-sparse")
def _(found: Finding) -> str:
    return (
        f"{found['few']:.0f} of {found['runs']:.0f} runs have fewer than {found['points']:.0f} points within "
        "the width of the resonance: damping rests on little there"
    )


@_says("repeats-scatter")
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


@_says("misfit-is-scatter")
def _(found: Finding) -> str:
    return (
        f"the misfit of {found['misfit']:.2g} is no more than the scatter of the means: the law leaves "
        "nothing over"
    )


@_says("misfit-beyond-scatter")
def _(found: Finding) -> str:
    return (
        f"the misfit of {found['misfit']:.2g} is {found['times']:.2g} times the scatter of the means: model "
        "error beyond the noise. Standard errors are those of doing the test again with this law; were the "
        f"misfit noise, they would be {found['wider']:.2g} times wider"
    )


# --- ranking and prediction ---


@_says("curve-extrapolated")
def _(found: Finding) -> str:
    return (
        f"the curve of {quantity(found, 'level')} leaves the tested amplitudes ({quantity(found, 'low')} to "
        f"{quantity(found, 'high')}): nothing is known of the law there"
    )


@_says("no-steady-state")
def _(found: Finding) -> str:
    return f"no steady state in the tested frequencies under {quantity(found, 'level')}"


@_says("held-out-points-missing")
def _(found: Finding) -> str:
    return (
        f"{found['missing']:.0f} of {found['points']:.0f} points of the held-out level "
        f"{quantity(found, 'level')} (sweep {found.names['sweep']}) have no predicted steady state near the "
        "measured one"
    )
