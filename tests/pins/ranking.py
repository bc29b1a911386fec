"""Rankings with pinned numbers: order, misfits and verdicts of laws against one test."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import rsgen
from rsgen.formula.names import remembers
from rsgen.identification.ranking import Ranking
from rsgen.identification.ranking.library_sums import library_terms
from tests.conftest import FEW
from tests.identification.test_across import ELEMENTS
from tests.identification.test_across import two_masses as across
from tests.oracles.memory import two_masses
from tests.pins import trees
from tests.pins.grids import FREQUENCIES, LEVELS, NOISE, small, small_joint
from tests.pins.multisine import virtual
from tests.pins.pinned import SMOOTH, SWITCHED, Pin, Tree
from tests.surfaces import MASS, beside, changed, noisy, without_phase

FORMULAS = ["k*x + c*v", "k*x + k3*x**3 + c*v", "k*x + c*v + Ff*sign(v)"]
UNFIT = replace(SMOOTH, value=1e-6)
"""Beside a law that does not fit, small terms are nearly free: a test moved by 1e-15 moves them by 4e-9,
another processor by 1.1e-7."""

SHOWN = 4
"""Candidates whose numbers are pinned; of the others the order."""


@cache
def library(*names: str) -> list[rsgen.Law]:
    """Laws of the library, by name; all without memory where none is named."""
    terms = [t for t in library_terms() if (t.name in names if names else not remembers(t.source.force))]
    return [term.source for term in terms]


def tree(ranking: Ranking) -> Tree:
    names = "parameters bic held_out_error tied own"
    return {
        "order": [each.name for each in ranking],
        "candidates": {
            each.name: trees.parts(each, names) | {"values": dict(each.values)}
            for each in ranking.candidates[:SHOWN]
        },
        **trees.parts(ranking, "fits noise unexplained"),
        "parameters": list(ranking.model.parameters), "verdict": ranking.verdict.state,
        "findings": trees.findings(ranking.findings),
    }  # fmt: skip


def ranked(table: rsgen.ResponseSurface, laws: Any, *about: rsgen.Observation, mass: float | None = None):
    return tree(rsgen.rank(table, laws, *about, mass=mass))


def cubic() -> rsgen.ResponseSurface:
    return small("cubic", NOISE)


def _background() -> Tree:
    # what the sensor sees of the other modes, 2 % of the largest response
    seen = beside(cubic(), (1e-4 - 5e-5j) * cubic().force)
    return ranked(seen, FORMULAS, rsgen.Observation(background="constant"))


def _simulated(mass: float, k: float, k3: float, c: float, *grid: Any, **options: Any) -> Tree:
    truth = rsgen.Oscillator(mass, "k*x + k3*x**3 + c*v", {"k": k, "k3": k3, "c": c})
    table = rsgen.simulate(truth, rsgen.SimulatedTest(*grid, accuracy=1e-9, **options))
    return ranked(noisy(table, NOISE, 1), FORMULAS)


def _joints() -> Tree:
    ground, joint = ELEMENTS
    rivals = ("kj*x + cj*v", "kj*x + k5*x**5 + cj*v", "kj*x + cj*v + c3*v**3")
    laws = [[ground, rsgen.make_element("joint", law, across=joint.across)] for law in rivals]
    return ranked(across(noise=NOISE), [list(ELEMENTS), *laws])


PINS = {
    "one-sensor/cubic": Pin(lambda: ranked(cubic(), library(*FEW))),
    "one-sensor/best-identified": Pin(lambda: trees.identification(rsgen.rank(cubic(), library(*FEW)).best)),
    # a model would compete with the whole library
    "one-sensor/formula-beside-library": Pin(
        lambda: ranked(cubic(), ["k*x + kn*x**3 + c*v", *library("coulomb")])
    ),
    "one-sensor/library-without-loops": Pin(lambda: ranked(small("combined", NOISE), library()), slow=True),
    "one-sensor/given-mass": Pin(lambda: ranked(small("quintic", NOISE), library(*FEW), mass=MASS)),
    "one-sensor/held-out": Pin(lambda: ranked(cubic(), FORMULAS, rsgen.Observation(hold_out=(6.0,)))),
    "one-sensor/background": Pin(_background),
    "one-sensor/amplitudes-only": Pin(lambda: ranked(without_phase(cubic()), FORMULAS)),
    "one-sensor/coulomb": Pin(lambda: ranked(small("coulomb", NOISE), library(*FEW)), SWITCHED, slow=True),
    "one-sensor/gap": Pin(
        lambda: ranked(small("piecewise", NOISE), library("dead-zone", "cubic-spring", "coulomb")), SWITCHED
    ),
    "one-sensor/jenkins": Pin(
        lambda: ranked(small_joint("jenkins", NOISE), library("jenkins", "coulomb", "cubic-spring")),
        SWITCHED,
        slow=True,
    ),
    "one-sensor/none-fits": Pin(
        lambda: ranked(noisy(two_masses(tuple(LEVELS), FREQUENCIES), 1e-3, 1), FORMULAS), slow=True
    ),
    "driven-base": Pin(
        lambda: _simulated(2.0, 2e4, 5e9, 4.0, [0.2, 0.5, 1.0], np.linspace(11, 25, 15), base="acceleration")
    ),
    "held-amplitude": Pin(
        lambda: _simulated(MASS, 5920.0, 2e6, 3.8, [2e-3, 6e-3, 1.2e-2], FREQUENCIES, control="response")
    ),
    "multisine": Pin(
        lambda: ranked(virtual("cubic", NOISE), [*FORMULAS, *library("coulomb", "dead-zone", "dahl")])
    ),
    # no element follows the motion across
    "two-sensors/laws": Pin(lambda: ranked(across(), FORMULAS)),
    "two-sensors/across": Pin(_joints),
    "two-sensors/without-across": Pin(
        lambda: ranked(changed(across(noise=0.01), across=None), FORMULAS), UNFIT
    ),
}
