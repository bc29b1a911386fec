"""From a law to its describing function, with the proof of its formulas.

    k = 1/(pi X) integral n sin(phi) dphi,  c = 1/(pi omega X) integral n cos(phi) dphi,  integral n dphi = 0

The law is split into addends (``law.normal_form``). Each that has closed integrals gets formulas
(``closed``), the others are left to quadrature; terms with memory are added (``remembering``), the mean X0 is
solved for (``function``). Formulas are used only if they agree to 1e-10 with quadrature of the law as it is
written, on random cycles in every regime of its switches: an error of the algebra, of SymPy or of a rule in
``closed``, never reaches a result. Sources of the single rules stand where these are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np
import sympy

import rsgen.describing  # adds memories, to laws that have one
from rsgen.common.errors import require
from rsgen.common.tolerances import ROUND_OFF
from rsgen.describing.closed import ClosedPart, close
from rsgen.describing.function import DescribingFunction, closed_mean, integrals_of, taken_as_positive
from rsgen.describing.quadrature import MIN_PROOF_CYCLES, PROOF_TOLERANCE, Trial, draw_trial, worst_error
from rsgen.describing.regimes import Reading, read
from rsgen.formula.bounds import algebra_faults
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, X, renamed, symbol
from rsgen.law.element import Element, make_element
from rsgen.law.forms import expanded, moves
from rsgen.law.memory import memory_form
from rsgen.law.normal_form import NormalForm, normal_form
from rsgen.law.notation import readable


class HasForce(Protocol):
    """A law, an oscillator, or the model of an identification."""

    @property
    def force(self) -> sympy.Expr:
        """The force n(x, v) [N]."""


@algebra_faults()
def derive(law: str | Element | HasForce | sympy.Expr) -> DescribingFunction:
    """Derive the describing function of a force law, with its proof.

    Parameters
    ----------
    law
        The force [N] in x and v: text, an element, an expression, or what has a force: a law, an oscillator,
        the ``model`` of an identification. Parameters whose sign decides the form of the formulas (a gap, the
        slope of a saturation) are taken as positive, and ``positive`` says which.

    Raises
    ------
    ExpressionError
        The law is no formula, not real, not defined everywhere, or so singular that it has no fundamental.

    Examples
    --------
    >>> derive("k*x + k3*x**3").stiffness
    3*X**2*k3/4 + k
    >>> derive("Ff*sign(v)").damping
    4*Ff/(pi*X*omega)
    """
    if not isinstance(law, Element):
        law = getattr(law, "force", law)
    require(law, (str, Element, sympy.Expr), "law")
    element = law if isinstance(law, Element) else make_element("law", law)
    return _derive(element.force, element.parameters)


@algebra_faults()
def derive_off_centre(element: Element) -> DescribingFunction:
    """Derive an element that others of its law move off centre: about a mean X0 that is not its own."""
    if memory_form(element.force) is not None:
        return derive(element)
    found = _derive_memoryless(element.force, element.parameters, may_centre=False)
    own = set(_about_mean(_Law(element.force, ()), found.mean, found.mean_balance))
    together = ("X0 is the mean that all elements make together.",) if found.stiffness.has(X0) else ()
    return replace(found, mean=None, remarks=(*together, *(one for one in found.remarks if one not in own)))


@dataclass(frozen=True, slots=True)
class _Law:
    """A law with the symbols of its positive parameters known as positive."""

    force: sympy.Expr
    parameters: tuple[sympy.Symbol, ...]

    @property
    def form(self) -> NormalForm:
        """The normal form of the force."""
        return normal_form(self.force)


def _signed(force: sympy.Expr, names: tuple[str, ...], positive: frozenset[str]) -> _Law:
    symbols = tuple(sympy.Symbol(n, positive=True) if n in positive else symbol(n) for n in names)
    return _Law(force.xreplace(dict(zip(map(symbol, names), symbols, strict=True))), symbols)


def _decisive(force: sympy.Expr, form: NormalForm) -> frozenset[str]:
    """Return the parameters whose sign decides the form of the formulas."""
    found: set[sympy.Symbol] = set()
    expressions = [piece.term for piece in form.pieces]
    thresholds = [s.threshold for s in form.switches if s.threshold is not None]
    for expression in (*expressions, *thresholds):
        for atom in expression.atoms(sympy.Abs, sympy.sign, sympy.Max, sympy.Min, sympy.Pow):
            if atom.is_Pow and not atom.exp.is_Integer and atom.base is not sympy.E:
                found |= atom.exp.free_symbols
            if (not atom.is_Pow or not atom.exp.is_Integer) and not atom.free_symbols & {STATE_X, STATE_V}:
                found |= atom.free_symbols
    for level in thresholds:
        if level.free_symbols and sympy.expand_mul(-level) in thresholds:
            found |= level.free_symbols
    return frozenset(s.name for s in found - {STATE_X, STATE_V})


@dataclass(frozen=True, slots=True)
class _Closed:
    """The closed part that passed its proof, the remainder of the law, and the error in the proof."""

    part: ClosedPart | None
    readings: tuple[Reading, Reading, Reading]
    remainder: sympy.Expr
    checked_to: float | None
    remarks: tuple[str, ...]


def _by_quadrature(force: sympy.Expr, *remarks: str) -> _Closed:
    """Return a law without closed part."""
    return _Closed(None, (Reading(sympy.S.Zero, ()),) * 3, force, None, remarks)


MAX_SUM_OF_POWERS = 1000
"""Largest sum of the powers of x and v in a law with closed forms, which bounds the steps of its integration.
A polynomial of degree 40 has 861, the law of ten saturations 200."""


def _closed_forms(law: _Law, mean: sympy.Expr, trial: Trial) -> _Closed:
    """Find closed forms for the whole law, or else addend by addend, and prove them."""
    powers = sum(_powers(a) for piece in law.form.pieces for a in sympy.Add.make_args(piece.term))
    if powers > MAX_SUM_OF_POWERS:
        return _by_quadrature(
            law.force,
            "Closed forms are looked for where powers of x and v, added up, are "
            f"{MAX_SUM_OF_POWERS} at most; here they are {powers}.",
        )
    part = close(law.form, mean)
    if part is not None:
        return _proved(part, law, trial, sympy.S.Zero)
    addends = sympy.Add.make_args(expanded(law.force))
    closed = [a for a in addends if close(normal_form(a), mean) is not None]
    sum_of_closed = _Law(sympy.Add(*closed), law.parameters)
    part = close(sum_of_closed.form, mean) if closed else None
    if part is None:
        return _by_quadrature(law.force)
    remainder = sympy.factor_terms(sympy.Add(*(a for a in addends if a not in closed)))
    return _proved(
        part, sum_of_closed, draw_trial(sum_of_closed.force, law.parameters, mean == 0, 7), remainder
    )


def _powers(addend: sympy.Expr) -> int:
    """Count an addend, and the powers of what moves in it."""
    parts = (factor.as_base_exp() for factor in sympy.Mul.make_args(addend))
    return 1 + sum(abs(int(power)) for base, power in parts if power.is_Integer and moves(base))


def _proved(part: ClosedPart, law: _Law, trial: Trial, remainder: sympy.Expr) -> _Closed:
    if len(trial.cycle.X) < MIN_PROOF_CYCLES:
        return _by_quadrature(
            law.force + remainder,
            "The closed form could not be proved, since the law is hardly ever defined; quadrature instead.",
        )
    readings = (read(part, 0), read(part, 1), read(part, 2))
    cycle = trial.cycle
    place = cycle.X, cycle.mean, cycle.omega
    formulas = compiled(tuple(reading.formula for reading in readings), (X, X0, OMEGA, *law.parameters))
    shown = [np.broadcast_to(value, cycle.X.shape) for value in formulas(*place, *cycle.parameters)]
    closed = part.evaluate(*place, dict(zip(law.parameters, cycle.parameters, strict=True)))
    error = max(worst_error(trial, closed), worst_error(trial, shown))
    if not error <= PROOF_TOLERANCE:
        return _by_quadrature(
            law.force + remainder,
            f"The closed form differs from quadrature by {error:.1e}, more than {PROOF_TOLERANCE:g}; "
            "it is not used, quadrature takes its place.",
        )
    return _Closed(part, readings, remainder, error, ())


@lru_cache(maxsize=256)
def _derive(force: sympy.Expr, names: tuple[str, ...]) -> DescribingFunction:
    memory = memory_form(force)
    if memory is None:
        return _derive_memoryless(force, names, may_centre=True)
    parts = rsgen.describing.split_by_memory(memory)
    plain_names = tuple(name for name in names if parts.plain.has(symbol(name)))
    plain = _derive_memoryless(parts.plain, plain_names, may_centre=parts.centred)
    return rsgen.describing.add_memory(force, names, parts, plain)


@lru_cache(maxsize=256)
def _derive_memoryless(force: sympy.Expr, names: tuple[str, ...], may_centre: bool) -> DescribingFunction:
    """Derive a law without memory: closed addends, quadrature of the others, mean, and remarks.

    Random cycles say whether the law is centred, that is has no mean force about X0 = 0.
    """
    positive = _decisive(force, normal_form(force))
    law = _signed(force, names, positive)
    trial = draw_trial(law.force, law.parameters, True, 1)
    centred = may_centre and _is_centred(trial)
    if not len(trial.cycle.X):
        # a law that is finite on no cycle; ``close`` refuses a pole at rest
        close(law.form, sympy.S.Zero)
    mean = sympy.S.Zero if centred else X0
    if not centred:
        trial = draw_trial(law.force, law.parameters, False, 2)
    found = _closed_forms(law, mean, trial)
    stiffness, damping, balance = (reading.formula for reading in found.readings)
    checked_to, vanishes = found.checked_to, False
    if found.remainder != 0:
        integrals, largest = _integrals(found.remainder, law, mean)
        stiffness, damping, balance = stiffness + integrals[0], damping + integrals[1], balance + integrals[2]
        vanishes = largest is not None
        checked_to = checked_to if largest is None else max(largest, checked_to or 0.0)
    solved = sympy.S.Zero if centred else closed_mean(balance)
    plain = {s: symbol(s.name) for s in law.parameters}
    return DescribingFunction(
        force=force,
        parameters=names,
        stiffness=renamed(stiffness, plain),
        damping=renamed(damping, plain),
        mean_balance=sympy.S.Zero if centred else renamed(balance, plain),
        mean=None if solved is None else renamed(solved, plain),
        closed_form=not any(f.has(sympy.Integral) for f in (stiffness, damping, balance)),
        checked_to=checked_to,
        regimes=tuple(dict.fromkeys(renamed(c, plain) for r in found.readings[:2] for c in r.conditions)),
        remarks=(*_about_formulas(positive, found, trial, vanishes), *_about_mean(law, solved, balance)),
        positive=tuple(sorted(positive)),
        closed=found.part,
        remainder=renamed(found.remainder, plain),
    )


def _is_centred(trial: Trial) -> bool:
    """Decide whether the mean force is zero at zero mean, on all random cycles."""
    mean, size = trial.reference[2], trial.size[2]
    return bool(len(mean)) and bool(np.all(np.abs(mean) <= ROUND_OFF * np.maximum(size, 1e-300)))


def _integrals(
    remainder: sympy.Expr, law: _Law, mean: sympy.Expr
) -> tuple[tuple[sympy.Expr, sympy.Expr, sympy.Expr], float | None]:
    """Write the part without closed form as integrals over phi; those that vanish by symmetry as zero.

    Where all of them vanish, the second value is the largest of them on the random cycles, relative to the
    mean absolute force; otherwise None.
    """
    trial = draw_trial(remainder, law.parameters, mean == 0, 3)
    found, largest = [], 0.0
    for integral, value, size in zip(integrals_of(remainder, mean), trial.reference, trial.size, strict=True):
        share = float(np.max(np.abs(value) / np.maximum(size, 1e-300), initial=0.0))
        vanishes = len(value) >= MIN_PROOF_CYCLES and share <= ROUND_OFF
        found.append(sympy.S.Zero if vanishes else integral)
        largest = max(largest, share)
    return (found[0], found[1], found[2]), None if any(found) else largest


def _about_formulas(positive: frozenset[str], found: _Closed, trial: Trial, vanishes: bool) -> Iterable[str]:
    yield from found.remarks
    yield from taken_as_positive(sorted(positive))
    if not len(trial.cycle.X):
        yield (
            "The law was finite on none of the cycles tried (a pole that is passed, a logarithm or root of "
            "what is negative): expect no numbers."
        )
    if found.remainder != 0:
        rest = readable(found.remainder)
        if vanishes:
            yield f"By symmetry {rest} adds nothing."
        else:
            yield f"No closed form is used for {rest}; quadrature split at the switching angles."


def _about_mean(law: _Law, solved: sympy.Expr | None, balance: sympy.Expr) -> Iterable[str]:
    if solved is not None and solved == 0:
        if law.force.has(STATE_X):
            yield "The mean force vanishes at X0 = 0, so the motion is centred: X0 = 0."
        return
    if not balance.has(X0):
        yield "The mean force does not depend on X0: this law alone balances no mean; another spring must."
    elif solved is not None and any(not power.exp.is_Integer for power in solved.atoms(sympy.Pow)):
        yield (
            "Of the roots of the mean balance X0 is the one that a structure with rising force reaches "
            "from rest."
        )
    elif solved is None:
        yield (
            "The mean X0 solves the mean balance as a number, computed where it is needed. A formula about "
            "zero mean, such as (k6 + k7)/2 of a bilinear spring (Liu et al., Eq. (22)), leaves it out: "
            "docs/method.md, section 2; [printed] of a case compares it."
        )
