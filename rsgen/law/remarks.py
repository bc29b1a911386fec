"""What is odd about a law whatever its values: found from the formula alone, before any test."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.common.finding import Finding
from rsgen.formula import symbol, write
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.law.interchangeable import equal_terms
from rsgen.law.memory import memory_form

__all__ = ["law_remarks", "refuse_library_names"]

_TRIALS, _DECADES = 32, 1
"""Random positive values of all parameters, and decades to both sides of one that they span."""

_PLACES = np.geomspace(1e-4, 1e4, 49)
"""Displacements relative to parameters around one: far below and far above every corner."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)
"""Of the area below a virgin curve."""

_CLEAR = 0.02
"""Share of the largest area that a corner between two nodes does not make."""

_ALSO_FORCES = ("preload",)
"""Laws of the library whose name is that of a constant force as well."""

_ROUND_OFF = 1e-9
"""Negative force, relative to the largest, that is round-off."""


def law_remarks(force: sympy.Expr) -> tuple[Finding, ...]:
    """Find constant forces, loops that give energy, virgin curves that do not stay positive, equal terms.

    Examples
    --------
    >>> from rsgen.formula import parse
    >>> [finding.code for finding in law_remarks(parse("k*x + z"))]
    ['constant-force']
    >>> [finding.code for finding in law_remarks(parse("k*x + masing(kt*x**3)"))]
    ['loop-gives-energy']
    """
    return (
        *(Finding("constant-force", "warning", name) for name in _constant_forces(force)),
        *_curves(force),
        *(_order(group) for group in equal_terms(force)),
    )


def _order(group: tuple[tuple[str, ...], ...]) -> Finding:
    names = sorted(group)
    each = [names_of_one[0] for names_of_one in names]
    return Finding(
        "equal-terms",
        "info",
        names={
            "terms": " and ".join(f"({', '.join(names_of_one)})" for names_of_one in names),
            "order": " <= ".join(each),
        },
    )


def refuse_library_names(force: sympy.Expr) -> None:
    """Refuse a constant force that is the name of a law of the library: the law itself was meant.

    Raises
    ------
    ExpressionError
        A term of the law is such a name.
    """
    # the library is made of elements, which ask here
    from rsgen.law.library import laws

    for name in _constant_forces(force):
        called = name.replace("_", "-")
        if called not in laws or called in _ALSO_FORCES:
            continue
        law = laws[called]
        equations = "".join(f"; {z}' = {rate}" for z, rate in law.memory.items())
        raise ExpressionError(
            f"{name} is a law of the library and no force in a formula; write {law.formula[:80]}"
            f'{equations[:80]}, or say law = "{called}" in an element of a case, rsgen.laws["{called}"] in '
            "Python"
        )


def _constant_forces(force: sympy.Expr) -> tuple[str, ...]:
    """Give the names that stand alone as terms of a law, or times a number: no x or v moves them."""
    terms = (term.as_coeff_Mul()[1] for term in sympy.Add.make_args(force))
    states = {symbol("x"), symbol("v")}
    return tuple(sorted(term.name for term in terms if term.is_Symbol and term not in states))


def _curves(force: sympy.Expr) -> Iterator[Finding]:
    form = memory_form(force)
    for curve in () if form is None else form.curves:
        places, forces, energies = _tried(curve.virgin)
        names = {"curve": f"masing({write(curve.virgin)[:200]})"}
        size = 4 * places * np.abs(forces)
        clear = np.isfinite(energies) & (np.abs(energies) > _CLEAR * size)
        if clear.any() and np.all(energies[clear] < 0):
            yield Finding("loop-gives-energy", "warning", names=names)
        largest = np.fmax.accumulate(forces, axis=1)
        if np.any(forces < -_ROUND_OFF * largest):
            yield Finding("virgin-curve-negative", "warning", names=names)


@np.errstate(all="ignore")
def _tried(virgin: sympy.Expr) -> tuple[Array, Array, Array]:
    """Places (1, x), forces (t, x) and energies of a cycle (t, x), at values at which it begins positive.

    The energy of a cycle between -X and X is 8 times the area below the curve less 4 X n(X) (Masing's rule).
    """
    names = tuple(sorted(virgin.free_symbols - {symbol("x")}, key=str))
    law = compiled((virgin,), (symbol("x"), *names))
    generator = np.random.default_rng(0)
    values = 10.0 ** generator.uniform(-_DECADES, _DECADES, (len(names), _TRIALS, 1))
    places = _PLACES[None, :]
    forces = _at(law, places, values)
    area = np.zeros_like(forces)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        area += weight / 2 * places * _at(law, places * (node + 1) / 2, values)
    begins = forces[:, 0] > 0
    return places, forces[begins], (8 * area - 4 * places * forces)[begins]


def _at(law: Numeric, places: Array, values: Array) -> Array:
    (found,) = law(places, *values)
    return np.array(np.broadcast_to(found, (values.shape[1], places.shape[1])))
