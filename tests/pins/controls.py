"""Controlled tests with pinned numbers: what each mode records, and what follows from it."""

from functools import cache, partial
from typing import Any

import numpy as np

import rsgen
from rsgen.data.surface.response_surface import ResponseSurface
from tests.pins import trees
from tests.pins.grids import FINE, FREQUENCIES, LEVELS, NOISE, small
from tests.pins.pinned import ACCURACY, SWITCHED, Pin, Tree
from tests.pins.trees import series
from tests.samples import cubic_surface
from tests.surfaces import LAWS, MASS, noisy, without_phase

HELD = np.array([2e-3, 6e-3, 1.2e-2])
"""Amplitudes [m] of tests that hold them."""

LAW = "k*x + k3*x**3 + c*v"
VALUES = {"k": 5920.0, "k3": 6e5, "c": 3.8}
BASE_LEVELS = {"displacement": [1e-4, 3e-4], "velocity": [6e-3, 2e-2], "acceleration": [0.4, 1.2]}
LAGS = tuple(np.radians([60.0, 90.0, 120.0]))

MODES: dict[str, dict[str, Any]] = {
    "rest": {}, "up": {"sweep": "up"}, "down": {"sweep": "down"},
    "harmonic-balance": {"method": "harmonic-balance"},
    "harmonic-balance-up": {"method": "harmonic-balance", "sweep": "up"},
    "noise": {"noise_relative": NOISE, "seed": 5}, "response": {"control": "response", "level": HELD},
    "continuation": {"control": "continuation", "level": np.linspace(3e-3, 6e-2, 8)},
    "phase": {"control": "phase", "frequency": [8, 14], "level": np.linspace(1.0, 10.0, 6)},
    "phase-lags": {"control": "phase", "frequency": [8, 14], "lags": LAGS, "phase_error": 0.03},
    **{f"base-{base}": {"base": base, "level": level} for base, level in BASE_LEVELS.items()},
    "base-harmonic-balance": {"base": "velocity", "level": [6e-3, 2e-2], "method": "harmonic-balance"},
}  # fmt: skip
SWITCHED_TESTS = (
    "rest-coulomb", "rest-bilinear", "up-coulomb", "response-coulomb", "response-bilinear", "phase-coulomb",
    "harmonic-balance-coulomb",
)  # fmt: skip


@cache
def simulated(mode: str, law: str = "hardening") -> ResponseSurface:
    """A small virtual test of this mode, of a hardening spring or a law of ``tests.surfaces``."""
    force, values = (LAW, VALUES) if law == "hardening" else LAWS[law]
    accuracy = FINE if law == "hardening" else ACCURACY
    usual: dict[str, Any] = {"level": LEVELS, "frequency": FREQUENCIES, "harmonics": 5, "accuracy": accuracy}
    test = rsgen.SimulatedTest(**usual | MODES[mode])
    return rsgen.simulate(rsgen.Oscillator(MASS, force, values), test)


def recorded(mode: str, law: str = "hardening") -> Tree:
    return trees.surface(simulated(mode, law))


def identified(mode: str, mass: float | None = None, law: str = "hardening") -> Tree:
    force = LAW if law == "hardening" else LAWS[law][0]
    found = rsgen.identify(noisy(simulated(mode, law), NOISE, 1), force, mass=mass)
    levels = {"levels": series(found.levels, entries=1), "level_unit": found.curve.level_unit}
    return trees.identification(found) | levels


def tree_of_table(table: rsgen.ModalTable) -> Tree:
    shown = {name: series(getattr(table, name)) for name in table.shown}
    ends = {
        f"{name}_{end}": series(getattr(table, f"{name}_{end}"), entries=1)
        for name in table.shown
        for end in ("lower", "upper")
        # both ends are as far away
        if end == "upper" or name == "frequency"
    }
    return {
        **trees.parts(table, "known tested misfit points"), **shown, **ends,
        "amplitude": series(table.amplitude, entries=1), "levels": series(table.test.levels, entries=1),
        "mass": {"value": table.mass, "standard_error": table.mass_error},
        "background": trees.background(table.test.background), "findings": trees.findings(table.findings),
    }  # fmt: skip


def modal(table: ResponseSurface, mass: float | None = None, **declared: Any) -> Tree:
    found = rsgen.modal_table(noisy(table, NOISE, 1), rsgen.Observation(**declared), mass=mass)
    return tree_of_table(found)


PINS = {
    **{f"simulated/{mode}": Pin(partial(recorded, mode)) for mode in MODES},
    **{f"simulated/{one}": Pin(partial(recorded, *one.rsplit("-", 1)), SWITCHED) for one in SWITCHED_TESTS},
    **{
        f"identified/{mode}": Pin(partial(identified, mode))
        for mode in ("up", "down", "response", "continuation", "phase-lags")
    },
    **{
        f"identified/{mode}-coulomb": Pin(partial(identified, mode, law="coulomb"), SWITCHED)
        for mode in ("rest", "response")
    },
    **{f"identified/base-{base}": Pin(partial(identified, f"base-{base}")) for base in BASE_LEVELS},
    "identified/base-given-mass": Pin(lambda: identified("base-acceleration", MASS)),
    "identified/phase-given-mass": Pin(lambda: identified("phase", MASS)),
    "modal/forced": Pin(lambda: modal(small("cubic"))),
    "modal/first-order": Pin(lambda: tree_of_table(rsgen.modal_table(cubic_surface(4, 31)))),
    "modal/given-mass": Pin(lambda: modal(small("combined"), mass=MASS)),
    "modal/constant-background": Pin(lambda: modal(small("cubic"), background="constant")),
    "modal/residuals": Pin(lambda: modal(small("cubic"), background="residuals")),
    "modal/beyond": Pin(
        lambda: tree_of_table(rsgen.modal_table(noisy(small("cubic"), NOISE, 1)).at([1e-4, 5e-3, 0.1]))
    ),
    "modal/response": Pin(lambda: modal(simulated("response"))),
    "modal/continuation": Pin(lambda: modal(simulated("continuation"))),
    "modal/phase": Pin(lambda: modal(simulated("phase"))),
    "modal/phase-given-mass": Pin(lambda: modal(simulated("phase"), mass=MASS)),
    "modal/phase-lags": Pin(lambda: modal(simulated("phase-lags"))),
    # resonances without phases: amplitude and frequency a level
    "modal/lag-assumed": Pin(lambda: tree_of_table(rsgen.modal_table(without_phase(simulated("phase"))))),
    "modal/base": Pin(lambda: modal(simulated("base-acceleration"))),
    "modal/coulomb": Pin(lambda: modal(small("coulomb")), SWITCHED),
}
