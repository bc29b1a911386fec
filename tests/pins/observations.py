"""Identifications with pinned numbers for everything that may be declared or missing about a test."""

from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

import rsgen
from rsgen.data.oscillator import BACKGROUNDS, OFFSET
from rsgen.data.surface.response_surface import ResponseSurface
from tests import surfaces
from tests.fitting.test_repeats import repeated
from tests.identification.test_across import ELEMENTS, GAUGE, driven_by_a_sine, seen_by, two_masses
from tests.pins import trees
from tests.pins.grids import NOISE, small
from tests.pins.pinned import SMOOTH, SWITCHED, Allowed, Pin, Tree
from tests.surfaces import LAWS, MASS, changed, noisy
from tests.virtual import fundamentals

KINDS = (*BACKGROUNDS, *(f"{kind}{OFFSET}" for kind in BACKGROUNDS if kind != "none"))

PSI, CONSTANT, RESIDUAL, PICK_UP = 0.2, 1e-4 - 5e-5j, 0.3 + 0.2j, 2e-5 + 1e-5j
"""What the sensor sees beside the mode: an error of the phase [rad], b0 [m/N], b1, an offset [m]."""

NEIGHBOUR = (0.8, 0.8 * (2 * np.pi * 12.2) ** 2, 2.0)
"""Mass, stiffness and damping of a mode at 12.2 Hz, above the band."""
QUIET = 1e-3
"""Noise at which forty-five points tell two modes apart."""


@cache
def beside(kind: str, law: str = "cubic", noise: float = NOISE) -> ResponseSurface:
    table = small(law)
    main = kind.removesuffix(OFFSET)
    rank = BACKGROUNDS.index(main)
    omega, harmonics = table.omega, np.array(table.harmonics)
    if rank >= BACKGROUNDS.index("constant"):
        harmonics[:, 1] += CONSTANT * table.force
    if rank >= BACKGROUNDS.index("residuals"):
        harmonics[:, 1] += RESIDUAL / omega**2 * table.force
    if main == "neighbour":
        m, k, c = NEIGHBOUR
        harmonics[:, 1] += table.force / (k - m * omega**2 + 1j * c * omega)
    if kind.endswith(OFFSET):
        harmonics[:, 1] += PICK_UP
    force = table.force * np.exp(-1j * PSI) if rank else table.force
    return noisy(changed(table, harmonics=harmonics, force=force, force_harmonics=None), noise, 1)


def of(law: str, table: ResponseSurface, **declared: Any) -> Tree:
    return trees.fitted(table, LAWS[law][0], rsgen.Observation(**declared))


def of_kind(kind: str, law: str = "cubic", noise: float = NOISE) -> Tree:
    return of(law, beside(kind, law, noise), background=kind)


def whole(law: str, mass: float | None = None) -> Tree:
    """A law of ``tests.surfaces`` from one per cent of noise; of a smooth and a switched one all parts."""
    found = rsgen.identify(small(law, NOISE), LAWS[law][0], mass=mass)
    full = law in ("cubic", "coulomb") and mass is None
    return trees.whole_identification(found) if full else trees.identification(found)


def without_phase(law: str, kind: str = "none") -> Tree:
    return of(law, surfaces.without_phase(beside(kind, law)), background=kind)


def _unsettled() -> Tree:
    """A point that did not settle, one that was not measured, and one that lies far off."""
    table = small("cubic", NOISE)
    harmonics, outcome = np.array(table.harmonics), np.array(table.outcome)
    outcome[4] = 1
    harmonics[11, 1] = np.nan
    outcome[11] = 5
    harmonics[25] *= 1.5
    return of("cubic", changed(table, harmonics=harmonics, outcome=outcome))


def _across(table: ResponseSurface, *about: rsgen.Observation) -> Tree:
    return trees.fitted(table, seen_by(GAUGE, *ELEMENTS), *about)


FLAT = replace(SMOOTH, of_standard_error=1e-4, error=1e-3)
"""Where no point tells one parameter of a law from another, a test moved by 1e-15 moves what the paper's
method says of them by 3e-6 of its standard error."""


def _allowed(law: str) -> Allowed:
    if law == "tanh":
        return FLAT
    return SWITCHED if law in ("coulomb", "piecewise", "bilinear", "two-gaps") else SMOOTH


PINS = {
    **{
        f"background/{kind}": Pin(partial(of_kind, kind, noise=QUIET if "neighbour" in kind else NOISE))
        for kind in KINDS
    },
    "background/constant-exact": Pin(lambda: of_kind("constant", noise=0.0)),
    "background/phase-coulomb": Pin(lambda: of_kind("phase", "coulomb"), SWITCHED),
    "background/residuals-coulomb": Pin(lambda: of_kind("residuals", "coulomb"), SWITCHED),
    **{f"law/{law}": Pin(partial(whole, law), _allowed(law), slow=law == "two-gaps") for law in LAWS},
    "law/cubic-given-mass": Pin(lambda: whole("cubic", MASS)),
    "law/confounded": Pin(lambda: trees.fitted(small("cubic", NOISE), "ka*x + kb*x + kn*x**3 + c*v")),
    "amplitudes/cubic": Pin(lambda: without_phase("cubic")),
    "amplitudes/combined": Pin(lambda: without_phase("combined")),
    "amplitudes/constant": Pin(lambda: without_phase("cubic", "constant")),
    "amplitudes/constant+offset": Pin(lambda: without_phase("cubic", f"constant{OFFSET}")),
    "amplitudes/coulomb": Pin(lambda: without_phase("coulomb"), SWITCHED),
    "readings/repeats": Pin(lambda: of("cubic", repeated(small("cubic"), 3))),
    "readings/repeats-coulomb": Pin(lambda: of("coulomb", repeated(small("coulomb"), 3)), SWITCHED),
    "readings/unsettled": Pin(_unsettled),
    "readings/fundamental-only": Pin(
        lambda: of("cubic", fundamentals(small("cubic", NOISE), sweep="rest"))
    ),
    "readings/force-harmonics": Pin(lambda: of("cubic", surfaces.distorted(small("cubic", NOISE)))),
    "declared/hold-out": Pin(lambda: of("cubic", small("cubic", NOISE), hold_out=(6.0,))),
    "declared/band": Pin(lambda: of("cubic", small("cubic", NOISE), band=(9.0, 11.0))),
    "declared/uncalibrated": Pin(lambda: of("cubic", small("cubic", NOISE), calibrated=False)),
    "two-sensors/exact": Pin(lambda: _across(two_masses())),
    "two-sensors/noisy": Pin(lambda: _across(two_masses(noise=0.003))),
    "two-sensors/hold-out": Pin(lambda: _across(two_masses(noise=0.003), rsgen.Observation(hold_out=(3.0,)))),
    "two-sensors/driven-by-a-sine": Pin(lambda: _across(driven_by_a_sine())),
}  # fmt: skip
