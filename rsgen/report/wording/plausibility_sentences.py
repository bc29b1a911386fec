"""Sentences about sizes that no vibration test has, and about responses that are another quantity."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units.scale import number_text, quantity_text
from rsgen.report.wording.sentences import NEXT_STEPS, says

_REASONS = {
    "frequency": (
        "only what is smaller than a grain of sand vibrates faster",
        "no test lasts as long as some such periods",
    ),
    "displacement": ("no rig moves a structure by more", "no sensor resolves less"),
    "velocity": ("the stress that goes with more breaks every solid", "no sensor resolves less"),
    "acceleration": ("no structure and no sensor endures more", "quiet ground moves as much"),
    "force": ("no shaker brings more", "the thermal motion of the air brings as much"),
    "mass": ("no structure that is tested weighs as much", "a sensor alone weighs more"),
    "stiffness": ("a cube of steel of a metre is softer", "the softest cantilever is stiffer"),
    "damping": ("with more there is no resonance to identify", "no material has less"),
}
"""Why nothing lies outside the bounds of ``rsgen.data.surface.plausibility``: above, and below."""

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

_MISTAKES = {
    "milli": "a response in mm, mm/s, mm/s^2 or mV that was read as m, m/s, m/s^2 or V",
    "micro": "a response in µm, µm/s or µV that was read as m, m/s or V",
    "nano": "a response in nm or nm/s that was read as m or m/s",
    "twice-milli": "a response in m, m/s, m/s^2 or V that was read as mm, mm/s, mm/s^2 or mV",
    "twice-micro": "a response in m, m/s or V that was read as µm, µm/s or µV",
    "inch": "a response in inches that was read as metres",
    "g": "an acceleration in g that was read as m/s^2",
    "acceleration-as-displacement": "an acceleration that was read as a displacement",
    "velocity-as-displacement": "a velocity read as a displacement (or an acceleration as a velocity)",
    "displacement-as-velocity": "a displacement read as a velocity (or a velocity as an acceleration)",
    "displacement-as-acceleration": "a displacement that was read as an acceleration",
    "kilonewton": "a force in kN that was read as N",
    "millinewton": "a force in mN or mV that was read as N or V",
    "micronewton": "a force in µN that was read as N",
    "pound": "a force in lbf that was read as N",
    "kilohertz": "a frequency in kHz that was read as Hz",
    "millihertz": "a frequency in mHz that was read as Hz",
    "rpm": "a speed in rpm that was read as Hz",
    "radian": "a frequency in rad/s that was read as Hz",
}
"""What the mistakes of ``rsgen.data.surface.plausibility`` are."""


def _size(found: Finding, name: str) -> str:
    value, unit = found.numbers[name]
    return quantity_text(value, unit, 3) if unit else f"{number_text(100 * value, 3)} %"


@says("levels-in-other-unit")
def _(found: Finding) -> str:
    level, force = _size(found, "level"), _size(found, "force")
    return (
        f"at the level of {level} the force is {force}, and in this proportion at all levels: one of them "
        "was read in another unit"
    )


NEXT_STEPS["levels-in-other-unit"] = (
    "Look up the unit of the force: one in kN that is read as N makes mass, stiffness and damping 1000 times "
    "too small. If the force is right, give the levels in its unit."
)


def _head(found: Finding) -> str:
    quantity, side = found.names["quantity"], found.names["side"]
    *others, last = found.names["others"].split(", ")
    outside = f"{', '.join(others)} and {last} are" if others else f"{last} is"
    more = f"; {outside} outside as well" if last else ""
    return f"{_WHAT[quantity]} is {_size(found, 'value')}, {side} {_size(found, 'bound')}{more}"


@says("size-unusual")
def _(found: Finding) -> str:
    return f"unusual for a vibration test: {_head(found)}"


@says("size-impossible")
def _(found: Finding) -> str:
    mistakes = [_MISTAKES[name] for name in found.names["mistake"].split(", ") if name]
    likely = f"; the sizes would be ordinary if this is {', or '.join(mistakes)}" if mistakes else ""
    reason = _REASONS[found.names["quantity"]][found.names["side"] != "above"]
    return f"not possible in a vibration test: {_head(found)} ({reason}){likely}"


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
def _(found: Finding) -> str:
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
"""What a factor between base and response comes from."""

_DERIVED = {
    -2: "integrated twice and",
    -1: "integrated once and",
    0: "",
    1: "differentiated once and",
    2: "differentiated twice and",
}
"""What makes another quantity of a motion."""


@says("base-scaled")
def _(found: Finding) -> str:
    then, misfit = (f"{number_text(100 * found[name], 2)} %" for name in ("then", "misfit"))
    by, back = number_text(found["by"], 4), number_text(1 / found["by"], 4)
    order = round(found["order"]) if "order" in found.numbers else 0
    undone = f"with the response {_DERIVED.get(order, '')} {by} times as large"
    other = "" if order else f", or the base {back} times"
    return (
        "as the case reads them, base and response are not those of a mass on springs and dampers: any law "
        f"leaves {misfit} of its force; {' '.join(undone.split())}{other}, {then}: "
        f"{_SCALED[found.names['is']]}"
    )


@says("base-misread")
def _(found: Finding) -> str:
    undone = _MISREAD[found.names["is"]].format(found.names["response"])
    then, misfit = (f"{number_text(100 * found[name], 2)} %" for name in ("then", "misfit"))
    return (
        "as the case reads them, base and response are not those of a mass on springs and dampers that take "
        f"energy: any law leaves {misfit}, or feeds energy; with {undone}, {then}"
    )


NEXT_STEPS |= {
    "base-scaled": (
        "Look up unit, factor and scale of both channels in the notes of the test, correct the case, and run "
        "it again."
    ),
    "base-misread": "Look the two channels up in the notes of the test, correct the case, and run it again.",
    "size-impossible": (
        "Look up the units of force, response and frequency in the notes of the test, correct them in the "
        "case, and run it again."
    ),
    "another-quantity": (
        "Look up what the sensor measured and in which unit its phase is, correct [test.response], and run "
        "the case again."
    ),
}
