"""Sentences about tests with a periodic multisine."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units.quantities import number_text, quantity_text
from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly, says

say_plainly(
    {
        "multisine-level-differs": (
            "{record}: the level is {level:.3q}, but the force has {rms:.3q} rms; in other records the ratio "
            "of both is another one"
        ),
        "multisine-levels-disagree": (
            "{record}: the level is said to be {level:.3q}, but the force has {rms:.3q} rms, {ratio:.2g} "
            "times as much, and in all records alike: a unit or a factor is wrong, or the level is no root "
            "mean square"
        ),
        "channels-delayed": (
            "the response comes {delay:.3q} later than the force (negative: earlier): with that delay taken "
            "off the misfit is {left:.2p} in place of {misfit:.2p}"
        ),
        "motion-by-law": (
            "below {below:.3q} noise hides the response, or would be most of the noise of the motion: there "
            "the motion along which the law is evaluated is the law's own"
        ),
        "record-feeds-exciter": (
            "the structure would feed energy into the exciter: force or response is reversed, or they are "
            "mixed up"
        ),
        "response-copies-force": (
            "{record}: the response is the force times a number at every line: one channel stands for both, "
            "or no resonance is near the lines"
        ),
        "one-period": (
            "one period of each record: noise and misfit cannot be separated, and the intervals take the "
            "misfit for noise; record several periods"
        ),
        "law-leaves-distortion": (
            "the law leaves {misfit:.2p} of the force, {times:.2g} times what the periods scatter: that "
            "part is not noise. The intervals come from leaving out each of {groups:.0f} parts of the lines "
            "in turn (jackknife) and are typically {wider:.2g} times wider than noise makes them"
        ),
        "damping-missing": (
            "the law has no damping, and what it leaves, {misfit:.2p} of the force, is more than noise"
        ),
        "misfit-beside-damping": (
            "the misfit is small beside the whole force, but {share:.2p} of the damping force: friction or "
            "other damping that the law lacks would look so, and is then counted in the damping coefficients "
            "that it has"
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
        "multisine-levels-disagree": (
            "Check unit and factor of the force, and the unit of test.level; a wrong force scales every "
            'parameter. Write unit = "label" under [test.level] where the levels are names.'
        ),
        "record-feeds-exciter": (
            "Give test.response.factor the other sign if the sensor was mounted the other way round; look "
            "whether the columns of force and response are swapped, and the quantity of the response."
        ),
        "multisine-two-periods": (
            "Record more periods, or start to record when the response has settled; transient = 0 under "
            "[test.multisine] says that it had."
        ),
        "channels-delayed": (
            "Check filters and sampling of both channels; name them under [test.channels] and give one this "
            "delay, or shift its samples."
        ),
        "response-copies-force": (
            "Check which channel is the response, and that the lines reach the resonance."
        ),
        "damping-missing": "Add a damper, c*v, and compare what is left.",
        "misfit-beside-damping": (
            "Try another law of damping beside the one you have, such as F*sign(v) or c2*v*abs(v), and take "
            "the one with the smaller misfit; the damping is not known better than this share."
        ),
        "record-not-predicted": _WITH_IT,
        "record-missed": _WITH_IT,
        "law-leaves-distortion": (
            "Look at the lines at which the misfit stands above the noise; try another law, or a band around "
            "one mode."
        ),
    }
)


@says("multisine-periods")
def _(found: Finding) -> str:
    lost = found["left_out"]
    left = f"up to {lost:.0f} at the beginning were left out" if lost else "none was left out"
    return (
        f"a period of {found['samples']:.0f} samples ({found.names['period']}), lines "
        f"{quantity_text(found['step'], 'Hz', 4)} apart; {found['periods']:.0f} settled periods of each "
        f"record are used, {left}"
    )


@says("multisine-two-periods")
def _(found: Finding) -> str:
    record = found.names["record"]
    if found.severity == "doubt":
        return (
            f"{record}: the two periods differ most where the record begins: the response had not settled, "
            "and the first period is no answer to a periodic force"
        )
    return (
        f"{record}: two periods: whether the response had settled before the first one cannot be seen; "
        "three and more show it"
    )


@says("identified-from-lines")
def _(found: Finding) -> str:
    records = f"{found['records']:.0f} {'record' if found['records'] == 1 else 'records'}"
    levels = f"{found['levels']:.0f} {'level' if found['levels'] == 1 else 'levels'}"
    return (
        f"{found['identified']:.0f} of {found['parameters']:.0f} parameters have a value from "
        f"{found['lines']:.0f} lines, {found['excited']:.0f} of them excited, "
        f"of {records} at {levels}; force and response differ from the law by "
        f"{number_text(100 * found['misfit'], 2)} % of the force"
    )
