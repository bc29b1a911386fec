"""Rankings with pinned numbers: order, misfits and verdicts of laws against one test."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import rsgen
from rsgen.data.oscillator import Model
from rsgen.formula.names import remembers
from rsgen.identification.ranking import Ranking
from rsgen.identification.ranking.balance import library_terms
from tests.conftest import FEW
from tests.identification.test_across import ELEMENTS
from tests.identification.test_across import two_masses as across
from tests.oracles.memory import two_masses
from tests.pins import pinned, trees
from tests.pins.grids import FREQUENCIES, LEVELS, NOISE, small, small_joint
from tests.pins.multisine import virtual
from tests.pins.pinned import SMOOTH, SWITCHED, Pin, Tree
from tests.surfaces import MASS, changed, noisy

FORMULAS = ("k*x + c*v", "k*x + k3*x**3 + c*v", "k*x + c*v + Ff*sign(v)")
UNFIT = replace(SMOOTH, value=1e-7)
"""Beside a law that does not fit, small terms are nearly free: a test moved by 1e-15 moves them by 4e-9."""

SHOWN = 4
"""Candidates whose numbers are pinned; of the others the order."""


@cache
def library(*names: str) -> list[rsgen.Law]:
    """Laws of the library, by name; all without memory where none is named."""
    terms = [t for t in library_terms() if (t.name in names if names else not remembers(t.source.force))]
    return [term.source for term in terms]


def tree(ranking: Ranking) -> Tree:
    """Order, numbers and verdict of a ranking."""
    names = ("parameters", "bic", "held_out_error", "tied", "own")
    return {
        "order": [each.name for each in ranking],
        "candidates": {
            each.name: {name: getattr(each, name) for name in names} | {"values": dict(each.values)}
            for each in ranking.candidates[:SHOWN]
        },
        "fits": ranking.fits,
        "noise": ranking.noise,
        "unexplained": ranking.unexplained,
        "parameters": list(ranking.model.parameters),
        "verdict": ranking.verdict.state,
        "findings": trees.findings(ranking.findings),
    }


def _cubic() -> Tree:
    return tree(rsgen.rank(small("cubic", NOISE), library(*FEW)))


def _own() -> Tree:
    # a model would compete with the whole library
    return tree(rsgen.rank(small("cubic", NOISE), ["k*x + kn*x**3 + c*v", *library("coulomb")]))


def _library() -> Tree:
    return tree(rsgen.rank(small("combined", NOISE), library()))


def _given_mass() -> Tree:
    return tree(rsgen.rank(small("quintic", NOISE), library(*FEW), mass=MASS))


def _held_out() -> Tree:
    seen = rsgen.Observation(hold_out=(6.0,))
    return tree(rsgen.rank(small("cubic", NOISE), list(FORMULAS), seen))


def _background() -> Tree:
    table = small("cubic", NOISE)
    # what the sensor sees of the other modes, 2 % of the largest response
    harmonics = np.array(table.harmonics)
    harmonics[:, 1] += (1e-4 - 5e-5j) * table.force
    seen = rsgen.Observation(background="constant")
    return tree(rsgen.rank(changed(table, harmonics=harmonics), list(FORMULAS), seen))


def _amplitudes_only() -> Tree:
    table = small("cubic", NOISE)
    alone = rsgen.ResponseSurface(
        table.level, table.frequency, np.abs(table.force), table.amplitude, phase_known=False
    )
    return tree(rsgen.rank(alone, list(FORMULAS)))


def _best() -> Tree:
    return trees.identification(rsgen.rank(small("cubic", NOISE), library(*FEW)).best)


def _friction() -> Tree:
    return tree(rsgen.rank(small("coulomb", NOISE), library(*FEW)))


def _gap() -> Tree:
    return tree(rsgen.rank(small("piecewise", NOISE), library("dead-zone", "cubic-spring", "coulomb")))


def _joint() -> Tree:
    laws = library("jenkins", "coulomb", "cubic-spring")
    return tree(rsgen.rank(small_joint("jenkins", NOISE), laws))


def _none_fits() -> Tree:
    table = two_masses(tuple(LEVELS), FREQUENCIES)
    return tree(rsgen.rank(noisy(table, 1e-3, 1), list(FORMULAS)))


def _per_mass() -> Tree:
    test = rsgen.SimulatedTest(
        np.array([0.2, 0.5, 1.0]), np.linspace(11, 25, 15), base="acceleration", accuracy=1e-9
    )
    values = {"k": 2e4, "k3": 5e9, "c": 4.0}
    table = rsgen.simulate(rsgen.Oscillator(2.0, "k*x + k3*x**3 + c*v", values), test)
    return tree(rsgen.rank(noisy(table, NOISE, 1), list(FORMULAS)))


def _held_amplitude() -> Tree:
    test = rsgen.SimulatedTest(np.array([2e-3, 6e-3, 1.2e-2]), FREQUENCIES, control="response", accuracy=1e-9)
    values = {"k": 5920.0, "k3": 2e6, "c": 3.8}
    table = rsgen.simulate(rsgen.Oscillator(MASS, "k*x + k3*x**3 + c*v", values), test)
    return tree(rsgen.rank(noisy(table, NOISE, 1), list(FORMULAS)))


def _multisine() -> Tree:
    return tree(rsgen.rank(virtual("cubic", NOISE), [*FORMULAS, *library("coulomb", "dead-zone", "dahl")]))


PINS = {
    "one-sensor/cubic": Pin(_cubic),
    "one-sensor/best-identified": Pin(_best),
    "one-sensor/formula-beside-library": Pin(_own),
    "one-sensor/library-without-loops": Pin(_library, slow=True),
    "one-sensor/given-mass": Pin(_given_mass),
    "one-sensor/held-out": Pin(_held_out),
    "one-sensor/background": Pin(_background),
    "one-sensor/amplitudes-only": Pin(_amplitudes_only),
    "one-sensor/coulomb": Pin(_friction, SWITCHED),
    "one-sensor/gap": Pin(_gap, SWITCHED),
    "one-sensor/jenkins": Pin(_joint, SWITCHED, slow=True),
    "one-sensor/none-fits": Pin(_none_fits),
    "driven-base": Pin(_per_mass),
    "held-amplitude": Pin(_held_amplitude),
    "multisine": Pin(_multisine),
    # laws are compared along one motion
    "two-sensors/laws": Pin(lambda: tree(rsgen.rank(across(), list(FORMULAS)))),
    "two-sensors/across": Pin(lambda: tree(rsgen.rank(across(), Model(ELEMENTS)))),
    "two-sensors/without-across": Pin(
        lambda: tree(rsgen.rank(changed(across(noise=0.01), across=None), list(FORMULAS))), UNFIT
    ),
}

for slow in (
    "one-sensor/coulomb",
    "one-sensor/none-fits",
):
    PINS[slow] = replace(PINS[slow], slow=True)

if __name__ == "__main__":
    pinned.renew(PINS, __file__, __doc__)
