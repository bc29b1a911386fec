"""A law tried before a run: derived, written as a kernel, and evaluated next to rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from rsgen.case import Case
from rsgen.describing import derive
from rsgen.errors import RsgenError
from rsgen.expression import write
from rsgen.kernel import generate
from rsgen.law.element import Element
from rsgen.law.numeric import compile_law
from rsgen.oscillator import Oscillator
from rsgen.simulation import SimulatedTest

__all__ = ["law_faults"]

_NEAR = 1e-12
"""So near rest [m, m/s] every motion comes: a law must be a number there."""

_SIZES = np.geomspace(1e-12, 1e3, 61)
"""Amplitudes [m] from atoms to towers, four to a decade: gaps and corners act from some of them on."""

_SAMPLES = 256
"""Of a period: enough for the sign of a work or a stiffness."""

_ROUND_OFF = 1e-14
"""Work, relative to that of the largest forces on the way, that is only round-off of a sum of 256."""


def law_faults(case: Case) -> list[str]:
    """Say what would keep the laws of a case from being used; nothing where they can be.

    Reading a case checks texts and units, which is quick; this derives and compiles on trial, which takes
    a moment for each law that is new.

    Returns
    -------
    list of str
        One sentence a fault, ``file: element.N.force: what; what is allowed``.
    """
    faults = []
    for number, element in enumerate(case.model.elements, start=1):
        try:
            derive(element)
            generate(element.force)
        except RsgenError as fault:
            faults.append(f"element.{number}.force: {' '.join(str(fault).split())}")
            continue
        if case.oscillator is not None:
            faults += [
                f"element.{number}.force: {text}" for text in _near_rest(element, case.oscillator.values)
            ]
    if not faults and case.oscillator is not None and isinstance(case.test, SimulatedTest):
        faults += [f"element: {text}" for text in _never_settles(case.oscillator, case.test)]
    return [f"{case.path.name}: {fault}" for fault in faults]


def _never_settles(oscillator: Oscillator, test: SimulatedTest) -> list[str]:
    """Say why no point of a virtual test can settle; only what is certain without simulating it."""
    if test.method != "time" or test.control != "force":
        return []
    law = compile_law(oscillator.force)
    values = np.array([oscillator.values[name] for name in law.parameters])
    largest = float(test.level.max())
    held = law.force(np.zeros(2), np.array([_NEAR, -_NEAR]), values)
    if held[0] >= largest and held[1] <= -largest:
        return [
            f"dry friction of {min(held[0], -held[1]):.4g} N holds the mass at every level; a level above it "
            "is needed"
        ]
    size, omega = np.meshgrid(_SIZES, 2 * np.pi * test.frequency[[0, -1]], indexing="ij")
    size, omega = size.reshape(-1, 1), omega.reshape(-1, 1)
    phase = 2 * np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    x, v = size * np.cos(phase), -size * omega * np.sin(phase)
    force = law.force(x, v, values)
    # no number, where the law overflows, is no evidence
    with np.errstate(over="ignore", invalid="ignore"):
        work, push = np.sum(force * v, axis=1), np.sum(force * x, axis=1)
        round_off = _ROUND_OFF * np.sum(np.abs(force * v), axis=1)
    if np.all(work <= round_off):
        return [
            "no damping: the law takes no energy out of a motion of any amplitude, so that none settles; a "
            "damper whose force has the sign of v is needed"
        ]
    if np.all(push < 0):
        return [
            "negative stiffness: the law pushes the mass away at every amplitude, so that no motion settles; "
            "a spring whose force has the sign of x, at small or at large amplitudes, is needed"
        ]
    return []


def _near_rest(element: Element, values: Mapping[str, float]) -> list[str]:
    law = compile_law(element.force)
    places = np.array([(0.0, 0.0), *product((_NEAR, -_NEAR), repeat=2)])
    forces = law.force(places[:, 0], places[:, 1], np.array([values[name] for name in law.parameters]))
    # 0*log(0) is no number and yet goes to one
    wrong = np.flatnonzero(np.isinf(forces) | (np.isnan(forces) & (places != 0).any(axis=1)))
    if not len(wrong):
        return []
    x, v = places[wrong[0]]
    where = "at rest" if x == v == 0 else f"at x = {x:g} m, v = {v:g} m/s, next to rest"
    what = "infinite" if np.isinf(forces[wrong[0]]) else "not a number"
    return [
        f"{write(element.force)[:200]} is {what} {where}; a force must be finite for both signs of x and v"
    ]
