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

__all__ = ["law_faults"]

_NEAR = 1e-12
"""So near rest [m, m/s] every motion comes: a law must be a number there."""


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
    return [f"{case.path.name}: {fault}" for fault in faults]


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
