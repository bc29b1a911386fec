"""Sentences about what identified springs and dampers do."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.formula.units.scale import number_text, quantity_text
from rsgen.report.wording.sentences import say_plainly, says

say_plainly(
    {
        "mean-moves": "the mean moves to {mean:.2q} at {amplitude:.2q}, {share:.2p} of the amplitude",
        "element-not-identifiable": "not identifiable from this test: {parameters}",
        "energy-measured": "as measured near the resonances, at {points:.6g} points, the energy of a "
        "cycle grows on average with the power {exponent:.3g} ± {half_width:.1g} of the amplitude",
        "energy-identified": "as identified it grows with the power {first:.3g} of the amplitude at "
        "{amplitude_first:.2q} and {last:.3g} at {amplitude_last:.2q} (1 is macro-slip, 2.2 to 3 "
        "micro-slip; 2 is viscous or structural damping, or the passage from micro-slip to macro-slip)",
        "loop-does-not-close": "the loop of {states} does not close with the identified values",
        "element-without-force": "no force over the tested amplitudes",
        "constant-force": "{parameter} stands alone in the law: a constant force, which moves the mean only. "
        "If it is a state, its equation is missing (memory)",
        "loop-gives-energy": "{curve} gives energy to every motion: of Masing laws only virgin curves that "
        "flatten dissipate",
        "equal-terms": "{terms} are equal terms of the law, and no test says which is which; they are named "
        "so that {order}",
        "virgin-curve-negative": "{curve} turns negative where x is large: its loop is that of a joint only "
        "as far as the virgin curve rises",
    }
)


@says("combinations-only")
def _(found: Finding) -> str:
    parameters, determined = found.names["parameters"], found.names["determined"]
    if not determined:
        return f"no test separates {parameters}: they act together in this law"
    return f"only {determined} can be identified, not {parameters} separately: the law depends on no more"


def _quantity(found: Finding, name: str, digits: int = 3) -> str:
    return quantity_text(*found.numbers[name], digits)


def _at(found: Finding, end: str) -> str:
    """Value and amplitude of a point of the course."""
    return f"{_quantity(found, f'value_{end}')} at {_quantity(found, f'amplitude_{end}', 2)}"


def _frequency(found: Finding) -> str:
    return f" (at {_quantity(found, 'frequency')})" if "frequency" in found.numbers else ""


def _verb(found: Finding, start: str = "first", end: str = "last") -> str:
    return "rises" if found[f"value_{end}"] > found[f"value_{start}"] else "falls"


def _direction(found: Finding, verb: str) -> str:
    if found.names["kind"] == "stiffness":
        return "hardening" if verb == "rises" else "softening"
    return "growing with amplitude" if verb == "rises" else "falling with amplitude"


def _head(found: Finding) -> str:
    """What it is in a word or two, and of what: "hardening, cubic: stiffness"."""
    shape, kind = found.names["shape"], found.names["kind"]
    words = [shape] if kind == "damping" and shape else [_direction(found, _verb(found)), shape]
    return f"{', '.join(filter(None, words))}: {kind}"


def _from_to(found: Finding) -> str:
    return f"from {_at(found, 'first')} to {_at(found, 'last')}"


@says("course-constant")
def _(found: Finding) -> str:
    linear = found.names["linear"] == "yes"
    word = "linear" if linear else "the same at every amplitude, though the law is not linear"
    low, high = (_quantity(found, f"amplitude_{end}", 2) for end in ("first", "last"))
    return (
        f"{word}: {found.names['kind']} stays at {_quantity(found, 'value', 4)} from {low} to {high}"
        f"{_frequency(found)}"
    )


@says("course-turns")
def _(found: Finding) -> str:
    shape, verbs = found.names["shape"], (_verb(found, "first", "turn"), _verb(found, "turn", "last"))
    words = f"first {_direction(found, verbs[0])}, then {_direction(found, verbs[1])}"
    return (
        f"{', '.join(filter(None, [words, shape]))}: {found.names['kind']} {verbs[0]} from "
        f"{_at(found, 'first')} to {_at(found, 'turn')} and {verbs[1]} to {_at(found, 'last')}"
        f"{_frequency(found)}"
    )


@says("course-not-resolved")
def _(found: Finding) -> str:
    return (
        f"no change with amplitude that this test resolves: {found.names['kind']} is {_at(found, 'first')} "
        f"and {_at(found, 'last')}, a difference of {_quantity(found, 'change', 2)} ± "
        f"{_quantity(found, 'half_width', 2)}{_frequency(found)}"
    )


@says("course-from-zero")
def _(found: Finding) -> str:
    return f"{_head(found)} comes up from zero to {_at(found, 'last')}{_frequency(found)}"


@says("course-changes-sign")
def _(found: Finding) -> str:
    return f"{_head(found)} {_verb(found)} {_from_to(found)}, and changes its sign{_frequency(found)}"


@says("course-negative")
def _(found: Finding) -> str:
    does = "drives the motion" if found.names["kind"] == "damping" else "pushes away from rest"
    return f"{_head(found)} {_verb(found)} {_from_to(found)}: negative, it {does}{_frequency(found)}"


@says("course-by-factor")
def _(found: Finding) -> str:
    factor = f"a factor of {found['factor']:.2g}"
    return f"{_head(found)} {_verb(found)} {_from_to(found)}, {factor}{_frequency(found)}"


@says("course-by-share")
def _(found: Finding) -> str:
    share = f"{number_text(100 * found['share'], 2)} %"
    return f"{_head(found)} {_verb(found)} by {share}, {_from_to(found)}{_frequency(found)}"


@says("slides-as-a-whole")
def _(found: Finding) -> str:
    below = "it sticks below" if found.names["below"] == "sticks" else "micro-slip below"
    beyond = "" if found.names["tested"] == "yes" else ", beyond the tested amplitudes"
    return (
        f"macro-slip from {_quantity(found, 'amplitude')} on{beyond}, at {_quantity(found, 'force')}; {below}"
    )


@says("swing-about-mean")
def _(found: Finding) -> str:
    swing = (
        f"at the largest response the displacement swings from {_quantity(found, 'low')} to "
        f"{_quantity(found, 'high')} about a mean of {_quantity(found, 'mean')}"
    )
    if "stiffness_ratio" not in found.numbers:
        return swing
    return (
        f"{swing}; the energy at the two turning points is the same when damping is light, so the stiffness "
        "on the positive side is about (negative peak / positive peak)² = "
        f"{found['stiffness_ratio']:.3g} times that on the negative side"
    )
