"""The units that a force law demands: every term is a force, so the unit of each parameter follows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
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


@dataclass(frozen=True, slots=True)
class _Form:
    """The dimension of a part of a law: what is known of it, times unknown ones to rational powers."""

    known: Dimension = NUMBER
    unknown: Mapping[str, Fraction] = field(default_factory=dict)

    def __mul__(self, other: _Form) -> _Form:
        unknown = dict(self.unknown)
        for name, power in other.unknown.items():
            unknown[name] = unknown.get(name, Fraction(0)) + power
        return _Form(self.known * other.known, {name: power for name, power in unknown.items() if power})

    def __truediv__(self, other: _Form) -> _Form:
        return self * other ** Fraction(-1)

    def __pow__(self, exponent: Fraction) -> _Form:
        return _Form(self.known**exponent, {name: power * exponent for name, power in self.unknown.items()})

    @property
    def settled(self) -> bool:
        return not self.unknown


class _Equations:
    """Equations ``form = 1`` between dimensions, solved as they come in."""

    def __init__(self) -> None:
        self.solved: dict[str, _Form] = {}

    def reduced(self, form: _Form) -> _Form:
        """The form with every solved unknown replaced."""
        result = _Form(form.known)
        for name, power in form.unknown.items():
            result = result * (self.solved.get(name) or _Form(NUMBER, {name: Fraction(1)})) ** power
        return result

    def add(self, form: _Form) -> Dimension | None:
        """Take in ``form = 1``; what contradicts it is returned as the dimension that is left over."""
        rest = self.reduced(form)
        if rest.settled:
            return rest.known if rest.known != NUMBER else None
        name = min(rest.unknown, key=lambda other: (not other.startswith("("), other))
        power = rest.unknown[name]
        others = {other: value for other, value in rest.unknown.items() if other != name}
        value = _Form(rest.known, others) ** (-1 / power)
        for other, form_of in self.solved.items():
            if name in form_of.unknown:
                others = {key: exponent for key, exponent in form_of.unknown.items() if key != name}
                self.solved[other] = _Form(form_of.known, others) * value ** form_of.unknown[name]
        self.solved[name] = value
        return None


class _Law:
    """The equations that a force law demands, and the faults found on the way."""

    def __init__(self, known: Mapping[str, Dimension]) -> None:
        self.equations = _Equations()
        self.known = known
        self.faults: list[str] = []
        self.later: list[tuple[_Form, ...]] = []
        self.fresh = 0
        self.states: set[sympy.Symbol] = set()

    def unknown(self) -> _Form:
        self.fresh += 1
        return _Form(NUMBER, {f"({self.fresh})": Fraction(1)})

    def of_force(self, force: sympy.Expr) -> None:
        terms = sympy.Add.make_args(force)
        forms = [(term, self.form(term)) for term in terms]
        for term, form in forms:
            if form is not None and (form.unknown or self._declared(term)):
                self.equal(term, form, _Form(FORCE), "a force is needed")
        while self.later:  # what is most probably meant, where nothing speaks against it
            probable = self.later.pop(0)
            if all(not self.equations.reduced(form).settled for form in probable):
                for form in probable:
                    self.equations.add(form)

    def _declared(self, part: sympy.Expr) -> dict[str, Fraction]:
        return {s.name: Fraction(1) for s in part.free_symbols if s.name in self.known}

    def equal(self, part: sympy.Expr, form: _Form, wanted: _Form, need: str) -> None:
        left = self.equations.add(form / wanted)
        if left is None:
            return
        found = self.equations.reduced(form)
        sentence = f"{part} is in {found.known}, {need}" if found.settled else f"{part}: {need}"
        for name in sorted(symbol.name for symbol in part.free_symbols):
            power = self._power(part, name)
            has = self.equations.reduced(self.named(name))
            if power and name not in _STATES and has.settled:
                sentence += f": {name} must be in {has.known / left ** (1 / power)}"
                sentence += "" if name in self.known else f" here, elsewhere in {has.known}"
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

    def named(self, name: str) -> _Form:
        """The dimension of a state or parameter."""
        dimension = _STATES.get(name) or self.known.get(name)
        return _Form(NUMBER, {name: Fraction(1)}) if dimension is None else _Form(dimension)

    def form(self, part: sympy.Expr) -> _Form | None:
        """The dimension of a part, None for a number, which may stand for a value of any unit."""
        if part.is_number:
            return None
        if part.is_Symbol:
            return self.named(part.name)
        if part.is_Mul:
            result = _Form()
            number, rest = part.as_coeff_Mul()
            if _may_carry_unit(number, rest):
                result = self.unknown()
                # a plain one where nothing speaks against it
                self.later.append((result,))
            for factor in part.args:
                result = result * (self.form(factor) or _Form())
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
            return _Form()
        if isinstance(part, sympy.atan2):
            self._alike(part, part.args)
            return _Form()
        if isinstance(part, Masing):
            return self.form(part.args[0])
        if isinstance(part, Structural):
            return (self.form(part.args[0]) or _Form()) * _Form(_LENGTH)
        if isinstance(part, State):
            return self._state_form(part)
        for argument in part.args:
            self._plain(argument, f"a plain number is needed in {part.func.__name__}")
        return _Form()

    def _state_form(self, state: State) -> _Form:
        """The dimension of a state z: its equation gives z a second."""
        for z, rate in state.equations.items():
            form = self.form(rate)
            if form is not None and z not in self.states:
                self.states.add(z)
                self.equal(rate, form, self.named(str(z)) / _Form(_TIME), f"{z}' is needed")
        return self.named(state.name)

    def _plain(self, argument: sympy.Expr, need: str) -> None:
        form = self.form(argument)
        if form is not None and (form.unknown or self._declared(argument)):
            self.equal(argument, form, _Form(), need)

    def _power_form(self, part: sympy.Expr) -> _Form:
        base = self.form(part.base) or _Form()
        if part.exp.is_Rational:
            return base ** Fraction(int(part.exp.p), int(part.exp.q))
        self._plain(part.exp, "a plain number is needed as an exponent")
        if base.settled and base.known == NUMBER:
            return base
        result = self.unknown()
        if base.unknown:
            self.later.append((base, result))
        return result

    def _alike(self, whole: sympy.Basic, parts: Iterable[sympy.Expr]) -> _Form | None:
        """Parts that are added or compared have one dimension; a number among them may have any."""
        forms = [(part, self.form(part)) for part in parts]
        proper = [(part, form) for part, form in forms if form is not None]
        if not proper:
            return None
        telling = [(part, form) for part, form in proper if form.unknown or self._declared(part)]
        if not telling:  # only states and numbers: the numbers may carry units
            return proper[0][1]
        reference = next((form for part, form in proper if form.settled), telling[0][1])
        for part, form in telling:
            if form is not reference:
                terms = shorten(str(whole), width=80, placeholder=" ...")
                self.equal(part, form, reference, f"{reference.known} is needed in {terms}")
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
        units[name] = str(form.known) if form.settled else ""
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
