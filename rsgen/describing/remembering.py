"""Describing functions of laws with memory: the sum of those of its terms.

    k[n1 + n2] = k[n1] + k[n2],    c[n1 + n2] = c[n1] + c[n2]

The integrals of a describing function are linear in the force, so that the memoryless terms, every Masing law
or structural damping with a constant factor, and all other terms with memory are derived one by one and
added. Masing laws have closed forms (``masing``) if the integrals of their virgin curve have, else quadrature
of their branches; the other terms are projected along their loop, which closes the equations of the states at
all samples of a cycle (``rsgen.law.loops``). Its error is O(h^2) in the step h, so that the loops of 512 and
1024 samples give one of O(h^4) (Richardson extrapolation). Closed forms are proved by quadrature of the
branches, loops by an integration in time (LSODA).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
import sympy

from rsgen.common.arrays import Array, blocks
from rsgen.common.errors import ExpressionError
from rsgen.describing.function import DescribingFunction, Remembered, integrals_of, taken_as_positive
from rsgen.describing.masing import Branches, ClosedMasing, close_masing, decisive_in, loop_of, on_cycle
from rsgen.describing.quadrature import MIN_PROOF_CYCLES, PROOF_TOLERANCE, between_thresholds
from rsgen.describing.regimes import Reading
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, PHI, STATE_V, STATE_X, X0, Inner, Masing, State, X, symbol
from rsgen.law.character import is_mirrored
from rsgen.law.forms import expanded, moves
from rsgen.law.loops import compile_loops
from rsgen.law.memory import MemoryForm
from rsgen.law.motion import Motion, harmonics_of
from rsgen.law.notation import readable


@dataclass(frozen=True, slots=True)
class Parts:
    """A law with memory as a sum.

    Parameters
    ----------
    plain
        The terms without memory, in x and v.
    masing
        (factor, virgin curve) of Masing laws with a constant factor.
    lag
        Stiffness of structural damping [N/m].
    loop
        All other terms, in x, v and ``Inner`` symbols.
    memory
        The memories of the law.
    """

    plain: sympy.Expr
    masing: tuple[tuple[sympy.Expr, sympy.Expr], ...]
    lag: sympy.Expr
    loop: sympy.Expr
    memory: MemoryForm

    @property
    def centred(self) -> bool:
        """True if the force of ``loop`` has no mean about X0 = 0: it and the equations of states are odd."""
        expressions = (self.loop, *(rate.rate for rate in self.memory.rates)) if self.loop != 0 else ()
        moving = (STATE_X, STATE_V, *self.memory.states)
        others = sorted(set().union(*(e.free_symbols for e in expressions)) - set(moving), key=str)
        return all(is_mirrored(expression, moving, others, -1.0) for expression in expressions)


def split_by_memory(memory: MemoryForm) -> Parts:
    """Sort the addends of a law by the kind of their memory."""
    plain, loop = list[sympy.Expr](), list[sympy.Expr]()
    factors: dict[Inner, sympy.Expr] = {}
    linear = {*(curve.symbol for curve in memory.curves), memory.lag}
    for addend in sympy.Add.make_args(expanded(memory.force)):
        inside = [free for free in addend.free_symbols if isinstance(free, Inner)]
        if not inside:
            plain.append(addend)
            continue
        factor = addend.coeff(inside[0])
        if len(inside) == 1 and inside[0] in linear and not moves(factor) and addend == factor * inside[0]:
            factors[inside[0]] = factors.get(inside[0], sympy.S.Zero) + factor
        else:
            loop.append(addend)
    masing = tuple((factors[c.symbol], c.virgin) for c in memory.curves if c.symbol in factors)
    lag = sympy.S.Zero if memory.lag is None else factors.get(memory.lag, sympy.S.Zero)
    return Parts(sympy.Add(*plain), masing, lag, sympy.Add(*loop), memory)


@dataclass(frozen=True, slots=True)
class _Added:
    """The terms that one memory adds: formulas, numerical form, part by quadrature, error of the proof."""

    stiffness: sympy.Expr
    damping: sympy.Expr
    balance: sympy.Expr
    evaluated: Remembered
    conditions: tuple[sympy.Basic, ...] = ()
    remainder: sympy.Expr = sympy.S.Zero
    checked_to: float | None = None
    positive: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Formulas:
    """Closed formulas in plain symbols; quadrature where a parameter is not of the sign they take."""

    closed: ClosedMasing
    parameters: tuple[str, ...]
    positive: frozenset[str]
    branches: Branches

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Return stiffness [N/m], damping [N s/m] and mean force [N] of cycles; arrays (n,)."""
        if not all(np.all(values[name] > 0) for name in self.positive):
            return self.branches.harmonics(X_, mean, omega, values)
        names = tuple(map(symbol, self.parameters))
        numbers = tuple(values[name] for name in self.parameters)
        found = [np.array(part) for part in self.closed.evaluate(X_, omega, names, numbers)]
        return [*found, np.zeros(X_.shape)]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Return the force [N] at phases (s,) of one cycle."""
        return self.branches.along(phi, X_, mean, omega, values)


def add_memory(
    force: sympy.Expr, names: tuple[str, ...], parts: Parts, plain: DescribingFunction
) -> DescribingFunction:
    """Add the describing functions of the memories of a law to that of its memoryless part."""
    added = [_masing(factor, virgin) for factor, virgin in parts.masing]
    if parts.lag != 0:
        added.append(_structural(parts.lag))
    if parts.loop != 0:
        added.append(_loop(force, parts))
    positive = tuple(sorted({*plain.positive, *(name for part in added for name in part.positive)}))
    replaced = taken_as_positive(plain.positive)
    remarks = [*taken_as_positive(positive), *(r for r in plain.remarks if r not in replaced)]
    formulas = [
        sympy.Add(getattr(plain, what), *(getattr(part, short) for part in added))
        for what, short in (("stiffness", "stiffness"), ("damping", "damping"), ("mean_balance", "balance"))
    ]
    all_checks = [part.checked_to for part in added] + ([] if plain.force == 0 else [plain.checked_to])
    checks = [check for check in all_checks if check is not None]
    return replace(
        plain,
        force=force,
        parameters=names,
        stiffness=formulas[0],
        damping=formulas[1],
        mean_balance=formulas[2],
        mean=plain.mean if all(part.balance == 0 for part in added) else None,
        closed_form=not any(formula.has(sympy.Integral) for formula in formulas),
        checked_to=max(checks) if len(checks) == len(all_checks) else None,
        regimes=tuple(dict.fromkeys((*plain.regimes, *(c for part in added for c in part.conditions)))),
        remarks=(*remarks, *(remark for part in added for remark in part.remarks)),
        positive=positive,
        remainder=sympy.Add(plain.remainder, *(part.remainder for part in added)),
        plain=plain,
        remembered=tuple(part.evaluated for part in added),
    )


def _structural(stiffness: sympy.Expr) -> _Added:
    """Damping of h times the displacement a quarter of a period later: c = h/omega."""
    names = tuple(sorted(free.name for free in stiffness.free_symbols))
    closed = ClosedMasing(Reading(sympy.S.Zero, ()), Reading(stiffness / OMEGA, ()))
    branches = Branches(stiffness * STATE_V / OMEGA, names)
    error = _worst(closed, branches, {}, (), 5)
    evaluated = _Formulas(closed, names, frozenset(), branches)
    return _Added(*closed.shown, sympy.S.Zero, evaluated, checked_to=error)


def _masing(factor: sympy.Expr, virgin: sympy.Expr) -> _Added:
    """Add a Masing law in closed form, or as integrals of its virgin curve."""
    names = tuple(sorted(free.name for free in (factor * virgin).free_symbols - {STATE_X}))
    positive = frozenset(decisive_in(virgin))
    known = {symbol(name): sympy.Symbol(name, positive=True) for name in positive}
    plain = {after: before for before, after in known.items()}
    branches = Branches(factor * loop_of(virgin), names)
    closed = close_masing(virgin.xreplace(known), factor.xreplace(known))
    remark = f"No closed form is used for masing({readable(virgin)}); quadrature split at its switches."
    if closed is not None:
        levels = tuple(level.xreplace(plain) for level in closed.thresholds)
        closed = closed.xreplace(plain)
        exponents = {free.name for power in virgin.atoms(sympy.Pow) for free in power.exp.free_symbols}
        signs = dict.fromkeys(positive | exponents, 1.0)
        error = _worst(closed, branches, signs, levels, 6)
        if error <= PROOF_TOLERANCE:
            conditions = (*closed.stiffness.conditions, *closed.damping.conditions)
            evaluated = _Formulas(closed, names, positive, branches)
            return _Added(
                *closed.shown, sympy.S.Zero, evaluated, conditions, checked_to=error, positive=positive,
            )  # fmt: skip
        remark = (
            f"The closed form of masing({readable(virgin)}) differs from quadrature by {error:.1e}, more "
            f"than {PROOF_TOLERANCE:g}; it is not used."
        )
    half = sympy.sin(PHI / 2) ** 2
    along = sympy.Integral(virgin.xreplace({STATE_X: X * half}) * sympy.cos(PHI), (PHI, 0, sympy.pi))
    area = 8 * sympy.Integral(virgin, (STATE_X, 0, X)) - 4 * X * virgin.xreplace({STATE_X: X})
    return _Added(
        -4 * factor / (sympy.pi * X) * along, factor * area / (sympy.pi * OMEGA * X**2), sympy.S.Zero,
        branches, remainder=factor * Masing(virgin), remarks=(remark,),
    )  # fmt: skip


PROOF_CYCLES = 2 * MIN_PROOF_CYCLES
"""Random cycles of a proof: at least eight in every regime of five thresholds."""


def _worst(
    closed: ClosedMasing,
    branches: Branches,
    signs: Mapping[str, float],
    levels: tuple[sympy.Expr, ...],
    seed: int,
) -> float:
    """Compare formulas with quadrature of the loop, branch by branch, on random cycles in all regimes."""
    rng = np.random.default_rng(seed)
    names = tuple(map(symbol, branches.parameters))
    numbers: tuple[Array, ...] = ()
    for name in branches.parameters:
        sign = signs.get(name, rng.choice((-1.0, 1.0), PROOF_CYCLES))
        numbers = (*numbers, np.exp(rng.uniform(-1, 1, PROOF_CYCLES)) * sign)
    values = dict(zip(branches.parameters, numbers, strict=True))
    amplitude = np.exp(rng.uniform(-1.2, 1.2, PROOF_CYCLES))
    omega = np.exp(rng.uniform(-1, 1, PROOF_CYCLES))
    if levels:
        edges = np.broadcast_arrays(*compiled(levels, names)(*numbers), amplitude)[:-1]
        amplitude = between_thresholds(rng, np.sort(np.stack(edges, axis=1), axis=1), amplitude)
    found, cycle = branches.projected(amplitude, np.zeros(PROOF_CYCLES), omega, values)
    reference, size = found.harmonics(cycle), found.size / (np.pi * amplitude)
    stiffness, damping = closed.evaluate(amplitude, omega, names, numbers)
    with np.errstate(all="ignore"):
        errors = np.maximum(np.abs(stiffness - reference[0]), omega * np.abs(damping - reference[1]))
        # without any force there is nothing to compare with: both must be zero
        errors = np.where(size > 0, errors / size, errors)
    finite = np.isfinite(size)
    if np.count_nonzero(finite) < MIN_PROOF_CYCLES:
        return float(np.inf)
    return float(np.max(np.where(np.isfinite(errors[finite]), errors[finite], np.inf)))


LOOP_SAMPLES = 512
"""Samples of a cycle, and half of those of the finer loop."""
CYCLES_PER_BLOCK = 64
MAX_LOOP_CHANGE = 1e-3
"""Change of a loop by twice the samples, relative to the mean absolute force, beyond which it is not known;
the extrapolated loop is nearer."""


@dataclass(frozen=True, slots=True)
class _Loop:
    """A force f(x, v, z) along the closed loop of its states.

    Attributes
    ----------
    form
        The force, and the memories on which it depends.
    parameters
        Names in the order of their values.
    """

    form: MemoryForm
    parameters: tuple[str, ...]

    @classmethod
    def of(cls, force: sympy.Expr, memory: MemoryForm) -> _Loop:
        """Take the memories that occur in a force."""
        curves = tuple(curve for curve in memory.curves if force.has(curve.symbol))
        form = replace(memory, force=force, curves=curves, lag=memory.lag if force.has(memory.lag) else None)
        parts = (force, *(rate.rate for rate in form.rates), *(curve.virgin for curve in curves))
        free = set().union(*(part.free_symbols for part in parts)) - {STATE_X, STATE_V, *form.states}
        return cls(form, tuple(sorted(map(str, free))))

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Return stiffness [N/m], damping [N s/m] and mean force [N] of cycles; nan where no loop closes."""
        found = np.full((2, len(X_)), np.nan, dtype=complex)
        for rows in blocks(len(X_), CYCLES_PER_BLOCK):
            some = {name: np.broadcast_to(value, X_.shape)[rows] for name, value in values.items()}
            coarse, fine = (
                self.force(X_[rows], mean[rows], omega[rows], some, samples)
                for samples in (LOOP_SAMPLES, 2 * LOOP_SAMPLES)
            )
            after = harmonics_of(fine, 2).T
            change = after - harmonics_of(coarse, 2).T
            known = np.abs(change).max(axis=0) <= MAX_LOOP_CHANGE * np.abs(fine).mean(axis=1)
            found[:, rows] = np.where(known, after + change / 3, np.nan)
        # the displacement is Re -i X exp(i phi)
        dynamic = 1j * found[1] / X_
        return [dynamic.real, dynamic.imag / omega, found[0].real]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Return the force [N] at phases (s,) of one cycle."""
        numbers = {name: np.array([value]) for name, value in values.items()}
        cycle = (np.array([X_]), np.array([mean]), np.array([omega]))
        force = self.force(*cycle, numbers, 2 * LOOP_SAMPLES)[0]
        places = 2 * np.pi * np.arange(len(force)) / len(force)
        return np.asarray(np.interp(phi, places, force, period=2 * np.pi))

    def force(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array], samples: int) -> Array:
        """Return the force (n, s) [N] along cycles (n,)."""
        motion, numbers = self._along(X_, mean, omega, values)
        loops = compile_loops(self.form, self.parameters)
        return loops.sample(*motion.waveforms(samples), motion.interval(samples), numbers).force

    def states(self, X_: Array, omega: Array, values: Mapping[str, Array]) -> Array:
        """Return the states (q, n) at phase zero of cycles (n,) without mean."""
        motion, numbers = self._along(X_, np.zeros_like(X_), omega, values)
        loops = compile_loops(self.form, self.parameters)
        coarse, fine = (
            loops.states(motion.waveforms(samples), motion.interval(samples), numbers)[:, :, 0]
            for samples in (LOOP_SAMPLES, 2 * LOOP_SAMPLES)
        )
        return fine + (fine - coarse) / 3

    def _along(
        self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]
    ) -> tuple[Motion, Array]:
        motion = Motion(omega, np.stack([mean + 0j, -1j * X_], axis=1))
        return motion, np.array([values[name][:, None] for name in self.parameters])


TRIAL_CYCLES = 16
"""Random cycles of which at least one must close."""
STEPPED_CYCLES = 2
"""Random cycles that are compared with an integration in time."""
MAX_LSODA_STEPS = 20_000
STEPPED_TOLERANCE = 1e-4
"""Difference from the integration in time beyond which a remark says so; that of most is below 1e-5."""


def _try_loop(loop: _Loop, force: sympy.Expr) -> tuple[float | None, tuple[str, ...]]:
    """Compute loops at random values, and compare some of them with an integration in time.

    Parameters
    ----------
    loop
        The loop.
    force
        Its force with Masing laws as they are on a cycle, a function of x, v and the states.

    Returns
    -------
    tuple of a float or None and of texts
        The largest relative difference, None where none was compared; and remarks.

    Raises
    ------
    ExpressionError
        If no loop closes.
    """
    rng = np.random.default_rng(8)
    values = {name: np.exp(rng.uniform(-1, 1, TRIAL_CYCLES)) for name in loop.parameters}
    amplitude = np.exp(rng.uniform(-2, 1, TRIAL_CYCLES))
    omega = np.exp(rng.uniform(-1, 1, TRIAL_CYCLES))
    states = ", ".join(rate.symbol.name for rate in loop.form.rates)
    stiffness, damping, mean = loop.harmonics(amplitude, np.zeros(TRIAL_CYCLES), omega, values)
    begin = loop.states(amplitude, omega, values)
    if not np.isfinite(begin).all(axis=0).any():
        raise ExpressionError(
            f"memory: the loop of {states} does not close at X = {amplitude[0]:.3g} m or any of "
            f"{TRIAL_CYCLES} amplitudes tried with positive parameters: under a sine it grows or drifts for "
            "ever, or is not found"
        )
    closed = np.flatnonzero(np.isfinite(stiffness))
    if not len(closed):
        return None, (
            f"The loop closes, but wherever it was tried {states} changes so much faster than the "
            "motion that its force is not known: it was not compared with one stepped through time.",
        )
    worst = 0.0
    for row in closed[:STEPPED_CYCLES]:
        numbers = {name: float(value[row]) for name, value in values.items()}
        size, speed = float(amplitude[row]), float(omega[row])
        stepped = _stepped(loop, force, begin[:, row], size, speed, numbers)
        if stepped is None:
            return None, (
                "To follow the loop takes too many steps here: it was not compared with one stepped through "
                "time.",
            )
        dynamic, miss = stepped
        # the force of a constant state is a mean force alone
        scale = abs(dynamic) + abs(mean[row]) / size or 1.0
        worst = max(worst, miss, abs(stiffness[row] + 1j * speed * damping[row] - dynamic) / scale)
    remark = f"The loop differs from one stepped through time by {worst:.1e}: trust no more digits."
    return float(worst), (remark,) if worst > STEPPED_TOLERANCE else ()


def _stepped(
    loop: _Loop, force: sympy.Expr, begin: Array, X_: float, omega: float, values: Mapping[str, float]
) -> tuple[complex, float] | None:
    """Integrate the law as it is written over one cycle, from states (q,) at phase zero, by LSODA.

    Returns
    -------
    tuple of a complex number and a float, or None
        k + i omega c [N/m], and the distance of the states after the cycle from their start, relative to the
        largest of them; None where it takes too many steps.
    """
    numbers, size = tuple(values[name] for name in loop.parameters), len(begin)
    names = (STATE_X, STATE_V, *(rate.symbol for rate in loop.form.rates), X, X0, OMEGA)
    law = compiled((*(rate.rate for rate in loop.form.rates), force), (*names, *map(symbol, loop.parameters)))

    def slope(phi: float, state: Array) -> Array:
        sine, cosine = np.sin(phi), np.cos(phi)
        *rates, n = law(X_ * sine, omega * X_ * cosine, *state[:size], X_, 0.0, omega, *numbers)
        return np.array([*(rate / omega for rate in rates), n * sine, n * cosine])

    scale = float(np.max(np.abs(begin))) or 1.0
    run = scipy.integrate.LSODA(
        slope, 0.0, np.append(begin, (0.0, 0.0)), 2 * np.pi, max_step=0.2, rtol=1e-10, atol=1e-11 * scale
    )
    for _ in range(MAX_LSODA_STEPS):
        if run.status == "running":
            run.step()
    if run.status != "finished":
        return None
    miss = float(np.max(np.abs(run.y[:size] - begin))) / scale
    return complex(*run.y[size:]) / (np.pi * X_), miss


def _loop(force: sympy.Expr, parts: Parts) -> _Added:
    """Integrate terms along their loop: states with equations, and forces not linear in a memory."""
    memory, force_of_loop = parts.memory, parts.loop
    evaluated: Remembered
    error: float | None = None
    remarks: tuple[str, ...] = ()
    along = on_cycle(force_of_loop, memory)
    if any(isinstance(free, Inner) for free in along.free_symbols):
        loop = _Loop.of(force_of_loop, memory)
        (error, remarks), evaluated = _try_loop(loop, along), loop
    else:
        names = tuple(sorted({s.name for s in along.free_symbols} - {"x", "v", "X", "X0", "omega"}))
        evaluated = Branches(along, names)
    mean = sympy.S.Zero if parts.centred else X0
    states = {z: sympy.Function(z.name, real=True)(PHI) for z in memory.states}
    stiffness, damping, balance = integrals_of(force_of_loop.xreplace(states), mean)
    memories: dict[sympy.Expr, sympy.Expr] = {curve.symbol: Masing(curve.virgin) for curve in memory.curves}
    memories |= {Inner(state.name, real=True): state for state in force.atoms(State)}
    remainder = force_of_loop.xreplace(memories)
    remark = f"No closed form is used for {readable(remainder)}; its loop is computed and projected."
    return _Added(
        stiffness,
        damping,
        sympy.S.Zero if parts.centred else balance,
        evaluated,
        remainder=remainder,
        checked_to=error,
        remarks=(remark, *remarks),
    )
