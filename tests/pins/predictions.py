"""Predictions with pinned numbers: curves and held-out levels."""

from typing import Any

import numpy as np

import rsgen
from rsgen.identification.prediction import HeldOutLevel, ResonanceCurve
from tests.identification.test_across import ELEMENTS, GAUGE, seen_by, two_masses
from tests.pins import trees
from tests.pins.controls import LAW, simulated
from tests.pins.grids import NOISE, small
from tests.pins.pinned import SWITCHED, Pin, Tree
from tests.pins.trees import parts, series
from tests.surfaces import LAWS, MASS, noisy

LEVELS = [2.0, 6.0]


def curve(one: ResonanceCurve) -> Tree:
    frequency = float(np.nanmax(one.frequency, initial=0.0))
    size = float(np.nanmax(one.amplitude, initial=0.0))
    return {
        **parts(one, "level", "frequency stable extrapolated"), "unit": one.level_unit,
        "amplitude": series(one.amplitude, entries=4), "phase": series(one.phase, entries=0),
        "lower": series(one.lower, size, 0), "upper": series(one.upper, size, 1),
        "folds": [
            {"frequency": series([f], frequency, 1), "amplitude": series([X], size, 1)}
            for f, X, _ in one.folds
        ],
    }  # fmt: skip


def held_out(one: HeldOutLevel) -> Tree:
    return {
        **parts(one, "sweep level force error largest_error missing", "predicted"),
        "units": [one.level_unit, one.force_unit],
        "measured": series(one.measured, entries=1),
    }


def tree(prediction: rsgen.Prediction) -> Tree:
    return {
        "curves": [curve(prediction.curves[i]) for i in ((0, -1) if len(prediction) else ())],
        "held_out": [held_out(one) for one in prediction.held_out],
        "findings": trees.findings(prediction.findings),
    }


def of_oscillator(name: str, levels: list[float], band: tuple[float, float] | None = None) -> Tree:
    force, values = LAWS[name]
    return tree(rsgen.predict(rsgen.Oscillator(MASS, force, values), levels, band=band))


def of_test(
    table: rsgen.ResponseSurface, law: Any, held: float, mass: float | None = None, levels: Any = None
):
    found = rsgen.identify(table, law, rsgen.Observation(hold_out=(held,)), mass=mass)
    return tree(rsgen.predict(found, levels, table))


def of_identified(law: str, levels: list[float] | None = None) -> Tree:
    return of_test(small(law, NOISE), LAWS[law][0], 6.0, levels=levels)


def of_mode(mode: str, held: float, mass: float | None = None) -> Tree:
    return of_test(noisy(simulated(mode), NOISE, 1), LAW, held, mass)


def _modal() -> Tree:
    table = small("cubic", NOISE)
    return tree(rsgen.predict(rsgen.modal_table(table, rsgen.Observation(hold_out=(6.0,))), surface=table))


PINS = {
    "oscillator/cubic": Pin(lambda: of_oscillator("cubic", [0.5, 2.0])),
    "oscillator/quintic": Pin(lambda: of_oscillator("quintic", [2.0, 16.0])),
    "oscillator/combined-band": Pin(lambda: of_oscillator("combined", LEVELS, (9.0, 11.0))),
    "oscillator/coulomb": Pin(lambda: of_oscillator("coulomb", [0.9, 6.0])),
    "oscillator/bilinear": Pin(lambda: of_oscillator("bilinear", LEVELS)),
    "oscillator/two-gaps": Pin(lambda: of_oscillator("two-gaps", LEVELS)),
    "identified/cubic": Pin(lambda: of_identified("cubic")),
    "identified/beyond": Pin(lambda: of_identified("quintic", [1.0, 20.0])),
    "identified/coulomb": Pin(lambda: of_identified("coulomb"), SWITCHED),
    "identified/bilinear": Pin(lambda: of_identified("bilinear"), SWITCHED),
    "identified/up": Pin(lambda: of_mode("up", 6.0)),
    "identified/response": Pin(lambda: of_mode("response", 6e-3)),
    "identified/base": Pin(lambda: of_mode("base-acceleration", 0.4)),
    "identified/base-given-mass": Pin(lambda: of_mode("base-acceleration", 0.4, MASS)),
    "identified/two-sensors": Pin(lambda: of_test(two_masses(noise=0.003), seen_by(GAUGE, *ELEMENTS), 3.0)),
    "modal-table": Pin(_modal),
}
