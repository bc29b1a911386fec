"""Properties of a law: odd, smooth or rough, and in which of its parameters it is linear.

A law is jointly linear in a set of parameters if no second difference of its pieces by two of them differs
from zero. Identities are tested at random states and values of several sizes, since SymPy's proofs do not end
for every law.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations, combinations_with_replacement

import numpy as np
import sympy

import rsgen.law  # compiles loops, for laws with memory
from rsgen.common.arrays import Array
from rsgen.common.tolerances import ROUND_OFF
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import symbol
from rsgen.law.forms import expanded
from rsgen.law.memory import RESIDUAL_TOLERANCE, MemoryForm, memory_form, positive_in
from rsgen.law.normal_form import Piece, Switch, normal_form, normal_form_at, slope_between_jumps

RANDOM_STATES = 64

STATE_SIZES = (1e-3, 1.0, 1e3)
"""Standard deviations of random states and values."""

CANCELLATION_TOLERANCE = 1e-9
"""Largest relative size of a sum that is zero."""

MAX_SUBSET_PARAMETERS = 12
"""Largest number of parameters of which all subsets are tried; of more a greedy choice is made."""


def jointly_linear(
    pieces: Sequence[Piece],
    parameters: Sequence[sympy.Symbol],
    clashing: AbstractSet[tuple[int, int]] = frozenset(),
) -> tuple[int, ...]:
    """Find the largest set of parameters in which every term is linear at once (first such set by name).

    ``clashing`` are pairs in which the law is known not to be.
    """
    switches = {switch.function for piece in pieces for switch in piece.switches}
    thresholds = {free for function in switches for free in function.free_symbols}
    clash = clashing | _second_differences([piece.term for piece in pieces], parameters)
    free = [i for i, p in enumerate(parameters) if p not in thresholds and (i, i) not in clash]
    if len(free) <= MAX_SUBSET_PARAMETERS:
        for size in range(len(free), 0, -1):
            for chosen in combinations(free, size):
                if not any(pair in clash for pair in combinations(chosen, 2)):
                    return chosen
    picked: list[int] = []
    for i in sorted(free, key=lambda i: sum(i in pair for pair in clash)):
        if not any(tuple(sorted((i, j))) in clash for j in picked):
            picked.append(i)
    return tuple(sorted(picked))


MIN_SECOND_DIFFERENCE = 1e-9
"""Smallest second difference, relative to the addends, that is not round-off."""

PARAMETER_STEPS = (0.5, -2.0)
"""Relative steps of second differences: of half a parameter, and to the other sign, where abs(p) bends."""


@np.errstate(all="ignore")
def _second_differences(
    terms: Sequence[sympy.Expr], parameters: Sequence[sympy.Symbol]
) -> set[tuple[int, int]]:
    """Find pairs of parameters in which a term has a second difference that is not zero.

    It is compared with the sum of all addends, since (x - b)**7 is round-off of its addends near x = b.
    """
    parts = [sympy.Add.make_args(expanded(term)) for term in terms]
    starts = np.cumsum([0, *(len(part) for part in parts[:-1])])
    states = tuple(sorted({s for term in terms for s in term.free_symbols} - set(parameters), key=str))
    law = compiled(tuple(addend for part in parts for addend in part), (*states, *parameters))
    generator = np.random.default_rng(0)
    shape = (len(states) + len(parameters), RANDOM_STATES)
    # around one, and over eight decades, so that no term is negligible at all places
    places = np.hstack([np.exp(generator.normal(size=shape)), 10.0 ** generator.uniform(-4, 4, shape)])

    def moved(step: float, *which: int) -> Array:
        trial = np.array(places)
        for i in which:
            trial[len(states) + i] += step * places[len(states) + i]
        return np.array([np.broadcast_to(value, places.shape[1]) for value in law(*trial)])

    found: set[tuple[int, int]] = set()
    for step in PARAMETER_STEPS if parts else ():
        still, once = moved(step), [moved(step, i) for i in range(len(parameters))]
        for i, j in combinations_with_replacement(range(len(parameters)), 2):
            corners = np.array([still, -once[i], -once[j], moved(step, i, j)])
            size = np.add.reduceat(np.abs(corners).max(axis=0), starts)
            bend = np.abs(np.add.reduceat(corners.sum(axis=0), starts))
            if np.any((bend > MIN_SECOND_DIFFERENCE * size) & np.isfinite(size)):
                found.add((i, j))
    return found


def vanishes(expression: sympy.Expr) -> bool:
    """Decide whether an expression is zero, from its value at random places: simplification may not end."""
    if expression == 0:
        return True
    if expression.has(sympy.DiracDelta, sympy.Derivative):
        # the slope of |p| jumps where p changes its sign
        return False
    variables = tuple(sorted(expression.free_symbols, key=str))
    parts = sympy.Add.make_args(expression)
    generator = np.random.default_rng(0)
    # over eight decades, so that no term is negligible at all places
    places = 10.0 ** generator.uniform(-4, 4, (len(variables), RANDOM_STATES)) * generator.uniform(
        0.5, 2.0, RANDOM_STATES
    )
    values = np.array([np.broadcast_to(part, RANDOM_STATES) for part in compiled(parts, variables)(*places)])
    with np.errstate(over="ignore"):
        size = np.sum(np.abs(values), axis=0)
    shown = np.isfinite(size) & (size > 0)
    return bool(
        shown.any() and np.all(np.abs(values[:, shown].sum(axis=0)) <= CANCELLATION_TOLERANCE * size[shown])
    )


MAX_GROUP_SIZE = 3
"""Largest number of parameters in whose common factor a law is linear; force and stiffness of a saturation
are two."""


def scaled_groups(
    count: int, linear: Sequence[int], is_scaled: Callable[[tuple[int, ...], Sequence[int]], bool]
) -> tuple[tuple[int, ...], ...]:
    """Find the smallest disjoint groups of nonlinear parameters in whose common factor a law is linear."""
    free = [i for i in range(count) if i not in linear]
    groups: list[tuple[int, ...]] = []
    for size in range(1, MAX_GROUP_SIZE + 1):
        for chosen in combinations(free, size):
            taken = {i for group in groups for i in group}
            if not taken & set(chosen) and is_scaled(chosen, linear):
                groups.append(chosen)
    return tuple(groups)


def is_scaled(
    pieces: Sequence[Piece],
    parameters: Sequence[sympy.Symbol],
    chosen: tuple[int, ...],
    linear: Sequence[int],
) -> bool:
    """Decide whether a law depends on a common factor of the chosen parameters, and is affine in it."""
    scaled = [_scales(piece, parameters, chosen, linear) for piece in pieces]
    return None not in scaled and any(scaled)


@lru_cache(maxsize=512)
def _addends(piece: Piece) -> tuple[sympy.Expr, ...]:
    return tuple(sympy.Add.make_args(expanded(piece.term)))


GROUP_FACTORS = (1.0, 2.0, 3.0)
"""Common factors of a group between which the force must be affine."""


@np.errstate(all="ignore")
def _scales(
    piece: Piece, parameters: Sequence[sympy.Symbol], chosen: tuple[int, ...], linear: Sequence[int]
) -> bool | None:
    """Decide whether a piece depends on a factor of the chosen; None if it is not affine in it.

    Switches may change by a positive factor only.
    """
    group = {parameters[i] for i in chosen}
    addends, functions = _addends(piece), (switch.function for switch in piece.switches)
    expressions = (*addends, *functions)
    touched = [i for i, part in enumerate(expressions) if part.free_symbols & group]
    parts = [expressions[i] for i in touched if i < len(addends)]
    if not touched:
        return False
    if not parts or any(part.free_symbols & {parameters[i] for i in linear} for part in parts):
        # a part that another unknown multiplies would be linear in neither
        return None
    # one function of all parts serves every group
    law = compiled(expressions, (symbol("x"), symbol("v"), *parameters))
    generator = np.random.default_rng(1)
    acts = False
    for size in STATE_SIZES:
        x, v = generator.normal(size=(2, RANDOM_STATES)) * size
        values = np.exp(generator.normal(size=len(parameters))) * generator.choice(STATE_SIZES)
        drawn = []
        for factor in GROUP_FACTORS:
            trial = np.array(values)
            trial[list(chosen)] *= factor
            all_parts = law(x, v, *trial)
            drawn.append([np.broadcast_to(all_parts[i], x.shape) for i in touched])
        shares = np.array([values_of_parts[: len(parts)] for values_of_parts in drawn])
        signs = [values_of_parts[len(parts) :] for values_of_parts in drawn]
        shares = shares[:, :, np.all(np.isfinite(shares), axis=(0, 1))]
        forces = shares.sum(axis=1)
        step = np.max(np.abs(forces[1] - forces[0]), initial=0.0)
        second = forces[2] - 2 * forces[1] + forces[0]
        round_off = ROUND_OFF * np.max(np.abs(shares), initial=0.0)
        if np.any(np.abs(second) > max(CANCELLATION_TOLERANCE * step, round_off)) or not _same_sign(signs):
            return None
        acts |= bool(step > max(CANCELLATION_TOLERANCE * np.max(np.abs(forces), initial=0.0), round_off))
    return acts


@np.errstate(all="ignore")
def _same_sign(signs: Sequence[Sequence[Array]]) -> bool:
    """Decide whether switches change by one positive factor at all states."""
    for before, after in zip(signs[0], signs[1], strict=True):
        size = np.max(np.abs(before), initial=0.0)
        factor = float(np.sum(before * after) / np.sum(before * before))
        if not (
            factor > 0 and np.all(np.abs(after - factor * before) <= CANCELLATION_TOLERANCE * factor * size)
        ):
            return False
    return True


# ----------------------------------------------------------------------------
# Parameters in which the loop of a law with states is linear: by finite differences along random motions.

LOOP_SAMPLES = 32
"""Samples of a period: linearity holds for the discrete loop, however coarse it is."""

MOTIONS_PER_SIZE = 3

MOTION_SIZES = (0.1, 1.0, 10.0)
"""Standard deviations of random motions, with and without saturation of a loop."""

PARAMETER_FACTORS = (-1.0, 1.0, 3.0)
"""Evenly spaced factors of a parameter between which the force must be affine. Both signs, because the factor
of abs(z) in an equation is affine for positive ones only."""


class RandomLoops:
    """Closed loops of a law along random motions at random values."""

    def __init__(self, form: MemoryForm, parameters: tuple[str, ...]) -> None:
        generator = np.random.default_rng(0)
        count = MOTIONS_PER_SIZE * len(MOTION_SIZES)
        harmonics = generator.normal(size=(2, count, 3)) / np.array([1.0, 4.0, 9.0])
        harmonics *= np.repeat(MOTION_SIZES, MOTIONS_PER_SIZE)[:, None]
        omega = np.exp(generator.normal(size=(count, 1)))
        phase = 2 * np.pi * np.arange(LOOP_SAMPLES) / LOOP_SAMPLES
        wave = np.exp(1j * np.arange(1, 4)[:, None] * phase)
        rate = 1j * omega * np.arange(1, 4)
        self._motion = [((harmonics[0] + 1j * harmonics[1]) * rate**power @ wave).real for power in range(3)]
        self._step = 2 * np.pi / LOOP_SAMPLES / omega
        self._values = np.exp(generator.normal(size=(len(parameters), count, 1)))
        self._loops = rsgen.law.compile_loops(form, parameters)
        closed = np.isfinite(self._forces([([], 1.0)])[0]).all(axis=1)
        self._motion = [part[closed] for part in self._motion]
        self._step = self._step[closed]
        self._values = self._values[:, closed]

    def bends(self, i: int) -> bool:
        """Decide whether the force is not affine in a parameter."""
        return not self._affine([i], PARAMETER_FACTORS)[0]

    def couples(self, i: int, j: int) -> bool:
        """Decide whether the force is not jointly affine in two parameters, affine in each."""
        return not self._separate([i], [j], PARAMETER_FACTORS[0])

    def scales(self, group: Sequence[int], linear: Sequence[int]) -> bool:
        """Decide whether a common factor of a group acts, and the force is affine in it.

        ``linear`` are the parameters in which the force has to be affine at the same time.
        """
        affine, acts = self._affine(group, GROUP_FACTORS)
        return affine and acts and all(self._separate(group, [other], GROUP_FACTORS[1]) for other in linear)

    def _affine(self, group: Sequence[int], factors: Sequence[float]) -> tuple[bool, bool]:
        """Decide whether the force is affine in a common factor, and whether the factor acts."""
        forces = self._forces([(group, factor) for factor in factors])
        return (
            _forces_cancel(forces[0] - 2 * forces[1] + forces[2], forces),
            not _forces_cancel(forces[1] - forces[0], forces),
        )

    def _separate(self, group: Sequence[int], other: Sequence[int], factor: float) -> bool:
        """Decide whether a factor of two groups changes the force for one independently of the other."""
        forces = self._forces([(chosen, factor) for chosen in ([], group, other, [*group, *other])])
        return _forces_cancel(forces[0] - forces[1] - forces[2] + forces[3], forces)

    def _forces(self, trials: Sequence[tuple[Sequence[int], float]]) -> Array:
        """(t, n, s) loops with a group of parameters multiplied by a factor, for every trial."""
        if not len(self._step):
            # of a law whose loops never close
            return np.zeros((len(trials), 0, LOOP_SAMPLES))
        values = np.repeat(self._values[:, None], len(trials), axis=1)
        for place, (group, factor) in enumerate(trials):
            values[list(group), place] *= factor
        x, v, a = (np.tile(part, (len(trials), 1)) for part in self._motion)
        step = np.tile(self._step, (len(trials), 1))
        sample = self._loops.sample(x, v, a, step, list(values.reshape(len(values), len(x), 1)))
        return sample.force.reshape(len(trials), -1, LOOP_SAMPLES)


def _forces_cancel(difference: Array, forces: Array) -> bool:
    """Decide whether a combination of forces (n, s) cancels on every loop that closes."""
    size = np.max(np.abs(forces), axis=(0, 2), initial=0.0)
    closed = np.isfinite(size) & (size > 0)
    return bool(
        closed.any() and np.all(np.abs(difference[closed]).max(axis=1) <= RESIDUAL_TOLERANCE * size[closed])
    )


@dataclass(frozen=True, slots=True, eq=False)
class Character:
    """Properties of a law n(x, v; p).

    Parameters
    ----------
    parameters
        Names, in the order of every parameter array.
    linear
        Indices of parameters in which the law is jointly linear once the others are fixed.
    nonlinear
        The other indices (breakpoints, exponents, widths of a tanh ...).
    scaled
        Groups of nonlinear indices in whose common positive factor the law is linear: force and stiffness
        of a saturation.
    odd
        True where n(-x, -v) = -n(x, v): the mean and all even harmonics vanish.
    positive
        Nonlinear indices that must be positive for every virgin curve to be one.
    even
        Linear indices of forces p phi with phi(-x, -v) = phi(x, v): along a motion without mean and even
        harmonics these have no odd harmonic.
    mirrored
        True where the other sign of all even ones is the law of the mirror image -x.
    remembers
        True where the force depends on the past motion: it is known along whole periods only.
    switched
        True where the law has switches at all, or reversals of a Masing law.
    rough
        True where the law jumps or has a corner at one of them; x|x| does not.
    jumps
        True where it jumps.
    springs
        True where the force depends on x: the mean displacement then follows from the law.
    """

    parameters: tuple[str, ...]
    linear: tuple[int, ...]
    nonlinear: tuple[int, ...]
    scaled: tuple[tuple[int, ...], ...]
    positive: tuple[int, ...]
    odd: bool
    even: tuple[int, ...]
    mirrored: bool
    remembers: bool
    switched: bool
    rough: bool
    jumps: bool
    springs: bool

    def ordered(self, values: Mapping[str, float]) -> Array:
        """(p,) values by name in the order of the parameters."""
        return np.array([float(values[name]) for name in self.parameters])

    def named(self, values: Array) -> dict[str, float]:
        """Return values (p,) by the names of the parameters."""
        return dict(zip(self.parameters, values.tolist(), strict=True))

    def values_of(self, linear: Array, nonlinear: Array) -> Array:
        """(p,) values of linear parameters, without what follows in a solution, and of nonlinear ones."""
        values = np.zeros(len(self.parameters))
        values[list(self.linear)] = linear[: len(self.linear)]
        values[list(self.nonlinear)] = nonlinear
        return values

    @property
    def mean_free(self) -> bool:
        """True if a law with memory has no spring that holds the mean displacement.

        A loop is the same wherever it lies, so that the mass stays where the start left it.
        """
        return self.remembers and not self.springs


@lru_cache(maxsize=256)
def character(force: sympy.Expr) -> Character:
    """Determine the properties of a law; its parameters are all symbols but x and v, sorted by name.

    Those of a law with states follow from its closed loops along random motions.
    """
    memory, x, v = memory_form(force), symbol("x"), symbol("v")
    parameters = sorted(force.free_symbols - {x, v}, key=str)
    rates: dict[sympy.Symbol, sympy.Expr] = {}
    inner = law = force
    if memory is not None:
        rates, inner = {rate.symbol: rate.rate for rate in memory.rates}, memory.force
        # the same virgin curves and stiffnesses without their memory
        law = inner.xreplace(
            {c.symbol: sympy.sign(x) * c.virgin.xreplace({x: sympy.Abs(x)}) for c in memory.curves}
        )
        law = law if memory.lag is None else law.xreplace({memory.lag: v})
    curves = () if memory is None else memory.curves
    remembered = set().union(*(rate.free_symbols for rate in rates.values()))
    moving, parts = (x, v, *rates), (law, *rates.values())
    pieces = normal_form(law).pieces
    clash: set[tuple[int, int]] = set()
    is_group_scaled: Callable[[tuple[int, ...], Sequence[int]], bool] = partial(is_scaled, pieces, parameters)
    if memory is not None and rates:
        loops = RandomLoops(memory, tuple(str(p) for p in parameters))
        inside = {i for i, p in enumerate(parameters) if p in remembered}
        bent = {i for i in inside if loops.bends(i)}
        straight = [i for i in range(len(parameters)) if i not in bent]
        clash = {(i, i) for i in bent} | {
            (i, j) for i, j in combinations(straight, 2) if {i, j} & inside and loops.couples(i, j)
        }
        is_group_scaled = loops.scales
    linear = jointly_linear(pieces, parameters, clash)
    nonlinear = tuple(i for i in range(len(parameters)) if i not in linear)
    even = tuple(
        i
        for i in linear
        if parameters[i] not in remembered
        and is_mirrored(slope_between_jumps(law, parameters[i]), moving, parameters, 1.0)
    )
    without = law.subs({parameters[i]: 0 for i in even})
    odd = all(is_mirrored(rate, moving, parameters, -1.0) for rate in rates.values())
    onsets = [_onsets(part, parameters) for part in parts]
    return Character(
        parameters=tuple(str(p) for p in parameters),
        linear=linear,
        nonlinear=nonlinear,
        scaled=scaled_groups(len(parameters), linear, is_group_scaled),
        positive=tuple(i for i in nonlinear if any(positive_in(c.virgin, parameters[i]) for c in curves)),
        odd=odd and is_mirrored(law, moving, parameters, -1.0),
        even=even,
        mirrored=odd and is_mirrored(without, moving, parameters, -1.0),
        remembers=memory is not None,
        switched=bool(curves) or any(piece.switches for part in parts for piece in normal_form(part).pieces),
        # branches meet in a corner at every reversal
        rough=bool(curves) or any(jump or corner for found in onsets for jump, corner in found),
        jumps=any(jump for jump, _ in onsets[0]),
        springs=any(part.has(x) for part in (inner, *rates.values())),
    )


PARAMETER_SPREADS = (0.7, 1e3)
"""Differences of the parameter values, ascending by name from 1, at which jumps and corners are sought."""


def _onsets(law: sympy.Expr, parameters: Sequence[sympy.Symbol]) -> list[tuple[bool | None, bool | None]]:
    """Return whether each piece begins with a jump or a corner at each of its switches; see ``onset``."""
    return [
        onset(piece, switch)
        for spread in PARAMETER_SPREADS
        for piece in normal_form_at(law, {str(p): 1 + spread * i for i, p in enumerate(parameters)}).pieces
        for switch in piece.switches
    ]


def onset(piece: Piece, switch: Switch) -> tuple[bool | None, bool | None]:
    """Decide whether a piece begins at a switch with a jump, and whether with a corner.

    None if an unknown exponent decides, as that of ``abs(v)**p`` does at zero.
    """
    if switch.variable is None:
        return True, True
    variable = symbol(switch.variable)
    slope = piece.term.diff(variable)
    return _differs(piece.term, variable, switch.threshold), _differs(slope, variable, switch.threshold)


def _differs(term: sympy.Expr, variable: sympy.Symbol, threshold: sympy.Expr) -> bool | None:
    try:
        value = expanded(term.subs(variable, threshold))
        zero = value.is_zero
    except OverflowError:
        # a number such as cosh(besseli(0, 1e29)) says nothing
        return None
    if zero:
        return False
    if value.has(sympy.nan, sympy.AccumBounds):
        # the latter stands for what oscillates there
        return None
    known = value.replace(lambda e: e.is_Pow and e.base == 0, lambda e: sympy.S.Zero)
    if known == value:
        return not vanishes(value)
    return True if known.has(sympy.zoo) or not vanishes(known) else None


def is_mirrored(
    force: sympy.Expr, moving: Sequence[sympy.Symbol], parameters: Sequence[sympy.Symbol], sign: float
) -> bool:
    """Decide whether n(-x, -v, -z) = sign n(x, v, z)."""
    law = compiled((force,), (*moving, *parameters))
    generator = np.random.default_rng(0)
    for scale in STATE_SIZES:
        x = generator.normal(size=(len(moving), RANDOM_STATES)) * scale
        for _ in range(3):
            values = np.exp(generator.normal(size=len(parameters))) * scale
            (plus,), (minus,) = law(*x, *values), law(*-x, *values)
            plus, minus = np.broadcast_to(plus, RANDOM_STATES), np.broadcast_to(minus, RANDOM_STATES)
            finite = np.isfinite(plus) & np.isfinite(minus)
            largest = np.max(np.abs(plus[finite]), initial=0.0)
            with np.errstate(over="ignore"):
                difference = np.abs(plus[finite] - sign * minus[finite])
            if not np.all(difference <= CANCELLATION_TOLERANCE * largest):
                return False
    return True


def mirror_exchanges(
    force: sympy.Expr, one: sympy.Symbol, other: sympy.Symbol, *further: sympy.Symbol
) -> bool:
    """Decide whether the mirror image of a law without a memory is the law with two parameters exchanged.

    That is where the sum of both laws is odd, and their difference even. Two ``further`` ones are exchanged
    with them, as the stiffnesses of two stops with their gaps.
    """
    moving = (symbol("x"), symbol("v"))
    parameters = sorted(force.free_symbols - {*moving}, key=str)
    exchanged = force.xreplace(dict(zip((one, other, *further), (other, one, *further[::-1]), strict=True)))
    return all(
        is_mirrored(both, moving, parameters, sign)
        for both, sign in ((force + exchanged, -1.0), (force - exchanged, 1.0))
    )
