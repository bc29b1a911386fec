"""Projections of a law on a cycle by adaptive Gauss-Kronrod quadrature, for many cycles at once.

    integral n(x, v) {sin(phi), cos(phi), 1, sign(n)} dphi,  x = X0 + X sin(phi),  v = omega X cos(phi)

Every cycle is split at the angles at which its switches go on or off, since the rule of 21 nodes is accurate
on smooth intervals only. Intervals that are not yet accurate are halved together for all cycles, so that
thousands of amplitudes cost little more than the hardest of them. The error of an interval follows from the
embedded rule of 10 nodes, as in QUADPACK (Piessens et al., Springer, 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, blocks
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.formula.names import symbol
from rsgen.law.normal_form import NormalForm, normal_form

# Gauss-Kronrod pair with 10 and 21 nodes (Piessens et al., QUADPACK, 1983), positive half
_NODES = np.array([
    0.995657163025808080735527280689003, 0.973906528517171720077964012084452,
    0.930157491355708226001207180059508, 0.865063366688984510732096688423493,
    0.780817726586416897063717578345042, 0.679409568299024406234327365114874,
    0.562757134668604683339000099272694, 0.433395394129247190799265943165784,
    0.294392862701460198131126603103866, 0.14887433898163121088482600112972, 0.0,
])  # fmt: skip
_KRONROD = np.array([
    0.011694638867371874278064396062192, 0.03255816230796472747881897245938961,
    0.05475589657435199603138130024458018, 0.07503967481091995276704314091619001,
    0.093125454583697605535065465083366, 0.10938715880229764189921059032580496,
    0.123491976262065851077958109585166, 0.134709217311473325928054001771707,
    0.142775938577060080797094273138717, 0.147739104901338491374841515972068,
    0.149445554002916905664936468389821,
])  # fmt: skip
_GAUSS = np.array([
    0.066671344308688137593568809893332, 0.149451349150580593145863397657697,
    0.219086362515982043995534934228163, 0.269266719309996355091226921569469,
    0.295524224714752870173815619188769,
])  # fmt: skip
_POINTS = np.concatenate((-_NODES[:-1], _NODES[::-1]))
_WEIGHTS = np.concatenate((_KRONROD[:-1], _KRONROD[::-1]))
_COARSE = np.zeros(21)
_COARSE[1:10:2], _COARSE[11:20:2] = _GAUSS, _GAUSS[::-1]


class Cycle(NamedTuple):
    """Cycles x = mean + X sin(phi), v = omega X cos(phi) and the parameters of each; arrays (n,)."""

    X: Array
    mean: Array
    omega: Array
    parameters: tuple[Array, ...]


class Projections(NamedTuple):
    """(n,) integrals over a cycle of the force times sin, times cos, times 1, and of its absolute value.

    ``error`` is the estimated error of the worst of the first three.
    """

    sine: Array
    cosine: Array
    mean: Array
    size: Array
    error: Array

    def harmonics(self, cycle: Cycle) -> list[Array]:
        """Return stiffness [N/m], damping [N s/m] and mean force [N]; arrays (n,)."""
        per_length = 1 / (np.pi * cycle.X)
        return [self.sine * per_length, self.cosine * per_length / cycle.omega, self.mean / (2 * np.pi)]


def switching_angles(form: NormalForm, parameters: tuple[sympy.Symbol, ...], cycle: Cycle) -> Array:
    """Return (n, s) angles in [-pi/2, 3 pi/2] at which a switch of the law may go on or off."""
    columns: list[Array] = []
    for switch in form.switches:
        if switch.threshold is None:
            columns += _crossings(switch.function, parameters, cycle)
            continue
        (level,) = compiled((switch.threshold,), parameters)(*cycle.parameters)
        with np.errstate(all="ignore"):
            if switch.variable == "x":
                angle = np.arcsin(np.clip((level - cycle.mean) / cycle.X, -1, 1))
                columns += [angle, np.pi - angle]
            else:
                angle = np.arccos(np.clip(level / (cycle.omega * cycle.X), -1, 1))
                columns += [angle, np.where(angle > np.pi / 2, 2 * np.pi - angle, -angle)]
    if not columns:
        return np.empty((len(cycle.X), 0))
    stacked = np.stack(np.broadcast_arrays(*columns, cycle.X)[:-1], axis=-1)
    return np.where(np.isfinite(stacked), stacked, -np.pi / 2)


CYCLE_SAMPLES = 193
"""Samples of a cycle between which sign changes of a general switch function are sought. A function that dips
through zero and back between two of them is left to the halving of intervals."""


def _crossings(function: sympy.Expr, parameters: tuple[sympy.Symbol, ...], cycle: Cycle) -> list[Array]:
    """Find where a switch function of x and v changes its sign, by sampling and bisection."""
    evaluate = compiled((function,), (symbol("x"), symbol("v"), *parameters))

    def along(phi: Array, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        some = _some(cycle, rows)
        x = some.mean[:, None] + some.X[:, None] * np.sin(phi)
        v = (some.omega * some.X)[:, None] * np.cos(phi)
        (value,) = evaluate(x, v, *(p[:, None] for p in some.parameters))
        return np.greater(np.broadcast_to(value, phi.shape), 0)

    count = len(cycle.X)
    phi = np.broadcast_to(np.linspace(-np.pi / 2, 3 * np.pi / 2, CYCLE_SAMPLES), (count, CYCLE_SAMPLES))
    on = along(phi, np.arange(count))
    rows, columns = np.nonzero(on[:, 1:] != on[:, :-1])
    low, high, side = phi[rows, columns], phi[rows, columns + 1], on[rows, columns]
    for _ in range(52):
        middle = (low + high) / 2
        same = along(middle[:, None], rows)[:, 0] == side
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    place = np.arange(len(rows)) - np.searchsorted(rows, rows)
    angles = np.full((int(place.max(initial=-1)) + 1, count), -np.pi / 2)
    angles[place, rows] = high
    return list(angles)


CYCLES_PER_BLOCK = 8192


def project(force: sympy.Expr, parameters: tuple[sympy.Symbol, ...], cycle: Cycle) -> Projections:
    """Integrate a law over cycles; a cycle on which it is not finite gets nan.

    Parameters
    ----------
    force
        The law as it is written; its normal form is used only to split the cycles.
    parameters
        Symbols of the law other than x and v, in the order of ``cycle.parameters``.
    cycle
        The cycles; all arrays (n,).
    """
    parts = [
        _project(force, parameters, _some(cycle, rows)) for rows in blocks(len(cycle.X), CYCLES_PER_BLOCK)
    ]
    return Projections(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _some(cycle: Cycle, rows: slice | NDArray[np.intp]) -> Cycle:
    return Cycle(cycle.X[rows], cycle.mean[rows], cycle.omega[rows], tuple(p[rows] for p in cycle.parameters))


def has_real_powers(force: sympy.Expr) -> bool:
    """Decide whether the law has real powers, which need nodes that crowd at the ends of intervals."""
    return any(not power.exp.is_Integer for power in force.atoms(sympy.Pow) if power.base is not sympy.E)


def _intervals(angles: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Cut every cycle at its angles, from -pi/2 to 3 pi/2: row, start, stop of each interval."""
    # a whole cycle without switches is too long for 21 nodes
    quarters = np.broadcast_to(np.linspace(-0.5, 1.5, 5) * np.pi, (len(angles), 5))
    cuts = np.sort(np.concatenate([quarters, angles], axis=1), axis=1)
    rows, columns = np.nonzero(np.diff(cuts, axis=1) > 1e-15)
    return rows, cuts[rows, columns], cuts[rows, columns + 1]


def _integrals(
    law: Numeric,
    cycle: Cycle,
    rows: NDArray[np.intp],
    ends: tuple[Array, Array],
    part: tuple[Array, Array],
    crowded: bool,
) -> tuple[Array, Array]:
    """Integrate over parts of intervals of the phase.

    Parameters
    ----------
    rows
        (k,) the cycle of each interval.
    ends
        (k,) phases where the intervals start and stop.
    part
        (k,) shares of an interval between which is integrated.
    crowded
        Whether nodes crowd at the ends of the intervals.

    Returns
    -------
    tuple
        (4, k) integrals of n sin, n cos, n and |n|, and (k,) the largest error of the first three.
    """
    (start, stop), (low, high) = ends, part
    local = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * _POINTS
    width = ((high - low) / 2 * (stop - start))[:, None]
    if crowded:
        share, slope = local**3 * (10 - 15 * local + 6 * local**2), 30 * local**2 * (1 - local) ** 2
    else:
        share, slope = local, np.ones_like(local)
    phi = start[:, None] + (stop - start)[:, None] * share
    sine, cosine = np.sin(phi), np.cos(phi)
    some = _some(cycle, rows)
    x = some.mean[:, None] + some.X[:, None] * sine
    v = (some.omega * some.X)[:, None] * cosine
    (value,) = law(x, v, *(p[:, None] for p in some.parameters))
    with np.errstate(all="ignore"):
        weighted = np.broadcast_to(value, phi.shape) * slope * width
        parts = np.stack((weighted * sine, weighted * cosine, weighted, np.abs(weighted)))
        fine = parts @ _WEIGHTS
        difference = np.abs(fine[:3] - parts[:3] @ _COARSE).max(axis=0)
        # the difference of the two rules overestimates the error; the formula is that of QUADPACK
        return fine, np.minimum(difference, fine[3] * (200 * difference / fine[3]) ** 1.5)


RELATIVE_TOLERANCE = 1e-13
"""Error allowed in a cycle, relative to the integral of the absolute force."""

MAX_HALVINGS = 40
MAX_OPEN_INTERVALS = 64
"""Largest number of inaccurate intervals of one cycle; more are round-off near a pole."""

MAX_RELATIVE_ERROR = 1e-7
"""Error, relative to the integral of the absolute force, beyond which a cycle has no value."""


def _project(force: sympy.Expr, parameters: tuple[sympy.Symbol, ...], cycle: Cycle) -> Projections:
    """Project a law on cycles: every interval between switching angles is halved until it is accurate."""
    n = len(cycle.X)
    law = compiled((force,), (symbol("x"), symbol("v"), *parameters))
    crowded = has_real_powers(force)
    rows, start, stop = _intervals(switching_angles(normal_form(force), parameters, cycle))
    # the parts of these intervals that are still inaccurate, as shares of them
    low, high = np.zeros(len(rows)), np.ones(len(rows))
    sums, errors = np.zeros((4, n)), np.zeros(n)
    size = np.zeros(n)
    infinite = np.zeros(n, dtype=bool)
    for depth in range(MAX_HALVINGS + 1):
        if not len(rows):
            break
        fine, error = _integrals(law, cycle, rows, (start, stop), (low, high), crowded)
        with np.errstate(all="ignore"):
            overflow = ~np.isfinite(fine[3])
            infinite[rows[overflow]] = True
            if depth == 0:
                size += np.bincount(rows, np.where(overflow, 0, fine[3]), n)
            length = (high - low) * (stop - start) / (2 * np.pi)
            allowed = np.maximum(RELATIVE_TOLERANCE * size[rows] * np.maximum(length, 0.05), 4e-15 * fine[3])
            done = (error <= allowed) | ~np.isfinite(error) | infinite[rows]
        if depth > 0:
            done |= np.bincount(rows[~done], minlength=n)[rows] > MAX_OPEN_INTERVALS
        if depth == MAX_HALVINGS:
            done[:] = True
        for total, part in zip(sums, fine, strict=True):
            total += np.bincount(rows[done], part[done], n)
        errors += np.bincount(rows[done], np.nan_to_num(error[done]), n)
        again = np.flatnonzero(~done)
        middle = (low[again] + high[again]) / 2
        low, high = np.concatenate((low[again], middle)), np.concatenate((middle, high[again]))
        rows = np.tile(rows[again], 2)
        start, stop = np.tile(start[again], 2), np.tile(stop[again], 2)
    infinite |= errors > MAX_RELATIVE_ERROR * sums[3]
    # a law of x (of v) alone is symmetric about phi = pi/2 (phi = 0)
    if not force.has(symbol("v")):
        sums[1] = 0.0
    if not force.has(symbol("x")):
        sums[0] = 0.0
    sums[:, infinite] = np.nan
    return Projections(sums[0], sums[1], sums[2], sums[3], errors)


# ----------------------------------------------------------------------------
# The proof of a closed form: random cycles in all regimes, and quadrature of the law as it is written.

PROOF_TOLERANCE = 1e-10
"""Largest difference between a closed form and quadrature, relative to the mean absolute force."""

MIN_PROOF_CYCLES = 20
"""Smallest number of random cycles on which a law must be defined for its proof."""

PROOF_CYCLES_PER_REGIME = 12

_AMPLITUDE_FACTORS = (1.0, 0.3, 0.09, 0.0025)
"""Factors of the amplitudes, tried in turn: some laws are defined for small motions only."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Random cycles of a law, and the projections of the law as it is written, by quadrature.

    ``reference`` are stiffness, damping and mean force; ``size`` the mean absolute force in the same units.
    """

    cycle: Cycle
    reference: list[Array]
    size: list[Array]


def _thresholds(form: NormalForm, parameters: tuple[sympy.Symbol, ...], cycle: Cycle) -> Array:
    """Return (n, t) amplitudes at which switches start to act, in ascending order."""
    columns = []
    for switch in form.switches:
        if switch.threshold is None or switch.threshold.is_zero:
            continue
        (level,) = compiled((switch.threshold,), parameters)(*cycle.parameters)
        columns.append(np.abs(level - cycle.mean) if switch.variable == "x" else np.abs(level) / cycle.omega)
    if not columns:
        return np.empty((len(cycle.X), 0))
    return np.sort(np.stack(np.broadcast_arrays(*columns, cycle.X)[:-1], axis=-1), axis=1)


def between_thresholds(
    rng: np.random.Generator, edges: Array, amplitude: Array, factor: float = 1.0
) -> Array:
    """Draw amplitudes (n,) in every regime in turn, between neighbouring thresholds ``edges`` (n, t).

    Where two thresholds coincide, or are infinite, the given ``amplitude`` (n,) stays. ``factor`` multiplies
    the others.
    """
    if not edges.shape[1]:
        return amplitude
    edges = np.concatenate((0.2 * edges[:, :1], edges, 3 * edges[:, -1:]), axis=1)
    rows = np.arange(len(edges))
    slot = rows % (edges.shape[1] - 1)
    low, high = edges[rows, slot], edges[rows, slot + 1]
    with np.errstate(invalid="ignore"):
        drawn = (low + (high - low) * rng.uniform(0.05, 0.95, len(edges))) * factor
        return np.where(high - low > 1e-6 * high, drawn, amplitude)


def draw_trial(force: sympy.Expr, parameters: tuple[sympy.Symbol, ...], centred: bool, seed: int) -> Trial:
    """Draw parameters of sizes around one, and amplitudes between all thresholds in turn.

    Parameters known as positive to SymPy are drawn positive, others of either sign. Cycles on which the law
    is not defined are dropped; if fewer than ``MIN_PROOF_CYCLES`` remain, smaller amplitudes are tried.
    """
    rng, form = np.random.default_rng(seed), normal_form(force)
    slots = 1 + sum(s.threshold is not None and not s.threshold.is_zero for s in form.switches)
    n = max(2 * MIN_PROOF_CYCLES, PROOF_CYCLES_PER_REGIME * slots)
    for factor in _AMPLITUDE_FACTORS:
        sizes = tuple(
            np.exp(rng.uniform(-1, 1, n)) * (1 if p.is_positive else rng.choice((-1.0, 1.0), n))
            for p in parameters
        )
        omega = np.exp(rng.uniform(-1, 1, n))
        amplitude = np.exp(rng.uniform(-1.2, 1.2, n)) * factor
        mean = np.zeros(n) if centred else rng.normal(0, 0.5, n) * amplitude
        cycle = Cycle(amplitude, mean, omega, sizes)
        edges = _thresholds(form, parameters, cycle)
        cycle = cycle._replace(X=between_thresholds(rng, edges, amplitude, factor**0.5))
        projections = project(force, parameters, cycle)
        valid = np.isfinite(projections.size) & (projections.error <= 1e-11 * projections.size)
        if np.count_nonzero(valid) >= MIN_PROOF_CYCLES:
            break
    rows = np.flatnonzero(valid)
    cycle = _some(cycle, rows)
    found = Projections(*(column[rows] for column in projections))
    sizes = Projections(*[found.size] * len(found))
    with np.errstate(over="ignore"):
        return Trial(cycle, found.harmonics(cycle), sizes.harmonics(cycle))


def worst_error(trial: Trial, values: Sequence[Array]) -> float:
    """Return the largest error of stiffness, damping and mean force, relative to the mean absolute force."""
    worst = 0.0
    for value, reference, size in zip(values, trial.reference, trial.size, strict=True):
        with np.errstate(all="ignore"):
            error = np.abs(value - reference) / np.maximum(size, 1e-300)
        # where no switch is on there is no force: both must be zero
        error = np.where(size > 1e-200, error, np.abs(value))
        worst = max(worst, float(np.max(np.where(np.isfinite(error), error, np.inf), initial=0.0)))
    return worst
