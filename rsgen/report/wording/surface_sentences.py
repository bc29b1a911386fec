"""Sentences about tests that depend on more than what a finding has."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units import number_text, quantity_text
from rsgen.report.wording.sentences import says


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


def _head(found: Finding) -> str:
    quantity, side = found.names["quantity"], found.names["side"]
    *others, last = found.names["others"].split(", ")
    outside = f"{', '.join(others)} and {last} are" if others else f"{last} is"
    more = f"; {outside} outside as well" if last else ""
    return f"{_WHAT[quantity]} is {_size(found, 'value')}, {side} {_size(found, 'bound')}{more}"


@says("size-impossible")
def _size_impossible(found: Finding) -> str:
    return f"not possible in a vibration test: {_head(found)}"


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
