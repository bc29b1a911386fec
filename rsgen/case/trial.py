"""A law tried before a run: derived, written as a kernel, and evaluated next to rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
import sympy

from rsgen.case import Case
from rsgen.describing import derive
from rsgen.errors import RsgenError
from rsgen.expression import symbol, write
from rsgen.kernel import generate
from rsgen.law.element import Element

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
    known = {symbol(name): values[name] for name in element.parameters}
    force = sympy.lambdify([symbol("x"), symbol("v")], element.force.subs(known), "numpy", dummify=True)
    for x, v in ((0.0, 0.0), *product((_NEAR, -_NEAR), repeat=2)):
        with np.errstate(all="ignore"):
            value = complex(force(np.float64(x), np.float64(v)))
        rest = x == v == 0.0
        # 0*log(0) is no number and yet goes to one
        if (rest and np.isinf(value.real)) or (not rest and not np.isfinite(value.real)):
            where = "at rest" if rest else f"at x = {x:g} m, v = {v:g} m/s, next to rest"
            law = write(element.force)[:200]
            return [
                f"{law} is {'infinite' if np.isinf(value.real) else 'not a number'} {where}; "
                "a force must be finite for both signs of x and v"
            ]
    return []
