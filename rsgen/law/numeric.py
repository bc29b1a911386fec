"""A force law as fast array functions: the force, its slopes, and what a test tells of its parameters.

Along motions of all sizes the force is a function of the parameters. Where its derivatives do not have full
rank, whatever the values of the parameters, no motion separates them: a null vector that is the same in the
logarithms of the parameters for all values belongs to products (only b*g can be identified), one that is the
same in the parameters themselves to sums.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import combinations, permutations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import sympy
from numpy.typing import NDArray

import rsgen.law  # compiles loops, for laws with memory
from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.formula.bounds import algebra_faults
from rsgen.formula.names import symbol
from rsgen.formula.unit_deduction import parameter_units
from rsgen.formula.unit_text import read_unit
from rsgen.law.character import Character, character, mirror_exchanges
from rsgen.law.forms import STATES
from rsgen.law.memory import from_rest, memory_form
from rsgen.law.motion import Motion
from rsgen.law.normal_form import ForceSample, SwitchedSum, switched_sum

if TYPE_CHECKING:
    from rsgen.law.loops import Loops

# ----------------------------------------------------------------------------
# Sizes that parameters of a law naturally have in a test, from their units.

DECADES = 2
"""To both sides of its natural size a parameter is searched: beyond, it acts nowhere or everywhere, as a loop
that closes or saturates within a hundredth of the motion, or not within hundred times the motion."""


def natural_sizes(law: ForceLaw, amplitude: float, omega: float, force: float) -> Array:
    """(p,) the number of SI units that amplitude [m], frequency [rad/s] and force [N] make of each parameter.

    One for plain numbers; NaN where the law does not determine the unit.
    """
    sizes = np.full(len(law.parameters), np.nan)
    try:
        units = parameter_units(law.expression)
    except RsgenError:
        # terms that do not agree in units can be fitted all the same
        return sizes
    # in kg, m and s a force is kg m/s^2
    base = {"kg": force / (amplitude * omega**2), "m": amplitude, "s": 1 / omega}
    for place, name in enumerate(law.parameters):
        powers = read_unit(units[name]).dimension.powers if units.get(name) else None
        if powers is not None and powers.keys() <= base.keys():
            sizes[place] = np.prod([base[unit] ** float(power) for unit, power in powers.items()])
    return sizes


Waves = tuple[Array, Array, Array]
"""Displacement [m], velocity [m/s] and acceleration [m/s^2], of one shape."""


class Part(NamedTuple):
    """Elements of a law that follow one motion.

    Parameters
    ----------
    law
        Of these elements.
    parameters
        (p,) where its parameters stand among those of the whole law.
    sensors
        Between which sensors that is, "" for the response.
    share
        How much of the response is in that motion: all in a difference of sensors, none in what has its own.
    """

    law: ForceLaw
    parameters: NDArray[np.intp]
    sensors: str = ""
    share: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class ForceLaw(Character):
    """A compiled law n(x, v; p), with memory or without, and its character."""

    expression: sympy.Expr
    """n(x, v; p) as it was compiled."""

    _sum: SwitchedSum
    """n(x, v; p); of a law with memory that without history: states zero, virgin curves."""

    _loops: Loops | None

    _parts: tuple[Part, ...] = ()
    """Parts that follow motions of their own; none where all follow one."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """The law by the motions that its elements follow: the response, then that across two sensors.

        Most have one part, which is all of it.
        """
        return self._parts or (Part(self, np.arange(len(self.parameters))),)

    @property
    def acts_across(self) -> bool:
        """True if some elements act on the motion between two sensors."""
        return len(self._parts) > 1

    def sample_parts(self, motions: Sequence[Waves], step: Array, values: Array) -> tuple[ForceSample, ...]:
        """Evaluate each part along its motion, and what every parameter of the law adds; see ``sample``."""
        if not self._parts:
            return (self.sample(*motions[0], step, values),)
        found = []
        for part, motion in zip(self.parts, motions, strict=True):
            sample = part.law.sample(*motion, step, values[part.parameters])
            none = np.zeros_like(sample.force)
            columns = dict(zip(part.parameters.tolist(), sample.by_parameter, strict=True))
            by = tuple(columns.get(place, none) for place in range(len(self.parameters)))
            found.append(ForceSample(sample.force, sample.by_x, sample.by_v, by, sample.by_memory))
        return tuple(found)

    def sample(self, x: Array, v: Array, a: Array, step: Array, values: Array) -> ForceSample:
        """Evaluate the law and all its derivatives along a motion.

        Parameters
        ----------
        x, v, a
            Displacement [m], velocity [m/s], acceleration [m/s^2], of one shape; for a law that
            ``remembers`` (n, s) over one whole period, without its end. Its force is the closed loop, NaN
            where the loop does not close.
        step
            Sampling interval [s], broadcast against x.
        values
            (p,) SI values of the parameters.
        """
        if self._loops is not None:
            return self._loops.sample(x, v, a, step, values)
        return _sample(self._sum((x, v), (v, a), step, values))

    def along(self, motion: Motion, values: Array, samples: int) -> ForceSample:
        """Evaluate the law and all its derivatives (n, samples) over one period of n motions."""
        return self.sample(*motion.waveforms(samples), motion.interval(samples), values)

    def still(self, x: Array, values: Array) -> ForceSample:
        """Evaluate the law at rest at places x [m]; a law with memory as in ``force``."""
        zero = np.zeros_like(x)
        return _sample(self._sum((x, zero), (zero, zero), zero, values))

    def force(self, x: Array, v: Array, values: Array) -> Array:
        """Evaluate n(x, v) [N] point by point; a step counts one half where its switch is zero.

        A law with memory is taken without history: its states are zero, Masing laws on their virgin curve.
        """
        zero = np.zeros_like(x)
        return self._sum((x, v), (zero, zero), zero, values)[0]

    def dry_friction(self, v: float, values: Array) -> float:
        """Return the force [N] up to which the law holds a mass at rest: half its jump from -v to v [m/s]."""
        forces = self.force(np.zeros(2), np.array([v, -v]), values)
        return float(forces[0] - forces[1]) / 2

    def with_far(self, far: Waves) -> ForceLaw:
        """Return a law across two sensors as one of the response, the other motion given; others as they are.

        ``far`` is the motion across less the share of the response in it, at the samples of ``sample``: minus
        that of the second sensor, or all of it where it has a sensor of its own.
        """
        if not self.acts_across:
            return self
        facts = {field.name: getattr(self, field.name) for field in fields(ForceLaw)}
        return _LawWithFar(**facts | {"_parts": ()}, whole=self, far=far)

    def at(self, fixed: Mapping[str, float]) -> ForceLaw:
        """Return the law of the other parameters: for equations along motions, with some values fixed."""
        numbers = np.array([fixed.get(name, np.nan) for name in self.parameters])
        free = np.flatnonzero(np.isnan(numbers)).tolist()
        if len(free) == len(numbers):
            return self

        def kept(indices: Sequence[int]) -> tuple[int, ...]:
            return tuple(free.index(i) for i in indices if i in free)

        facts = {field.name: getattr(self, field.name) for field in fields(ForceLaw)}
        facts["parameters"] = tuple(self.parameters[i] for i in free)
        facts["scaled"] = tuple(kept(group) for group in self.scaled if len(kept(group)) == len(group))
        facts |= {name: kept(facts[name]) for name in ("linear", "nonlinear", "positive", "even")}
        return _LawAt(**facts, whole=self, numbers=numbers)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _LawAt(ForceLaw):
    """A law some of whose parameters have ``numbers`` (p,), NaN for the others."""

    whole: ForceLaw
    numbers: Array

    def _all(self, values: Array) -> Array:
        """(p, ...) values of the whole law, from those of the parameters that are left."""
        every = np.empty((len(self.numbers), *np.shape(values)[1:]))
        every.T[:] = self.numbers
        every[np.isnan(self.numbers)] = values
        return every

    def _part(self, sample: ForceSample) -> ForceSample:
        columns = zip(sample.by_parameter, np.isnan(self.numbers), strict=True)
        return replace(sample, by_parameter=tuple(column for column, free in columns if free))

    def sample_parts(self, motions: Sequence[Waves], step: Array, values: Array) -> tuple[ForceSample, ...]:
        return tuple(map(self._part, self.whole.sample_parts(motions, step, self._all(values))))

    def sample(self, x: Array, v: Array, a: Array, step: Array, values: Array) -> ForceSample:
        return self._part(self.whole.sample(x, v, a, step, self._all(values)))

    def still(self, x: Array, values: Array) -> ForceSample:
        return self._part(self.whole.still(x, self._all(values)))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _LawWithFar(ForceLaw):
    """A law across two sensors along the response, with the motion ``far`` of the second one."""

    whole: ForceLaw
    far: Waves

    def sample(self, x: Array, v: Array, a: Array, step: Array, values: Array) -> ForceSample:
        share = self.whole.parts[1].share
        far, rate, second = self.far
        across = (share * x + far, share * v + rate, share * a + second)
        near, joint = self.whole.sample_parts([(x, v, a), across], step, values)
        return ForceSample(
            near.force + joint.force,
            near.by_x + share * joint.by_x,
            near.by_v + share * joint.by_v,
            tuple(one + other for one, other in zip(near.by_parameter, joint.by_parameter, strict=True)),
            (*near.by_memory, *((share * slope, change) for slope, change in joint.by_memory)),
        )


def _sample(sums: tuple[Array, ...]) -> ForceSample:
    return ForceSample(sums[0], sums[1], sums[2], sums[3:])


@lru_cache(maxsize=256)
@algebra_faults()
def compile_law(force: sympy.Expr) -> ForceLaw:
    """Compile a law for arrays, once; parameters are every symbol but x and v, sorted by name."""
    kind = character(force)
    memory = memory_form(force)
    facts: dict[str, Any] = {field.name: getattr(kind, field.name) for field in fields(Character)}
    return ForceLaw(
        **facts,
        expression=force,
        _sum=switched_sum(
            force if memory is None else from_rest(memory),
            (symbol("x"), symbol("v")),
            tuple(map(symbol, kind.parameters)),
        ),
        _loops=None if memory is None else rsgen.law.compile_loops(memory, kind.parameters),
    )


# ----------------------------------------------------------------------------
# Equal terms of a law, such as two sliders: no test says which is which, so their values have an order.

MAX_OWN_PARAMETERS = 4
"""Largest number of parameters that only one term has; all their permutations are tried."""

MAX_COMPARED_TERMS = 40

Group = tuple[tuple[str, ...], ...]


def equal_terms(force: sympy.Expr) -> tuple[Group, ...]:
    """Find terms of a sum that may change places: for each of them the names that it has for itself.

    Names of equal places in the terms are at equal places in the tuples.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> equal_terms(parse("k*x + masing(Min(ka*x, Fa)) + masing(Min(kb*x, Fb))"))
    ((('Fa', 'ka'), ('Fb', 'kb')),)
    >>> equal_terms(parse("k*x + c*v"))
    ()
    """
    terms = [term for term in sympy.Add.make_args(force) if len(term.free_symbols) > 1]
    groups: list[list[tuple[str, ...]]] = []
    if len(terms) > MAX_COMPARED_TERMS:
        return ()
    for one, other in combinations(terms, 2):
        paired = _paired(force, one, other)
        if paired is None:
            continue
        mine, theirs = paired
        # the first of equal terms meets all others first, and its order of names is that of all
        group = next((group for group in groups if any(set(mine) == set(names) for names in group)), None)
        if group is None:
            groups.append([mine, theirs])
        elif not any(set(theirs) == set(names) for names in group):
            group.append(theirs)
    return tuple(tuple(group) for group in groups)


def _paired(force: sympy.Expr, one: sympy.Expr, other: sympy.Expr) -> Group | None:
    """Names of two terms in an order in which they may change places; None where they may not."""
    mine, theirs = (
        sorted(first.free_symbols - second.free_symbols, key=str)
        for first, second in ((one, other), (other, one))
    )
    # displacement and velocity are not of the law: a spring and a damper have different places
    if (
        len(mine) != len(theirs)
        or not 0 < len(mine) <= MAX_OWN_PARAMETERS
        or not STATES.isdisjoint(mine + theirs)
    ):
        return None
    if len(mine) == 1 and one.coeff(mine[0]) * mine[0] == one:
        # only the sum of both acts
        return None
    for order in permutations(theirs):
        renames = dict(zip(mine, order, strict=True))
        if one.xreplace(renames) != other:
            continue
        exchange = {**renames, **{theirs: mine for mine, theirs in renames.items()}}
        if force.xreplace(exchange) == force:
            return tuple(str(name) for name in mine), tuple(str(name) for name in order)
    return None


def in_order(force: sympy.Expr, values: Mapping[str, float]) -> dict[str, float]:
    """Sort the values of equal terms by the order of their names: the first parameter of each grows.

    Parameters
    ----------
    force
        The law.
    values
        By name; terms with a name that has none stay as they are.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> law = parse("masing(Min(ka*x, Fa)) + masing(Min(kb*x, Fb))")
    >>> in_order(law, {"Fa": 9.0, "ka": 1.0, "Fb": 4.0, "kb": 2.0})
    {'Fa': 4.0, 'ka': 2.0, 'Fb': 9.0, 'kb': 1.0}
    """
    ordered = dict(values)
    for group in equal_terms(force):
        names = sorted(group)
        if all(name in values for term in names for name in term):
            rows = sorted(tuple(values[name] for name in term) for term in names)
            for term, row in zip(names, rows, strict=True):
                ordered.update(zip(term, row, strict=True))
    return ordered


def put_in_order(law: ForceLaw, values: Array, fixed: Collection[str] = ()) -> Array:
    """(p,) values of the parameters of a law, as ``in_order`` gives them; terms with fixed ones stay."""
    named = dict(zip(law.parameters, values, strict=True))
    ordered = in_order(law.expression, {name: named[name] for name in named if name not in fixed})
    return law.ordered({**named, **ordered})


def mirror_image(force: sympy.Expr, names: Collection[str]) -> dict[str, tuple[str, float]]:
    """Return the parameter, and its sign, whose value each one has in the mirror image -n(-x, -v) of a law.

    Even terms have the other sign; or those of two or four ``names`` are exchanged, as the gaps of stops on
    both sides. Empty where neither is so, and of a law that is its own mirror image.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> mirror_image(parse("k1*Max(x, 0) + k2*Min(x, 0)"), ("k1", "k2"))
    {'k1': ('k2', 1.0), 'k2': ('k1', 1.0)}
    """
    law = compile_law(force)
    if law.mirrored and not law.odd:
        return {law.parameters[i]: (law.parameters[i], -1.0) for i in law.even}
    if law.remembers or len(names) not in (2, 4) or not {*names} <= {*law.parameters}:
        return {}
    first, *others = sorted(names)
    for other in others:
        swapped = first, other, *(name for name in others if name != other)
        if mirror_exchanges(force, *map(symbol, swapped)):
            images = (*swapped[1::-1], *swapped[:1:-1])
            return {name: (image, 1.0) for name, image in zip(swapped, images, strict=True)}
    return {}
