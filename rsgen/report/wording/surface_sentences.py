"""Sentences about tests: surfaces, measured files, time histories, periodic multisines."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units import number_text, quantity_text
from rsgen.report.wording.sentences import says


def _at(found: Finding, name: str = "file") -> str:
    """Begin a sentence with the file or record that it is about, if any."""
    return f"{found.names[name]}: " if name in found.names else ""


@says("rows-left-out")
def _rows_left_out(found: Finding) -> str:
    if found.names["by"] == "words":
        return (
            f"{found.names['file']}: rows of words among the numbers, as a header that repeats, passed over: "
            f"{found['rows']:.0f}; the first is line {found['line']:.0f}"
        )
    counted = f"{_at(found)}{found['rows']:.0f} of {found['all']:.0f} rows"
    if found.names["by"] == "copies":
        return f"{counted} repeat another to the last digit: written twice, not measured twice, and left out"
    first = f"; the first is {found.names['first']}" if "first" in found.names else ""
    return f"{counted} left out, without a number where one is needed{first}"


@says("levels-disagree")
def _levels_disagree(found: Finding) -> str:
    if "record" in found.names:
        level, force = _size(found, "level"), _size(found, "force")
        return (
            f"{found.names['record']}: the level is {level}, but the force has {force} rms; in other records "
            "the ratio of both is another one"
        )
    labels, amounts = found.names["labels"], found.names["amounts"]
    if found.severity == "info":
        return (
            f"the levels {labels} are labels, not amounts of what was measured; in this order the levels are "
            f"{amounts}, measured near the resonance"
        )
    return (
        f"the levels are said to be {labels} {found.names['unit']}, but {amounts} were measured; the "
        "measured ones are used"
    )


@says("not-recorded")
def _not_recorded(found: Finding) -> str:
    if found.names["signal"] == "phase":
        return (
            "phase not recorded: only amplitudes were fitted; damping is taken as positive, k(X) and c(X) of "
            "single points rest on the phase that the law predicts, and an error of the law in phase alone "
            "does not show"
        )
    if found.names["signal"] == "base":
        return (
            "the motion of the base was not recorded and the nominal level stands for it, with phase 0; a "
            "table moves less near the resonance of what it carries, which then looks like damping"
        )
    if "by" in found.names:
        return (
            "the files hold response over force, so the level stands for the force; where the real force was "
            "smaller, so was the amplitude, and k(X) and c(X) are shifted in amplitude by as much"
        )
    return (
        "the force was not recorded and the nominal level stands for it; real forces fall at resonance, "
        "which then looks like damping and stiffness of the structure"
    )


@says("power-not-at-lines")
def _power_not_at_lines(found: Finding) -> str:
    if found.names["signal"] == "response":
        return (
            f"{found.names['record']}: only {found['share']:.0%} of the power of the response is at the "
            "lines of the force; the rest is noise, another source, or motion that is not periodic"
        )
    if "harmonics" in found.numbers:
        # of results with schema 1
        return (
            f"{found.names['record']}: harmonics of the force reach {found['harmonics']:.0%} of its "
            "fundamental; laws are fitted as if it were a sine"
        )
    return (
        f"{found.names['record']}: only {found['share']:.0%} of the power of the force is at its line and "
        "harmonics; the rest, noise or other lines, drives the structure, too"
    )


@says("decay-taken")
def _decay_taken(found: Finding) -> str:
    if "found" in found.numbers:
        return (
            f"{found.names['record']}: {found['found']:.0f} decays, one after each blow or drive, "
            f"{found['used']:.0f} of which are used; each is a level of its own"
        )
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


@says("decay-not-free")
def _decay_not_free(found: Finding) -> str:
    record = found.names["record"]
    if found.names["by"] == "rise":
        return (
            f"{record}: the amplitude rises again, more slowly than by a blow, from "
            f"{number_text(found['end'], 4)} s on: two modes beat, or something drives the structure"
        )
    return (
        f"{record}: the decay is taken from {number_text(found['begin'], 4)} s on, as the case says, but the "
        "structure is still driven then"
    )


@says("sweep-rate")
def _sweep_rate(found: Finding) -> str:
    if "pace" not in found.numbers:
        return (
            "the force was not corrected for the sweep rate: over this band the sweeps do not determine a "
            "moving mass, as they would with one mode in it; choose a band around one mode, or give the mass"
        )
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
def _not_passive(found: Finding) -> str:
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


# ----------------------------------------------------------------------------
# Sentences about sizes that no vibration test has, and about responses that are another quantity.

_WHAT = {
    "frequency": "the frequency of resonance",
    "displacement": "the largest displacement",
    "velocity": "the largest velocity",
    "acceleration": "the largest acceleration",
    "force": "the largest force",
    "mass": "the mass",
    "stiffness": "the stiffness",
    "damping": "the smallest damping ratio",
}


def _size(found: Finding, name: str) -> str:
    value, unit = found.numbers[name]
    return quantity_text(value, unit, 3) if unit else f"{number_text(100 * value, 3)} %"


@says("levels-in-other-unit")
def _levels_in_other_unit(found: Finding) -> str:
    level, force = _size(found, "level"), _size(found, "force")
    return (
        f"{_at(found, 'record')}at the level of {level} the force is {force}, and in this proportion at all "
        "levels: one of them was read in another unit, or the level is no amount of the force"
    )


def _head(found: Finding) -> str:
    quantity, side = found.names["quantity"], found.names["side"]
    *others, last = found.names["others"].split(", ")
    outside = f"{', '.join(others)} and {last} are" if others else f"{last} is"
    more = f"; {outside} outside as well" if last else ""
    return f"{_WHAT[quantity]} is {_size(found, 'value')}, {side} {_size(found, 'bound')}{more}"


@says("size-impossible")
def _size_impossible(found: Finding) -> str:
    return f"not possible in a vibration test: {_head(found)}"


_BEHAVES = {
    "displacement": "as a displacement",
    "velocity": "as a velocity",
    "acceleration": "as an acceleration",
    "+1": "as a derivative of the displacement, a velocity",
    "+2": "as a second derivative of the displacement, an acceleration",
    "-1": "as an integral of the displacement: it was integrated once too often",
    "-2": "as a twofold integral of the displacement: it was integrated twice too often",
    "radian": "as if its phase were in radians and was read in degrees",
}


@says("another-quantity")
def _another_quantity(found: Finding) -> str:
    read = f"was read as {found.names['read']} but " if found.names["read"] else ""
    or_sign = "" if found.names["sure"] == "yes" else ", or one channel has the other sign"
    then, misfit = (f"{number_text(100 * found[name], 2)} %" for name in ("then", "misfit"))
    return (
        f"the response {read}behaves {_BEHAVES[found.names['is']]}{or_sign}: so taken, any law leaves {then} "
        f"of the force unexplained; as it was read, {misfit}"
    )


_MISREAD = {
    "sense-response": "the phase of the response read in the other sense (phase_sense of [test.response])",
    "sense-base": "the phase of the base read in the other sense (phase_sense of [test.base])",
    "sense-both": "the phases of base and response read in the other sense (phase_sense of both)",
    "sign": "the response, or the base, with the other sign (factor = -1)",
    "swapped": "base and response exchanged: the columns are swapped",
    "reference": 'response = "{}" under [test.base]',
}
"""Mistakes in reading a driven base, as the case undoes them."""


_SCALED = {
    "gravity": "one of them may be in g and read in m/s^2, or the other way round",
    "milli": "one of them may be in thousandths of the unit that was read",
    "both": "one of them may be in g and read in mm/s^2, or the other way round",
    "rms": "one of them may be a root mean square and read as a peak value",
    "quantity": "one of them may be another quantity (displacement, velocity, acceleration) than was read",
    "peak-to-peak": "one of them may be from peak to peak and read as a peak value",
}
"""Causes of a factor between base and response."""

_DERIVED = {
    -2: "integrated twice and",
    -1: "integrated once and",
    0: "",
    1: "differentiated once and",
    2: "differentiated twice and",
}
"""Operations that turn a motion into another quantity."""


def _scaled(found: Finding) -> str:
    by, back = number_text(found["by"], 4), number_text(1 / found["by"], 4)
    order = round(found["order"]) if "order" in found.numbers else 0
    undone = f"with the response {_DERIVED.get(order, '')} {by} times as large"
    other = "" if order else f", or the base {back} times"
    return f"{' '.join(undone.split())}{other}, {{then}}: {_SCALED[found.names['is']]}"


@says("base-misread")
def _base_misread(found: Finding) -> str:
    then, misfit = (f"{number_text(100 * found[name], 2)} %" for name in ("then", "misfit"))
    undone = (
        _scaled(found)
        if "by" in found.numbers
        else f"with {_MISREAD[found.names['is']].format(found.names['response'])}, {{then}}"
    )
    return (
        "as the case reads them, base and response are not those of a mass on springs and dampers that take "
        f"energy: any law leaves {misfit} of the force, or feeds energy; {undone.format(then=then)}"
    )


# ----------------------------------------------------------------------------
# Tests with a periodic multisine.


@says("multisine-periods")
def _multisine_periods(found: Finding) -> str:
    if "samples" not in found.numbers:
        return _too_few_periods(found)
    lost = found["left_out"]
    left = f"up to {lost:.0f} at the beginning were left out" if lost else "none was left out"
    return (
        f"a period of {found['samples']:.0f} samples ({found.names['period']}), line spacing "
        f"{quantity_text(found['step'], 'Hz', 4)}; {found['periods']:.0f} settled periods of each "
        f"record are used, {left}"
    )


def _too_few_periods(found: Finding) -> str:
    if "record" not in found.names:
        return (
            "one period of each record: noise and misfit cannot be separated, and the intervals take the "
            "misfit for noise; record several periods"
        )
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


@says("damping-hidden-by-misfit")
def _misfit_beside_damping(found: Finding) -> str:
    if "share" not in found.numbers:
        left = number_text(100 * found["misfit"], 2)
        return f"the law has no damping, and what it leaves, {left} % of the force, is more than noise"
    return (
        f"the misfit is small compared with the total force, but {number_text(100 * found['share'], 2)} % of "
        "the damping force: friction or other damping that the law lacks would look so, and is then counted "
        "in the damping coefficients that it has"
    )
