"""Predictions with pinned numbers: curves and held-out levels."""

import numpy as np

import rsgen
from rsgen.identification.prediction import HeldOutLevel, ResonanceCurve
from tests.identification.test_across import ELEMENTS, GAUGE, seen_by, two_masses
from tests.pins import pinned, trees
from tests.pins.controls import simulated
from tests.pins.grids import NOISE, small
from tests.pins.pinned import SWITCHED, Pin, Tree
from tests.pins.trees import series
from tests.surfaces import LAWS, MASS, noisy

LEVELS = [2.0, 6.0]


def curve(one: ResonanceCurve) -> Tree:
    frequency = float(np.nanmax(one.frequency, initial=0.0))
    size = float(np.nanmax(one.amplitude, initial=0.0))
    return {
        "level": one.level, "unit": one.level_unit, "frequency": series(one.frequency),
        "amplitude": series(one.amplitude, entries=4), "phase": series(one.phase, entries=0),
        "stable": series(one.stable), "extrapolated": series(one.extrapolated),
        "lower": series(one.lower, size, 0), "upper": series(one.upper, size, 1),
        "folds": [
            {"frequency": series([f], frequency, 1), "amplitude": series([X], size, 1)}
            for f, X, _ in one.folds
        ],
    }  # fmt: skip


def held_out(one: HeldOutLevel) -> Tree:
    return {
        "sweep": one.sweep, "units": [one.level_unit, one.force_unit],
        **{name: getattr(one, name) for name in ("level", "force", "error", "largest_error", "missing")},
        "measured": series(one.measured, entries=1), "predicted": series(one.predicted),
    }  # fmt: skip


def tree(prediction: rsgen.Prediction) -> Tree:
    return {
        "curves": [curve(one) for one in (prediction.curves[0], prediction.curves[-1])]
        if len(prediction)
        else [],
        "held_out": [held_out(one) for one in prediction.held_out],
        "findings": trees.findings(prediction.findings),
    }


def of_oscillator(name: str, levels: list[float], band: tuple[float, float] | None = None) -> Tree:
    force, values = LAWS[name]
    return tree(rsgen.predict(rsgen.Oscillator(MASS, force, values), levels, band=band))


def of_identified(law: str, levels: list[float] | None = None) -> Tree:
    table = small(law, NOISE)
    found = rsgen.identify(table, LAWS[law][0], rsgen.Observation(hold_out=(6.0,)))
    return tree(rsgen.predict(found, levels, table))


def of_mode(mode: str, held: float, mass: float | None = None) -> Tree:
    table = noisy(simulated(mode), NOISE, 1)
    about = rsgen.Observation(hold_out=(held,))
    return tree(rsgen.predict(rsgen.identify(table, "k*x + k3*x**3 + c*v", about, mass=mass), surface=table))


def _modal() -> Tree:
    table = small("cubic", NOISE)
    found = rsgen.modal_table(table, rsgen.Observation(hold_out=(6.0,)))
    return tree(rsgen.predict(found, surface=table))


def _across() -> Tree:
    table = two_masses(noise=0.003)
    found = rsgen.identify(table, seen_by(GAUGE, *ELEMENTS), rsgen.Observation(hold_out=(3.0,)))
    return tree(rsgen.predict(found, surface=table))


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
    "identified/two-sensors": Pin(_across),
    "modal-table": Pin(_modal),
}

if __name__ == "__main__":
    pinned.renew(PINS, __file__, __doc__)
