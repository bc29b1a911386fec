"""A force law as fast array functions: the force, its slopes, and what a test tells of its parameters.

Along motions of all sizes the force is a function of the parameters. Where its derivatives do not have full
rank, whatever the values of the parameters, no motion separates them: a null vector that is the same in the
logarithms of the parameters for all values belongs to products (only b*g can be identified), one that is the
same in the parameters themselves to sums.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import lru_cache
from itertools import combinations, permutations
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import sympy
from numpy.typing import NDArray

import rsgen.law  # compiles loops, for laws with memory
from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.common.solvers import NULL_TOLERANCE
from rsgen.common.tolerances import samples_for
from rsgen.formula import symbol
from rsgen.formula.bounds import algebra_faults
from rsgen.formula.unit_deduction import parameter_units
from rsgen.formula.unit_text import read_unit
from rsgen.law.character import MAX_SUBSET_PARAMETERS, Character, character
from rsgen.law.forms import STATES
from rsgen.law.memory import from_rest, memory_form
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


class Periodic(Protocol):
    """One period of n motions: displacement, velocity, acceleration as waveforms (n, samples)."""

    def waveforms(self, samples: int) -> tuple[Array, Array, Array]:
        """Displacement [m], velocity [m/s] and acceleration [m/s^2]."""
        ...

    def interval(self, samples: int) -> Array:
        """(n, 1) time from sample to sample [s]."""
        ...


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

    def along(self, motion: Periodic, values: Array, samples: int) -> ForceSample:
        """Evaluate the law and all its derivatives (n, samples) over one period of n motions.

        Parameters
        ----------
        motion
            A ``rsgen.law.motion.Motion``.
        values
            (p,) SI values of the parameters.
        samples
            A period.
        """
        return self.sample(*motion.waveforms(samples), motion.interval(samples), values)

    def states_at_start(self, motion: Periodic, values: Array) -> Array:
        """(r, n) states with equations at t = 0 of n periodic motions; r = 0 for a law without."""
        samples = samples_for(self.switched)
        waves, step = motion.waveforms(samples), motion.interval(samples)
        if self._loops is None:
            return np.zeros((0, len(waves[0])))
        return self._loops.states(waves, step, values)[:, :, 0]

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
    >>> from rsgen.formula import parse
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
    >>> from rsgen.formula import parse
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


# ----------------------------------------------------------------------------
# Combinations of parameters, from the null space of the derivatives of the force.

TRIAL_VALUES = 3
"""Random values of all parameters; a combination of the law has the same null vector at each of them."""

MOTIONS, SAMPLES = 40, 256
"""Motions at each of them, and samples of a period: hundreds of equations a parameter."""

SMALLEST, LARGEST = 0.02, 20.0
"""Amplitudes relative to parameters around one, below and above all switches."""


DIRECTION_TOLERANCE = 1e-5
"""Largest difference of equal directions; no law with a singular value between both is judged."""

MAX_DENOMINATOR = 6
"""Largest denominator of a power in a product."""


@dataclass(frozen=True, slots=True)
class Combination:
    """Parameters of which a test determines combinations only.

    Parameters
    ----------
    parameters
        Names that no test separates.
    determined
        What can be identified of them, in the expression language; empty where it is neither a product nor a
        sum.
    """

    parameters: tuple[str, ...]
    determined: tuple[str, ...]

    @property
    def finding(self) -> Finding:
        """The fact as a finding."""
        names = {"with": _listed(self.parameters), "determined": _listed(self.determined)}
        return Finding("confounded", "info", names=names)


def _listed(names: tuple[str, ...]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def combinations_of(force: sympy.Expr) -> tuple[Combination, ...]:
    """Find the parameters of a law that occur in combinations only.

    Examples
    --------
    >>> from rsgen.formula import parse
    >>> combinations_of(parse("a*b*x + c*v"))
    (Combination(parameters=('a', 'b'), determined=('a*b',)),)
    >>> combinations_of(parse("k*x + k3*x**3"))
    ()
    """
    if not 2 <= len(force.free_symbols - {symbol("x"), symbol("v")}) <= MAX_SUBSET_PARAMETERS:
        return ()
    law = compile_law(force)
    spaces = []
    for seed in range(TRIAL_VALUES):
        space = _null_space(law.parameters, force, seed)
        if space is None or not len(space[0]):
            return ()
        spaces.append(space)
    groups = _groups([null for null, _ in spaces])
    return tuple(_combination(group, spaces, law.parameters) for group in groups)


def _null_space(names: tuple[str, ...], force: sympy.Expr, seed: int) -> tuple[Array, Array] | None:
    """Return (d, p) directions in the logarithms of the parameters that change no force, and the values."""
    rng = np.random.default_rng(seed)
    values = np.exp(rng.uniform(-0.7, 0.7, len(names)))
    rows = _slopes(force, values, rng)
    if not len(rows):
        return None
    sizes = np.sqrt(np.mean(rows**2, axis=0))
    if not np.all(sizes > 0):
        # a parameter without influence on these motions: nothing follows
        return None
    _, singular, directions = np.linalg.svd(rows / sizes, full_matrices=False)
    share = singular / singular[0]
    if np.any((share > NULL_TOLERANCE) & (share < DIRECTION_TOLERANCE)):
        return None
    return directions[share <= NULL_TOLERANCE] / sizes, values


def _slopes(force: sympy.Expr, values: Array, rng: np.random.Generator) -> Array:
    """Return (m, p) derivatives of the force along random motions by the logarithms of the parameters."""
    law = compile_law(force)
    phase = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    size = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST), (MOTIONS, 1)))
    omega = np.exp(rng.uniform(-1, 1, (MOTIONS, 1)))
    part = rng.uniform(-0.25, 0.25, (4, MOTIONS, 1))
    if law.odd:
        # an odd law has neither even harmonics nor a mean
        part[0] = 0
    order = np.array([1.0, 2.0, 3.0])[:, None, None]
    weight = np.stack([np.ones((MOTIONS, 1)), part[0], part[1]])
    turn = order * (phase + 0.37) + np.stack([np.zeros((MOTIONS, 1)), part[2], part[3]])
    x = size * np.sum(weight * np.sin(turn), axis=0)
    v = size * omega * np.sum(weight * order * np.cos(turn), axis=0)
    a = -size * omega**2 * np.sum(weight * order**2 * np.sin(turn), axis=0)
    with np.errstate(all="ignore"):
        sample = law.sample(x, v, a, 2 * np.pi / omega / SAMPLES, values)
        rows = np.stack([np.broadcast_to(part, x.shape) for part in sample.by_parameter], axis=-1) * values
        # every motion counts alike, however large its force
        largest = np.max(np.abs(rows), axis=(1, 2), keepdims=True)
        rows = (rows / largest).reshape(-1, len(values))
    finite: Array = rows[np.isfinite(rows).all(axis=1)]
    return finite


def _groups(spaces: list[Array]) -> list[list[int]]:
    """Sort the parameters that null vectors move into groups that no null vector connects."""
    projector = spaces[0].T @ np.linalg.pinv(spaces[0].T)
    linked = np.abs(projector) > DIRECTION_TOLERANCE
    groups: list[list[int]] = []
    for i in np.flatnonzero(linked.diagonal()):
        if not any(i in group for group in groups):
            groups.append([int(j) for j in np.flatnonzero(linked[i])])
    return groups


def _combination(group: list[int], trials: list[tuple[Array, Array]], names: tuple[str, ...]) -> Combination:
    """Find the products, or else the sums, of a group of parameters that a test determines."""
    inside = tuple(names[i] for i in group)
    for powers in (True, False):
        spaces = [null if powers else null * values for null, values in trials]
        parts = [_reduced(space[:, group]) for space in spaces]
        if any(part is None or not len(part) for part in parts):
            continue
        first = parts[0]
        if first is None or any(
            part is None or part.shape != first.shape or np.abs(part - first).max() > DIRECTION_TOLERANCE
            for part in parts
        ):
            continue
        written = _written(first, inside, powers)
        if written:
            return Combination(inside, written)
    return Combination(inside, ())


def _reduced(space: Array) -> Array | None:
    """Bring the rows of a null space to the form with unit columns; None where it has none."""
    _, singular, directions = np.linalg.svd(space, full_matrices=False)
    rows = directions[singular > DIRECTION_TOLERANCE * singular[0]]
    size = len(rows)
    best: tuple[float, Array] | None = None
    for columns in combinations(range(space.shape[1]), size):
        block = rows[:, columns]
        if abs(np.linalg.det(block)) < DIRECTION_TOLERANCE:
            continue
        reduced = np.linalg.solve(block, rows)
        # few and positive powers of the other parameters read best
        cost = float(np.sum(np.abs(reduced)) + 2 * np.sum(reduced > DIRECTION_TOLERANCE))
        if best is None or cost < best[0] - DIRECTION_TOLERANCE:
            best = cost, reduced
    return None if best is None else best[1]


def _pivots(reduced: Array) -> NDArray[np.intp]:
    """Find the columns of the unit matrix in a reduced null space."""
    unit = (np.abs(reduced) > DIRECTION_TOLERANCE).sum(axis=0) == 1
    found = [
        next(int(j) for j in np.flatnonzero(unit) if abs(row[j] - 1) < DIRECTION_TOLERANCE) for row in reduced
    ]
    return np.array(found, dtype=np.intp)


def _written(reduced: Array, names: tuple[str, ...], powers: bool) -> tuple[str, ...]:
    """Write the complement of a null space as products or sums; empty if weights are no simple fractions."""
    pivots = _pivots(reduced)
    found = []
    for j in range(len(names)):
        if j in pivots:
            continue
        weights = np.zeros(len(names))
        weights[j] = 1.0
        weights[pivots] = -reduced[:, j]
        simple = [Fraction(float(w)).limit_denominator(MAX_DENOMINATOR) for w in weights]
        if np.abs(weights - np.array([float(s) for s in simple])).max() > 10 * DIRECTION_TOLERANCE:
            return ()
        # integer weights, the first of them positive
        factor = int(np.lcm.reduce([weight.denominator for weight in simple]))
        factor *= next(1 if weight > 0 else -1 for weight in simple if weight)
        pairs = [
            (sympy.Symbol(n), sympy.Integer(int(w * factor))) for n, w in zip(names, simple, strict=True)
        ]
        found.append(
            sympy.Mul(*(n**w for n, w in pairs)) if powers else sympy.Add(*(n * w for n, w in pairs))
        )
    return tuple(sorted(map(str, found)))
