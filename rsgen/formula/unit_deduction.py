"""The units that a force law demands: every term is a force, so the unit of each parameter follows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from textwrap import shorten

import sympy

from rsgen.common.errors import RsgenError
from rsgen.formula.names import Masing, State, Structural
from rsgen.formula.unit_text import FORCE, NUMBER, Dimension, read_unit

_LENGTH = Dimension({"m": Fraction(1)})
_TIME = Dimension({"s": Fraction(1)})
_MAX_PLAIN_NUMBER = 100
"""A ratio of whole numbers up to this before parameters is a plain number, as in series and means; before x
and v alone any number but one may be a stiffness or a damping."""

_STATES = {
    "x": _LENGTH, "v": _LENGTH / _TIME, "X": _LENGTH, "X0": _LENGTH, "omega": NUMBER / _TIME, "t": _TIME,
    "F": FORCE,
}  # fmt: skip


_UNKNOWN = "?"
"""Begins a base that is no unit: the dimension of a parameter, or of a number, that is looked for."""


def _unknown(name: str) -> Dimension:
    return Dimension({_UNKNOWN + name: Fraction(1)})


def _unknowns(form: Dimension) -> list[str]:
    """Return the unknown bases of a form: the dimension of a part of a law as far as it is known."""
    return [base for base in form.powers if base.startswith(_UNKNOWN)]


def _known(form: Dimension) -> Dimension:
    """Return a form without its unknown bases."""
    return Dimension({base: power for base, power in form.powers.items() if not base.startswith(_UNKNOWN)})


class _Equations:
    """Equations ``form = 1`` between dimensions, solved as they come in."""

    def __init__(self) -> None:
        self.solved: dict[str, Dimension] = {}

    def reduced(self, form: Dimension) -> Dimension:
        """The form with every solved unknown replaced."""
        result = form
        for base in self.solved.keys() & form.powers.keys():
            power = form.powers[base]
            result = result * (self.solved[base] / Dimension({base: Fraction(1)})) ** power
        return result

    def add(self, form: Dimension) -> Dimension | None:
        """Take in ``form = 1``; what contradicts it is returned as the dimension that is left over."""
        rest = self.reduced(form)
        if not _unknowns(rest):
            return rest if rest != NUMBER else None
        base = min(_unknowns(rest), key=lambda other: (not other.startswith(_UNKNOWN + "("), other))
        own = Dimension({base: Fraction(1)})
        self.solved[base] = own / rest ** (1 / rest.powers[base])
        for other in self.solved.keys() - {base}:
            self.solved[other] = self.reduced(self.solved[other])
        return None


class _Law:
    """The equations that a force law demands, and the faults found on the way."""

    def __init__(self, known: Mapping[str, Dimension]) -> None:
        self.equations = _Equations()
        self.known = known
        self.faults: list[str] = []
        self.later: list[tuple[Dimension, ...]] = []
        self.fresh = 0
        self.states: set[sympy.Symbol] = set()

    def unknown(self) -> Dimension:
        self.fresh += 1
        return _unknown(f"({self.fresh})")

    def of_force(self, force: sympy.Expr) -> None:
        terms = sympy.Add.make_args(force)
        forms = [(term, self.form(term)) for term in terms]
        for term, form in forms:
            if form is not None and (_unknowns(form) or self._declared(term)):
                self.equal(term, form, FORCE, "a force is needed")
        while self.later:  # what is most probably meant, where nothing speaks against it
            probable = self.later.pop(0)
            if all(_unknowns(self.equations.reduced(form)) for form in probable):
                for form in probable:
                    self.equations.add(form)

    def _declared(self, part: sympy.Expr) -> dict[str, Fraction]:
        return {s.name: Fraction(1) for s in part.free_symbols if s.name in self.known}

    def equal(self, part: sympy.Expr, form: Dimension, wanted: Dimension, need: str) -> None:
        left = self.equations.add(form / wanted)
        if left is None:
            return
        found = self.equations.reduced(form)
        sentence = f"{part}: {need}" if _unknowns(found) else f"{part} is in {found}, {need}"
        for name in sorted(symbol.name for symbol in part.free_symbols):
            power = self._power(part, name)
            has = self.equations.reduced(self.named(name))
            if power and name not in _STATES and not _unknowns(has):
                sentence += f": {name} must be in {has / left ** (1 / power)}"
                sentence += "" if name in self.known else f" here, elsewhere in {has}"
                break
        self.faults.append(sentence)

    @staticmethod
    def _power(part: sympy.Expr, name: str) -> Fraction | None:
        powers = [
            factor.as_base_exp()[1]
            for factor in sympy.Mul.make_args(part)
            if factor.as_base_exp()[0].is_Symbol and factor.as_base_exp()[0].name == name
        ]
        return Fraction(int(powers[0].p), int(powers[0].q)) if powers and powers[0].is_Rational else None

    def named(self, name: str) -> Dimension:
        """The dimension of a state or parameter."""
        return _STATES.get(name) or self.known.get(name) or _unknown(name)

    def form(self, part: sympy.Expr) -> Dimension | None:
        """The dimension of a part, None for a number, which may stand for a value of any unit."""
        if part.is_number:
            return None
        if part.is_Symbol:
            return self.named(part.name)
        if part.is_Mul:
            result = NUMBER
            number, rest = part.as_coeff_Mul()
            if _may_carry_unit(number, rest):
                result = self.unknown()
                # a plain one where nothing speaks against it
                self.later.append((result,))
            for factor in part.args:
                result = result * (self.form(factor) or NUMBER)
            return result
        if part.is_Pow:
            return self._power_form(part)
        if part.is_Add or isinstance(part, sympy.Min | sympy.Max):
            return self._alike(part, part.args)
        if isinstance(part, sympy.Abs):
            return self.form(part.args[0])
        if isinstance(part, sympy.Piecewise):
            for pair in part.args:
                for relation in pair.cond.atoms(sympy.core.relational.Relational):
                    self._alike(relation, relation.args)
            return self._alike(part, [pair.expr for pair in part.args])
        if isinstance(part, sympy.sign | sympy.Heaviside):
            self.form(part.args[0])
            return NUMBER
        if isinstance(part, sympy.atan2):
            self._alike(part, part.args)
            return NUMBER
        if isinstance(part, Masing):
            return self.form(part.args[0])
        if isinstance(part, Structural):
            return (self.form(part.args[0]) or NUMBER) * _LENGTH
        if isinstance(part, State):
            return self._state_form(part)
        for argument in part.args:
            self._plain(argument, f"a plain number is needed in {part.func.__name__}")
        return NUMBER

    def _state_form(self, state: State) -> Dimension:
        """The dimension of a state z: its equation gives z a second."""
        for z, rate in state.equations.items():
            form = self.form(rate)
            if form is not None and z not in self.states:
                self.states.add(z)
                self.equal(rate, form, self.named(str(z)) / _TIME, f"{z}' is needed")
        return self.named(state.name)

    def _plain(self, argument: sympy.Expr, need: str) -> None:
        form = self.form(argument)
        if form is not None and (_unknowns(form) or self._declared(argument)):
            self.equal(argument, form, NUMBER, need)

    def _power_form(self, part: sympy.Expr) -> Dimension:
        base = self.form(part.base) or NUMBER
        if part.exp.is_Rational:
            return base ** Fraction(int(part.exp.p), int(part.exp.q))
        self._plain(part.exp, "a plain number is needed as an exponent")
        if base == NUMBER:
            return base
        result = self.unknown()
        if _unknowns(base):
            self.later.append((base, result))
        return result

    def _alike(self, whole: sympy.Basic, parts: Iterable[sympy.Expr]) -> Dimension | None:
        """Parts that are added or compared have one dimension; a number among them may have any."""
        forms = [(part, self.form(part)) for part in parts]
        proper = [(part, form) for part, form in forms if form is not None]
        if not proper:
            return None
        telling = [(part, form) for part, form in proper if _unknowns(form) or self._declared(part)]
        if not telling:  # only states and numbers: the numbers may carry units
            return proper[0][1]
        reference = next((form for part, form in proper if not _unknowns(form)), telling[0][1])
        for part, form in telling:
            if form is not reference:
                terms = shorten(str(whole), width=80, placeholder=" ...")
                self.equal(part, form, reference, f"{_known(reference)} is needed in {terms}")
        if len(proper) < len(forms) and any(part != 0 for part, form in forms if form is None):
            self.later.append((reference,))
        return reference


def _may_carry_unit(factor: sympy.Expr, rest: sympy.Expr) -> bool:
    """Decide whether a number before a part may have a unit: in "1500*x", not in "a*x**3/3"."""
    if abs(factor) == 1:
        return False
    plain = max(abs(factor.p), factor.q) <= _MAX_PLAIN_NUMBER if factor.is_Rational else False
    return not plain or all(free.name in _STATES for free in rest.free_symbols)


def _solved(force: sympy.Expr, known: Mapping[str, str]) -> _Law:
    law = _Law({name: read_unit(unit).dimension for name, unit in known.items()})
    law.of_force(force)
    return law


def parameter_units(force: sympy.Expr) -> dict[str, str]:
    """Deduce the unit of every parameter of a force law.

    Parameters
    ----------
    force
        The law in x [m] and v [m/s]; every term must be a force [N].

    Returns
    -------
    dict[str, str]
        For each parameter, sorted by name, its SI unit as a person writes it ("N*s^2/m^2", "1" for a plain
        number); "" where the law does not determine it.

    Raises
    ------
    RsgenError
        Two places of the law demand different units of one parameter.

    Examples
    --------
    >>> from sympy import symbols, sign
    >>> x, v, k1, kn1, Ff = symbols("x v k1 kn1 Ff", real=True)
    >>> parameter_units(k1 * x + kn1 * x**3 + Ff * sign(v))
    {'Ff': 'N', 'k1': 'N/m', 'kn1': 'N/m^3'}
    """
    law = _solved(force, {})
    if law.faults:
        raise RsgenError("; ".join(law.faults))
    units = {}
    for name in sorted(symbol.name for symbol in force.free_symbols if symbol.name not in _STATES):
        form = law.equations.reduced(law.named(name))
        units[name] = "" if _unknowns(form) else str(form)
    return units


def unit_faults(force: sympy.Expr, units: Mapping[str, str]) -> tuple[str, ...]:
    """Check the declared units of parameters against a force law, term by term.

    Parameters
    ----------
    force
        The law in x [m] and v [m/s]; every term must be a force [N].
    units
        Declared units of some or all parameters.

    Returns
    -------
    tuple[str, ...]
        A sentence for every term that is not a force; empty where all are.

    Raises
    ------
    RsgenError
        A declared unit is no unit.

    Examples
    --------
    >>> from sympy import symbols
    >>> x, kn1 = symbols("x kn1", real=True)
    >>> unit_faults(kn1 * x**3, {"kn1": "N/m^2"})
    ('kn1*x**3 is in N*m, a force is needed: kn1 must be in N/m^3',)
    """
    return tuple(_solved(force, units).faults)
