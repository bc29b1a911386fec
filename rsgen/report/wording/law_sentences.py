"""Sentences about what identified springs and dampers do."""

from __future__ import annotations

from collections.abc import Sequence

from rsgen.common.errors import listed
from rsgen.common.finding import Finding
from rsgen.common.tolerances import CONFIDENCE_TEXT
from rsgen.formula.units import number_text, quantity_text
from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly, says

say_plainly(
    {
        "constant-force": "{parameter} stands alone in the law: a constant force, which moves the mean only. "
        "If it is a state, its equation is missing (memory)",
        "parameter-not-variable": "{parameter} is a parameter here, a constant of the law: of the motion a "
        "law has x and v only",
        "equal-terms": "{terms} are equal terms of the law, and no test says which is which; they are named "
        "so that {order}",
    }
)


def _quantity(found: Finding, name: str, digits: int = 3) -> str:
    return quantity_text(*found.numbers[name], digits)


@says("element-course")
def _element_course(found: Finding) -> str:
    said, names = list[str](), found.names
    for kind in ("stiffness", "damping"):
        if f"{kind}_first" in found.numbers:
            ends = (f"{_quantity(found, f'{kind}_{end}')} at {_at(found, end)}" for end in ("first", "last"))
            said.append(f"{kind} {', '.join(ends)}")
    if "states" in names:
        said.append(f"the loop of {names['states']} does not close with the identified values")
    if "unknown" in names:
        said.append(f"not identifiable from this test: {names['unknown']}")
    return "; ".join(said) or "no force over the tested amplitudes"


def _at(found: Finding, end: str) -> str:
    return _quantity(found, f"amplitude_{end}", 2)


# ----------------------------------------------------------------------------
# Sentences about predictions.

say_plainly(
    {
        "prediction-extrapolated": (
            "the motion under {level:.3q} leaves the tested amplitudes, up to {high:.3q}: nothing is known "
            "of the law there"
        ),
        "no-steady-state": "the law has no steady state in the tested frequencies under {level:.3q}",
        "held-out-points-missing": (
            "{missing:.0f} of {points:.0f} points of the held-out level {level:.3q} (sweep {sweep}) have no "
            "predicted steady state near the measured one"
        ),
        "held-out-by-label": (
            "hold_out = {label:g} is the label of the level of {level:.3q}, which is held out; the level at "
            "which {label:g} was measured is not"
        ),
        "results-disagree": (
            f"{{values}}: results that are accepted or identified have {CONFIDENCE_TEXT} intervals without a "
            "common value; "
            "with the largest difference, {shift:.2g} standard errors, are {first} and {second}"
        ),
    }
)

NEXT_STEPS["results-disagree"] = (
    "Take the law or background that predicts a held-out level best; until then a value is known no better "
    "than the results differ."
)

NEXT_STEPS["held-out-missed"] = NEXT_STEPS["no-steady-state"] = (
    "Identify with this level, too, and see whether the law still fits; if it does not, try another law or "
    "fewer levels."
)


@says("held-out-missed")
def _held_out_missed(f: Finding) -> str:
    sweep = f" (sweep {f.names['sweep']})" if "sweep" in f.names else ""
    return (
        f"the held-out level {_quantity(f, 'level')}{sweep} is predicted with an error of {f['error']:.0%}, "
        f"against a misfit of {number_text(100 * f['misfit'], 2)} % where the law was fitted"
    )


# ----------------------------------------------------------------------------
# Sentences about rankings.


def _percent(share: float) -> str:
    return f"{share:.1%}" if share < 1 else "more than 100 %"


def _joined(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _between(low: float, high: float, unit: str) -> str:
    one, two = number_text(low, 4), number_text(high, 4)
    return f"near {one} {unit}" if one == two else f"between {one} and {two} {unit}"


say_plainly(
    {
        "mass-negative": (
            "the mass comes out negative ({mass:.3g} kg): is the sense of the phase right, and the sign of "
            "the sensor?"
        ),
        "structure-feeds-exciter": (
            "the structure would feed energy into the exciter: is the sense of the phase right, and the "
            "sign of the sensor?"
        ),
        "law-at-limit": (
            "{law}: the search for {parameter} ends at the limit of its range ({value:.3g}), so that the "
            "true law may be another"
        ),
        "terms-cancel": "{law} and {other} cancel each other: their sum is {share:.0%} of the larger",
    }
)

NEXT_STEPS |= {
    "mass-negative": (
        "Check the sense of the phase and the sign of the sensor; or give the mass in the case, where it "
        "is known."
    ),
    "no-law-fits": (
        "Choose a band around one mode, try a background, or add a candidate law with the shape that the "
        "restoring forces show."
    ),
    "law-at-limit": "Rank without {law}, or test at amplitudes where its {parameter} matters.",
    "damping-feeds-energy": (
        "Take the term out, or rank with the dampers that you expect alone, and check the background; if "
        "energy is fed by design, write the term with its sign, as in -c*v."
    ),
    "terms-cancel": "Rank without {law} or without {other}, and compare the misfits.",
    "phase-turned": (
        "Check the sign of the sensor, the sense of the phase and filters, then fit the background."
    ),
    "law-unconfirmed": (
        "Identify the law that you expect, and those near the top of the table, one by one, and take the "
        "one that leaves least."
    ),
    "levels-predicted-worse": (
        "Test more levels between those that there are, or take the law that predicts levels best."
    ),
}


def _counted(f: Finding) -> str:
    return f"{f['lines']:g} lines" if "lines" in f.numbers else f"{f['points']:g} points"


@says("ranking-few-points")
def _ranking_few_points(f: Finding) -> str:
    if "parameters" not in f.numbers:
        return "one level only: other levels would separate more laws"
    return f"{_counted(f)} are few for {f['parameters']:g} parameters: more would separate more laws"


@says("law-nearest")
def _law_nearest(f: Finding) -> str:
    if "noise" in f.names:
        lines = "one period is too little" if "lines" in f.numbers else ""
        reason = lines or "the frequencies are too widely spaced"
        return (
            f"{f.names['law']} comes nearest; {reason} to separate noise from misfit, so that it is not "
            "known whether it fits"
        )
    return f"{f.names['law']} comes nearest, with a noise of {f['noise']:.2g} at {_counted(f)}"


@says("no-law-fits")
def _no_law_fits(f: Finding) -> str:
    if "unexplained" not in f.numbers:
        return _place(f)
    compared = "neighbouring points" if _orders(f) else "periods"
    return (
        f"none of these fits: even the best, {f.names['law']}, leaves {_percent(f['unexplained'])} of force "
        f"and response unexplained (noise, judged by how much {compared} differ: "
        f"{_percent(f['noise'])}); all candidates assume one mode: a hysteresis "
        f"that is none of theirs, a second mode, a background or a drift would leave this; {_place(f)}"
    )


def _orders(f: Finding) -> list[str]:
    return [name for name in f.numbers if name.startswith("harmonic ")]


def _place(f: Finding) -> str:
    """Say in which harmonics, where in frequency and amplitude, no law explains the test."""
    named = {"harmonic 0": "mean", "harmonic 1": "fundamental"}
    parts = [f"{named.get(name, name)} ({_percent(f[name])})" for name in _orders(f)]
    text = f"it is unexplained in the {_joined(parts or ['response'])}"
    if "frequency from" in f.numbers:
        text += f", mostly {_between(f['frequency from'], f['frequency to'], 'Hz')}"
    if "amplitude from" in f.numbers:
        text += f", at amplitudes {_between(f['amplitude from'], f['amplitude to'], 'm')}"
    return text


@says("law-fits-best")
def _law_fits_best(f: Finding) -> str:
    small = f["noise"] <= f["least"]
    size = f"is less than {f['least']:g}" if small else f"looks like noise of {f['noise']:.2g}"
    return f"{f.names['law']} fits best: what it leaves unexplained at {_counted(f)} {size}"


@says("phase-turned")
def _phase_turned(found: Finding) -> str:
    doubted, filtered = found.severity == "doubt", found["loss"] < 1
    turned = f"with this law the phase of the force has to be turned by {_quantity(found, 'phase')}"
    wrong = ": that is a wrong sign or phase sense of a sensor, or a filter, not a background"
    loss = (
        f"; a filter of first order that turns it as much takes {found['loss']:.0%} of the amplitude, and "
        "moves k, c and m as much"
    )
    return f"{turned}{wrong if doubted else ''}{loss if filtered else ''}"


@says("laws-not-separated")
def _laws_not_separated(f: Finding) -> str:
    if "same" in f.names:
        return f"{f.names['law']} with a linear spring is the same law as {f.names['same']}"
    said = {
        "laws": "this test does not separate it from",
        "larger": "these contain it and fit no better",
    }
    return "; ".join(
        f"{text}: {listed(f.names[kind].split('; '))}" for kind, text in said.items() if kind in f.names
    )


@says("law-unconfirmed")
def _law_unconfirmed(f: Finding) -> str:
    return (
        f"{f.names['law']} does not follow the test by itself: fitted along its own motions it misses force "
        f"and response by {_percent(f['misfit'])}, in the ranking by {_percent(f['expected'])}"
    )


@says("levels-predicted-worse")
def _levels_predicted_worse(f: Finding) -> str:
    said = list[str]()
    if "fitted" in f.numbers:
        said.append(
            f"a level predicted from the others is off by {_percent(f['predicted'])}, but only by "
            f"{_percent(f['fitted'])} when it is fitted with them: some values rest on a single level, or "
            "the law is too flexible"
        )
    if "law" in f.names:
        said.append(f"{f.names['law']} predicts levels better: off by {_percent(f['other'])}")
    return "; ".join(said)
