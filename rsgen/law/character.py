"""What kind of law it is: odd, smooth or rough, and in which of its parameters it is linear."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.linear_parameters import (
    PLACES,
    SAME,
    SIZES,
    is_scaled,
    jointly_linear,
    scaled_groups,
    vanishes,
)
from rsgen.law.loops import compile_loops
from rsgen.law.memory import MemoryForm, memory_form, positive_in
from rsgen.law.normal_form import expanded
from rsgen.law.pieces import Piece, Switch, normal_form, normal_form_at, slope_between_jumps

__all__ = ["Character", "TriedLoops", "character", "onset"]


# ----------------------------------------------------------------------------
# In which parameters the loop of a law with states is linear: tried on loops along random motions.

_SAMPLES = 32
"""A period: an identity of loops holds for the rule that closes them, however coarse it is."""

_MOTIONS = 3
"""Random motions at each size."""

_SIZES = (0.1, 1.0, 10.0)
"""Of random motions: a loop that saturates shows at one size what another hides."""

_SAME = 1e-6
"""Relative size at which differences of forces cancel; loops close to 1e-10."""

_FACTORS = (-1.0, 1.0, 3.0)
"""Factors of a parameter, evenly spaced, at which a force must be affine; that of abs(z) in an equation is
affine for positive ones only."""

_POSITIVE = (1.0, 2.0, 3.0)
"""The same for a common factor of a group."""


class TriedLoops:
    """Loops of a law along random motions at random values, of those that close."""

    def __init__(self, form: MemoryForm, parameters: tuple[str, ...]) -> None:
        generator = np.random.default_rng(0)
        count = _MOTIONS * len(_SIZES)
        harmonics = generator.normal(size=(2, count, 3)) / np.array([1.0, 4.0, 9.0])
        harmonics *= np.repeat(_SIZES, _MOTIONS)[:, None]
        omega = np.exp(generator.normal(size=(count, 1)))
        phase = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
        wave = np.exp(1j * np.arange(1, 4)[:, None] * phase)
        rate = 1j * omega * np.arange(1, 4)
        self._motion = [((harmonics[0] + 1j * harmonics[1]) * rate**power @ wave).real for power in range(3)]
        self._step = 2 * np.pi / _SAMPLES / omega
        self._values = np.exp(generator.normal(size=(len(parameters), count, 1)))
        self._loops = compile_loops(form, parameters)
        closed = np.isfinite(self._forces([([], 1.0)])[0]).all(axis=1)
        self._motion = [part[closed] for part in self._motion]
        self._step = self._step[closed]
        self._values = self._values[:, closed]

    def bends(self, i: int) -> bool:
        """Decide whether the force is not affine in a parameter."""
        return not self._affine([i], _FACTORS)[0]

    def couples(self, i: int, j: int) -> bool:
        """Decide whether the force is not jointly affine in two parameters, affine in each."""
        return not self._separate([i], [j], _FACTORS[0])

    def scales(self, group: Sequence[int], linear: Sequence[int]) -> bool:
        """Decide whether a common factor of a group acts, and the force is affine in it.

        ``linear`` are the parameters in which the force has to be affine at the same time.
        """
        affine, acts = self._affine(group, _POSITIVE)
        return affine and acts and all(self._separate(group, [other], _POSITIVE[1]) for other in linear)

    def _affine(self, group: Sequence[int], factors: Sequence[float]) -> tuple[bool, bool]:
        """Decide whether the force is affine in a common factor, and whether the factor acts."""
        forces = self._forces([(group, factor) for factor in factors])
        return (
            _vanishes(forces[0] - 2 * forces[1] + forces[2], forces),
            not _vanishes(forces[1] - forces[0], forces),
        )

    def _separate(self, group: Sequence[int], other: Sequence[int], factor: float) -> bool:
        """Decide whether a factor of two groups changes the force for one independently of the other."""
        forces = self._forces([(each, factor) for each in ([], group, other, [*group, *other])])
        return _vanishes(forces[0] - forces[1] - forces[2] + forces[3], forces)

    def _forces(self, trials: Sequence[tuple[Sequence[int], float]]) -> Array:
        """(t, n, s) loops with a group of parameters multiplied by a factor, for every trial."""
        values = np.repeat(self._values[:, None], len(trials), axis=1)
        for place, (group, factor) in enumerate(trials):
            values[list(group), place] *= factor
        x, v, a = (np.tile(part, (len(trials), 1)) for part in self._motion)
        step = np.tile(self._step, (len(trials), 1))
        sample = self._loops.sample(x, v, a, step, list(values.reshape(len(values), len(x), 1)))
        return sample.force.reshape(len(trials), -1, _SAMPLES)


def _vanishes(difference: Array, forces: Array) -> bool:
    """Decide whether a combination of forces (n, s) cancels on every loop that closes."""
    size = np.max(np.abs(forces), axis=(0, 2), initial=0.0)
    closed = np.isfinite(size) & (size > 0)
    return bool(closed.any() and np.all(np.abs(difference[closed]).max(axis=1) <= _SAME * size[closed]))


_TYPICAL = (0.7, 1e3)
"""Values at which jumps and corners are looked for: positive, ascending by name, close and far apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Character:
    """The kind of a law n(x, v; p).

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

    def values_of(self, linear: Array, nonlinear: Array) -> Array:
        """(p,) values of linear parameters, without what follows in a solution, and of nonlinear ones."""
        values = np.zeros(len(self.parameters))
        values[list(self.linear)] = linear[: len(self.linear)]
        values[list(self.nonlinear)] = nonlinear
        return values

    @property
    def mean_free(self) -> bool:
        """Whether a law with memory has no spring that holds the mean displacement.

        A loop is the same wherever it lies, so that the mass stays where the start left it.
        """
        return self.remembers and not self.springs


@lru_cache(maxsize=256)
def character(force: sympy.Expr) -> Character:
    """Find out what kind of law this is; parameters are every symbol but x and v, sorted by name."""
    memory = memory_form(force)
    if memory is not None:
        return _character_with_memory(force, memory)
    states = (symbol("x"), symbol("v"))
    parameters = sorted(force.free_symbols - set(states), key=str)
    pieces = normal_form(force).pieces
    linear = jointly_linear(pieces, parameters)
    onsets = _onsets(force, parameters)
    even = tuple(
        i for i in linear if _is_mirrored(slope_between_jumps(force, parameters[i]), states, parameters, 1.0)
    )
    without = force.subs({parameters[i]: 0 for i in even})
    return Character(
        parameters=tuple(str(p) for p in parameters),
        linear=linear,
        nonlinear=tuple(i for i in range(len(parameters)) if i not in linear),
        scaled=scaled_groups(len(parameters), linear, partial(is_scaled, pieces, parameters)),
        positive=(),
        odd=_is_mirrored(force, states, parameters, -1.0),
        even=even,
        mirrored=_is_mirrored(without, states, parameters, -1.0),
        remembers=False,
        switched=any(piece.switches for piece in pieces),
        rough=any(jump or corner for jump, corner in onsets),
        jumps=any(jump for jump, _ in onsets),
        springs=bool(force.has(symbol("x"))),
    )


def _character_with_memory(force: sympy.Expr, memory: MemoryForm) -> Character:
    """Find out what kind of law with memory this is, from its closed loops.

    Masing's rule and the lag of structural damping are linear: such a force is linear in what its virgin
    curve and its stiffness are linear in. Loops of states are tried.
    """
    x, v = symbol("x"), symbol("v")
    parameters = sorted(force.free_symbols - {x, v}, key=str)
    rates = {rate.symbol: rate.rate for rate in memory.rates}
    remembered = set().union(*(rate.free_symbols for rate in rates.values()))
    # the same virgin curves and stiffnesses without their memory
    law = memory.force.xreplace(
        {c.symbol: sympy.sign(x) * c.virgin.xreplace({x: sympy.Abs(x)}) for c in memory.curves}
    )
    law = law if memory.lag is None else law.xreplace({memory.lag: v})
    moving = (x, v, *rates)
    pieces = normal_form(law).pieces
    tried = TriedLoops(memory, tuple(str(p) for p in parameters))
    inside = [i for i, p in enumerate(parameters) if p in remembered]
    bent = [i for i in inside if tried.bends(i)]
    straight = [i for i in range(len(parameters)) if i not in bent]
    clash = {(i, i) for i in bent} | {
        (i, j) for i, j in combinations(straight, 2) if {i, j} & set(inside) and tried.couples(i, j)
    }
    linear = jointly_linear(pieces, parameters, clash)
    nonlinear = tuple(i for i in range(len(parameters)) if i not in linear)
    factors = tried.scales if rates else partial(is_scaled, pieces, parameters)
    onsets = [each for part in (law, *rates.values()) for each in _onsets(part, parameters)]
    even = tuple(
        i
        for i in linear
        if parameters[i] not in remembered
        and _is_mirrored(slope_between_jumps(law, parameters[i]), moving, parameters, 1.0)
    )
    without = law.subs({parameters[i]: 0 for i in even})
    odd = all(_is_mirrored(rate, moving, parameters, -1.0) for rate in rates.values())
    switched = bool(memory.curves) or any(
        piece.switches for part in (law, *rates.values()) for piece in normal_form(part).pieces
    )
    return Character(
        parameters=tuple(str(p) for p in parameters),
        linear=linear,
        nonlinear=nonlinear,
        scaled=scaled_groups(len(parameters), linear, factors),
        positive=tuple(
            i for i in nonlinear if any(positive_in(c.virgin, parameters[i]) for c in memory.curves)
        ),
        odd=odd and _is_mirrored(law, moving, parameters, -1.0),
        even=even,
        mirrored=odd and _is_mirrored(without, moving, parameters, -1.0),
        remembers=True,
        switched=switched,
        # branches meet in a corner at every reversal
        rough=bool(memory.curves) or any(jump or corner for jump, corner in onsets),
        jumps=any(jump for jump, _ in _onsets(law, parameters)),
        springs=any(part.has(x) for part in (memory.force, *rates.values())),
    )


def _onsets(law: sympy.Expr, parameters: Sequence[sympy.Symbol]) -> list[tuple[bool | None, bool | None]]:
    """How pieces set in at their switches, at values close together and far apart."""
    return [
        onset(piece, switch)
        for spread in _TYPICAL
        for piece in normal_form_at(law, {str(p): 1 + spread * i for i, p in enumerate(parameters)}).pieces
        for switch in piece.switches
    ]


def onset(piece: Piece, switch: Switch) -> tuple[bool | None, bool | None]:
    """Decide whether a piece sets in at a switch with a jump, and whether with a corner.

    None stands for what an unknown exponent decides, as that of ``abs(v)**p`` does at zero.
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


def _is_mirrored(
    force: sympy.Expr, moving: Sequence[sympy.Symbol], parameters: Sequence[sympy.Symbol], sign: float
) -> bool:
    """Decide whether n(-x, -v, -z) = sign n(x, v, z)."""
    # tried at random states and values of several sizes: a symbolic proof does not end for every law
    law = compiled((force,), (*moving, *parameters))
    generator = np.random.default_rng(0)
    for scale in SIZES:
        x = generator.normal(size=(len(moving), PLACES)) * scale
        for _ in range(3):
            values = np.exp(generator.normal(size=len(parameters))) * scale
            (one,), (other,) = law(*x, *values), law(*-x, *values)
            one, other = np.broadcast_to(one, PLACES), np.broadcast_to(other, PLACES)
            finite = np.isfinite(one) & np.isfinite(other)
            largest = np.max(np.abs(one[finite]), initial=0.0)
            with np.errstate(over="ignore"):
                left = np.abs(one[finite] - sign * other[finite])
            if not np.all(left <= SAME * largest):
                return False
    return True
