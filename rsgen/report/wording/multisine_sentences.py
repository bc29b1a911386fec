"""Sentences about tests with a periodic multisine."""

from __future__ import annotations

from rsgen.finding import Finding
from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly, says
from rsgen.units.scale import number_text

say_plainly(
    {
        "multisine-periods": (
            "a period of {samples:.0f} samples ({period}), lines {step:.4q} apart; {periods:.0f} settled "
            "periods of each record are used, up to {left_out:.0f} at the beginning were left out"
        ),
        "multisine-level-differs": (
            "{record}: the level is {level:.3q}, but the force has {rms:.3q} rms; in other records the ratio "
            "of both is another one"
        ),
        "channels-delayed": (
            "the response comes {delay:.3q} later than the force (negative: earlier): with that delay taken "
            "off the misfit is {left:.2p} in place of {misfit:.2p}"
        ),
        "response-copies-force": (
            "{record}: the response is the force times a number at every line: one channel stands for both, "
            "or no resonance is near the lines"
        ),
        "one-period": (
            "one period of each record: noise and misfit cannot be told apart, and the intervals take the "
            "misfit for noise; record several periods"
        ),
        "law-leaves-distortion": (
            "the law leaves {misfit:.2p} of the force, {times:.2g} times what the periods scatter: that "
            "part is not noise. The intervals come from leaving out each of {groups:.0f} parts of the lines "
            "in turn (jackknife) and are typically {wider:.2g} times wider than noise makes them"
        ),
        "record-not-predicted": (
            "no periodic response of the identified law was found under the force of the held-out level "
            "{level:.3q}"
        ),
        "record-extrapolated": (
            "the held-out level {level:.3q} moves by {amplitude:.3q} (sqrt(2) rms), beyond the {tested:.3q} "
            "of the levels that were fitted: nothing is known of the law there"
        ),
        "record-missed": (
            "the held-out level {level:.3q} is predicted with an error of {error:.2p} rms, against a misfit "
            "of {misfit:.2p} where the law was fitted"
        ),
        "line-not-distinct-from-zero": (
            "{parameter}: {value:.2g} with standard error {standard_error:.2g} cannot be distinguished from "
            "zero; raise the level, or record more periods"
        ),
    }
)

_WITH_IT = (
    "Identify with this level, too, and see whether the law still fits; if it does not, try another law or "
    "fewer levels."
)

NEXT_STEPS.update(
    {
        "multisine-level-differs": (
            "Check that test.level.values stand in the order of test.file, and are root mean squares."
        ),
        "channels-delayed": (
            "Check filters and sampling of both channels; name them under [test.channels] and give one this "
            "delay, or shift its samples."
        ),
        "response-copies-force": (
            "Check which channel is the response, and that the lines reach the resonance."
        ),
        "record-not-predicted": _WITH_IT,
        "record-missed": _WITH_IT,
        "law-leaves-distortion": (
            "Look at the lines at which the misfit stands above the noise; try another law, or a band around "
            "one mode."
        ),
    }
)


@says("identified-from-lines")
def _(found: Finding) -> str:
    records = f"{found['records']:.0f} {'record' if found['records'] == 1 else 'records'}"
    levels = f"{found['levels']:.0f} {'level' if found['levels'] == 1 else 'levels'}"
    return (
        f"{found['identified']:.0f} of {found['parameters']:.0f} parameters have a value from "
        f"{found['lines']:.0f} lines of {records} at {levels}; force and response differ from the law by "
        f"{number_text(100 * found['misfit'], 2)} % of the force"
    )
