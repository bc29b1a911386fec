"""The describing function of a law: formulas, values, derivatives, and formulas of a source against them.

    n(x, v) ~ k x + c v  on  x = X0 + X sin(phi), v = omega X cos(phi),
    k = 1/(pi X) integral n sin(phi) dphi,  c = 1/(pi omega X) integral n cos(phi) dphi,  integral n dphi = 0

k and c are those of least mean square error over a cycle; the last equation gives the mean X0 (A. Gelb and
W. E. Vander Velde, Multiple-Input Describing Functions, 1968, Ch. 2). Values are the sum of the closed part,
evaluated by its formulas, of quadrature of what has none, and of terms with memory. A formula printed in a
source is compared at many amplitudes, since two forms of one function need not look alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.text_table import Brief
from rsgen.describing.closed import MAX_TERMS, ClosedPart
from rsgen.describing.quadrature import Cycle, project
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, PHI, STATE_V, STATE_X, X0, X, symbol
from rsgen.formula.units import number_text
from rsgen.law.memory import equations_of
from rsgen.law.normal_form import normal_form
from rsgen.law.notation import latex

MAX_RELATIVE_ERROR = 1e-9
"""Error of a result, relative to the mean absolute force, beyond which it is not known; a switch function
smaller than this share of its range has no known sign."""


def variables_of(formula: sympy.Expr) -> tuple[sympy.Symbol, ...]:
    """List the variables on which a describing function depends: X always, X0 and omega where they occur.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> variables_of(parse("c + 4*Ff/(pi*omega*X)"))
    (X, omega)
    """
    return (symbol("X"), *(s for s in (symbol("X0"), symbol("omega")) if formula.has(s)))


class Equivalent(NamedTuple):
    """Equivalent stiffness [N/m], damping [N s/m] and mean [m]; arrays of the broadcast shape of X and omega.

    Where a law is not defined on the whole cycle, or no mean balances it, the values are nan.
    """

    stiffness: Array
    damping: Array
    mean: Array


class Remembered(Protocol):
    """A part of a law with memory, which adds to a describing function."""

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Return stiffness [N/m], damping [N s/m] and mean force [N] of cycles; arrays (n,)."""

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Return the force [N] at ascending phases (s,) from -pi/2 to 3 pi/2 of one cycle."""


def taken_as_positive(names: Sequence[str]) -> tuple[str, ...]:
    """Return a remark on the parameters that formulas take as positive; none without such parameters."""
    remark = f"The formulas take {', '.join(names)} as positive; numbers are computed for either sign."
    return (remark,) if names else ()


def integrals_of(force: sympy.Expr, mean: sympy.Expr) -> list[sympy.Expr]:
    """Write stiffness, damping and mean force of f(x, v) on x = mean + X sin(phi) as integrals over phi."""
    along = force.xreplace({STATE_X: mean + X * sympy.sin(PHI), STATE_V: OMEGA * X * sympy.cos(PHI)})
    weights = (sympy.sin(PHI) / (sympy.pi * X), sympy.cos(PHI) / (sympy.pi * OMEGA * X), 1 / (2 * sympy.pi))
    parts = [(along * weight).as_independent(PHI, as_Add=False) for weight in weights]
    return [outside * sympy.Integral(inside, (PHI, 0, 2 * sympy.pi)) for outside, inside in parts]


def _scaled(formula: sympy.Expr, factor: sympy.Expr) -> sympy.Expr:
    """Multiply a sum, or every case of it, addend by addend."""
    if isinstance(formula, sympy.Piecewise):
        return sympy.Piecewise(*((_scaled(value, factor), condition) for value, condition in formula.args))
    if formula.is_Add:
        return sympy.Add(*(_scaled(addend, factor) for addend in formula.args))
    scaled = sympy.powsimp(formula * factor)
    integrals = [part for part in sympy.Mul.make_args(scaled) if isinstance(part, sympy.Integral)]
    if len(integrals) == 1:
        # a factor behind an integral would read as a part of it
        front = scaled / integrals[0]
        scaled = sympy.Integral(front * integrals[0].function, *integrals[0].limits)
    return scaled


@dataclass(frozen=True, slots=True, repr=False)
class DescribingFunction(Brief):
    """First-harmonic equivalents of a law on x = X0 + X sin(phi), v = omega X cos(phi).

    Parameters
    ----------
    force
        The law n(x, v) [N].
    parameters
        Names of its parameters, sorted.
    stiffness, damping
        k = 1/(pi X) integral n sin(phi) dphi [N/m] and c = 1/(pi omega X) integral n cos(phi) dphi [N s/m]
        (Liu et al., Eqs. (4), (5)), in X, X0, omega and the parameters. Without X0 where the mean is zero.
        Parts without a closed form stand as a sympy Integral over phi.
    mean_balance
        The mean force 1/(2 pi) integral n dphi [N]; it is zero in a steady state and so gives X0.
    mean
        X0 [m] as a formula in X (zero for a law that pushes both ways alike), or None where it is a number
        that ``evaluate`` finds.
    closed_form
        Whether stiffness, damping and mean balance are all free of integrals.
    checked_to
        Largest difference between the formulas and quadrature of the law as written, relative to the mean
        absolute force, over random parameters in all regimes; None where nothing has a closed form. Loops
        of states are held against some that are stepped through time.
    regimes
        The conditions of the cases of stiffness and damping; empty where one formula holds for all X.
    remarks
        Sentences on the mean, on what is not closed, on what the formulas take for granted.
    positive
        Names of parameters that the formulas take as positive; ``evaluate`` does not.
    closed
        The closed part in the form that is evaluated; None where there is none.
    remainder
        The part of the law that is evaluated by quadrature, zero where all is closed.
    plain
        That of the part without memory, of a law with memory; None where nothing remembers.
    remembered
        What each memory adds to it.
    """

    force: sympy.Expr
    parameters: tuple[str, ...]
    stiffness: sympy.Expr
    damping: sympy.Expr
    mean_balance: sympy.Expr
    mean: sympy.Expr | None
    closed_form: bool
    checked_to: float | None
    regimes: tuple[sympy.Basic, ...]
    remarks: tuple[str, ...]
    positive: tuple[str, ...]
    closed: ClosedPart | None = field(repr=False)
    remainder: sympy.Expr = field(repr=False)
    plain: DescribingFunction | None = field(repr=False, default=None)
    remembered: tuple[Remembered, ...] = field(repr=False, default=())

    @property
    def memory(self) -> dict[str, str]:
        """g of z' = g(x, v, z) for every state z of the law, as text."""
        return equations_of(self.force)

    @property
    def energy(self) -> sympy.Expr:
        """D(X) = pi omega X**2 c, the energy [J] that a cycle dissipates."""
        return _scaled(self.damping, sympy.pi * symbol("omega") * symbol("X") ** 2)

    @property
    def proof(self) -> str:
        """How the formulas were proved, and to which relative deviation, as a part of a sentence."""
        to = "" if self.checked_to is None else f"to {number_text(self.checked_to, 2)}"
        numeric = "the integral is evaluated by quadrature, split at the switching angles"
        if self.memory:
            compared = "not all was compared with quadrature or with loops stepped through time"
            if to:
                compared = f"all agrees with quadrature, and with loops stepped through time, {to}"
            return f"the loop is solved until it closes, at all samples of a cycle; {compared}"
        if self.closed_form:
            return f"the closed form agrees with an independent quadrature {to or 'to 0'}"
        if to:
            return f"the closed part agrees with an independent quadrature {to}; {numeric}"
        return f"no closed form is used; {numeric}"

    def evaluate(
        self,
        X: ArrayLike,
        omega: ArrayLike,
        values: Mapping[str, float],
        mean: ArrayLike | None = None,
        *,
        closing: bool = True,
    ) -> Equivalent:
        """Compute equivalent stiffness and damping for amplitudes and frequencies.

        They are those of a sine, about ``mean``; a modal table is of the motion of the test, with harmonics.

        Parameters
        ----------
        X
            Amplitudes of the fundamental [m], positive.
        omega
            Angular frequencies [rad/s], positive; broadcast against X.
        values
            A value in SI units for each parameter, of either sign.
        mean
            X0 [m]; None finds the mean that balances the force, on the branch next to rest.
        closing
            False: NaN where the loop of a state does not close, in place of an error.

        Raises
        ------
        RsgenError
            A value is missing or unknown, an amplitude or frequency not positive, or the loop of a state
            does not close.

        Examples
        --------
        >>> from rsgen.describing.derivation import derive
        >>> derive("k*x + k3*x**3").evaluate([1.0, 2.0], 1.0, {"k": 1.0, "k3": 4.0}).stiffness
        array([ 4., 13.])
        """
        sizes, speeds = np.asarray(X, dtype=np.float64), np.asarray(omega, dtype=np.float64)
        shape = np.broadcast_shapes(sizes.shape, speeds.shape, () if mean is None else np.shape(mean))
        if not (np.all(sizes > 0) and np.all(speeds > 0)):
            raise RsgenError("describing function: X and omega must be positive")
        numbers = self._numbers(values)
        flat = np.broadcast_to(sizes, shape).ravel(), np.broadcast_to(speeds, shape).ravel()
        if mean is not None:
            means = np.broadcast_to(np.asarray(mean, dtype=np.float64), shape).ravel()
        elif self.mean == 0:
            means = np.zeros(flat[0].shape)
        else:
            means = self._balanced(*flat, numbers)
        known = np.isfinite(means)
        stiffness, damping, _ = self.harmonics(flat[0], np.where(known, means, 0.0), flat[1], numbers)
        failed = np.flatnonzero(known & np.isnan(stiffness + damping))
        if closing and self.memory and len(failed):
            raise self._loop_fault(values, *(float(part[failed[0]]) for part in (*flat, means)))
        stiffness, damping = (
            np.where(known, part, np.nan) if formula.has(symbol("X0")) else part
            for part, formula in ((stiffness, self.stiffness), (damping, self.damping))
        )
        return Equivalent(stiffness.reshape(shape), damping.reshape(shape), means.reshape(shape))

    def harmonics(self, X: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Return stiffness, damping and mean force at given means; (n,), parameters (n,) or scalars."""
        if self.plain is not None:
            total = self.plain.harmonics(X, mean, omega, values)
            for part in self.remembered:
                added = part.harmonics(X, mean, omega, values)
                total = [sum_ + term for sum_, term in zip(total, added, strict=True)]
            return total
        closed, remainder = self.closed, self.remainder
        as_assumed = all(np.all(values[name] > 0) for name in self.positive)
        centred = closed is not None and closed.mean == 0
        if not as_assumed or (centred and np.any(mean)):
            closed, remainder = None, self.force
        total = [np.zeros(X.shape) for _ in range(3)]
        if closed is not None:
            # in the closed part some symbols are known as positive
            places = {name: sympy.Symbol(name, positive=True) for name in self.positive}
            named = {places.get(name, symbol(name)): value for name, value in values.items()}
            total = [np.array(part) for part in closed.evaluate(X, mean, omega, named)]
        if remainder != 0:
            symbols = tuple(symbol(name) for name in self.parameters)
            fields = tuple(np.broadcast_to(values[name], X.shape) for name in self.parameters)
            cycle = Cycle(X, mean, omega, fields)
            added = project(remainder, symbols, cycle).harmonics(cycle)
            total = [sum_ + term for sum_, term in zip(total, added, strict=True)]
        return total

    def along(
        self, phi: Array, X: float, omega: float, values: Mapping[str, float], mean: float = 0.0
    ) -> Array:
        """Return the force along the closed loop of one cycle.

        Parameters
        ----------
        phi
            (s,) ascending phases [rad] between -pi/2 and 3 pi/2; x = mean + X sin(phi).
        X, omega, mean
            Amplitude [m], angular frequency [rad/s], mean [m].
        values
            A value in SI units for each parameter.

        Returns
        -------
        (s,) force [N]; nan where the loop does not close.
        """
        force = self.force if self.plain is None else self.plain.force
        names = (symbol("x"), symbol("v"), *map(symbol, self.parameters))
        numbers = (values[name] for name in self.parameters)
        (total,) = compiled((force,), names)(mean + X * np.sin(phi), omega * X * np.cos(phi), *numbers)
        added = (part.along(phi, X, mean, omega, values) for part in self.remembered)
        return np.asarray(np.broadcast_to(total, phi.shape) + sum(added, np.zeros(phi.shape)))

    def _loop_fault(self, values: Mapping[str, float], X: float, omega: float, mean: float) -> RsgenError:
        """Return the reason for which the loop of the states has no describing function."""
        closes = np.isfinite(self.along(np.zeros(1), X, omega, values, mean)).all()
        fact, reason = (
            ("is not known to three digits", "changes much faster than the motion")
            if closes
            else ("does not close", "grows or drifts for ever, or is not found")
        )
        return RsgenError(
            f"memory: the loop of {', '.join(self.memory)} {fact} at X = {X:.4g} m, "
            f"omega = {omega:.4g} rad/s: under this sine it {reason}"
        )

    def _numbers(self, values: Mapping[str, float]) -> dict[str, Array]:
        missing = [name for name in self.parameters if name not in values]
        unknown = sorted(set(values) - set(self.parameters))
        if missing or unknown:
            raise RsgenError(
                f"describing function: missing {', '.join(missing) or 'none'}; unknown "
                f"{', '.join(unknown) or 'none'}; the law has {', '.join(self.parameters) or 'no parameters'}"
            )
        return {name: np.asarray(values[name], dtype=np.float64) for name in self.parameters}

    def _balanced(self, X: Array, omega: Array, values: Mapping[str, Array]) -> Array:
        """Find the mean of each cycle; one scan for each distinct pair of amplitude and frequency."""
        pairs = np.stack((X, omega if self.mean_balance.has(symbol("omega")) else np.ones_like(X)))
        unique, inverse = np.unique(pairs, axis=1, return_inverse=True)

        def force(means: Array, rows: NDArray[np.intp]) -> Array:
            return self.harmonics(unique[0, rows], means, unique[1, rows], values)[2]

        zero = np.zeros(unique.shape[1])
        parts = self.harmonics(unique[0], zero, unique[1], values)
        size = np.abs(parts[0]) + np.abs(parts[1]) * unique[1] + np.abs(parts[2]) / unique[0]
        flat = any(s.variable == "x" for s in normal_form(self.force).switches)
        return solve_mean(force, unique[0], size, flat)[inverse.ravel()]

    def _repr_latex_(self) -> str:
        """Show the formulas in a notebook."""
        rows = [
            f"{name}({', '.join(map(latex, variables_of(formula)))}) &= {latex(formula)}"
            for name, formula in (("k", self.stiffness), ("c", self.damping))
        ]
        if self.mean != 0:
            rows.append(rf"0 &= {latex(self.mean_balance)}")
        return r"$\displaystyle \begin{aligned} " + r" \\ ".join(rows) + r" \end{aligned}$"


QUANTITIES = ("stiffness", "damping")


@dataclass(frozen=True, slots=True)
class PrintedComparison:
    """One printed formula held against the derived one.

    Parameters
    ----------
    what
        "stiffness" or "damping".
    formula
        The printed formula.
    largest_deviation
        Largest \\|printed - derived\\| / \\|derived\\| [1] over the amplitudes compared.
    amplitude
        The amplitude of the largest deviation [m].
    """

    what: str
    formula: sympy.Expr
    largest_deviation: float
    amplitude: float

    @property
    def agrees(self) -> bool:
        """True if both formulas have the same values."""
        return self.largest_deviation <= MAX_RELATIVE_ERROR


def compare_printed(
    derived: DescribingFunction,
    printed: Mapping[str, sympy.Expr],
    values: Mapping[str, float],
    X: ArrayLike,
    omega: float = 1.0,
) -> tuple[PrintedComparison, ...]:
    """Compare printed formulas with the derived ones in numbers.

    A printed formula without X0 is compared with the derived one at the mean that balances the law, so that
    a formula about zero mean shows how much it is biased.

    Parameters
    ----------
    derived
        Describing function of the whole force.
    printed
        "stiffness", "damping" or both, in X, omega and the parameters of the law.
    values
        Parameters in SI units at which to compare.
    X
        (n,) amplitudes [m] at which to compare.
    omega
        Angular frequency [rad/s].

    Raises
    ------
    RsgenError
        A quantity other than stiffness and damping, or a name in a formula that the law does not have.
    """
    amplitude = np.atleast_1d(np.asarray(X, dtype=np.float64))
    found = derived.evaluate(amplitude, omega, values)
    names = ("X", "X0", "omega", *derived.parameters)
    results = []
    for what, formula in printed.items():
        if what not in QUANTITIES:
            raise RsgenError(f"printed.{what}: unknown; printed formulas are {' and '.join(QUANTITIES)}")
        unknown = sorted({s.name for s in formula.free_symbols} - set(names))
        if unknown:
            raise RsgenError(
                f"printed.{what}: {', '.join(unknown)}: not in the law; known: {', '.join(sorted(names))}"
            )
        exact = found.stiffness if what == "stiffness" else found.damping
        ordered = (values[name] for name in derived.parameters)
        (shown,) = compiled((formula,), tuple(map(symbol, names)))(
            amplitude, np.nan_to_num(found.mean), omega, *ordered
        )
        with np.errstate(all="ignore"):
            # where the derived value is round-off of the others, so is a difference from it
            deviation = np.abs(shown - exact) / np.maximum(
                np.abs(exact), MAX_RELATIVE_ERROR * np.nanmax(np.abs(exact))
            )
        # 0/0: both are zero at all amplitudes
        deviation = np.where(np.isfinite(exact), np.where(np.isnan(deviation), 0.0, deviation), -1.0)
        place = int(np.argmax(deviation))
        results.append(PrintedComparison(what, formula, float(deviation[place]), float(amplitude[place])))
    return tuple(results)


# ----------------------------------------------------------------------------
# The mean X0 of the motion, in closed form or as a number.
#
# It solves the mean balance integral n(X0 + X sin(phi), omega X cos(phi)) dphi = 0. Some laws have several
# roots; the one nearest to rest at which the mean force rises is returned, since a structure reaches it from
# rest. It is bracketed by a scan of means up to 64 amplitudes and bisected, for all cycles at once.

Balance = Callable[[Array, NDArray[np.intp]], Array]
"""Mean force at trial means (m,) for the cycles with these numbers (m,)."""

SCAN = np.concatenate((-np.geomspace(64, 1e-3, 24), [0.0], np.geomspace(1e-3, 64, 24)))
"""Trial means, in multiples of the amplitude; the change of sign nearest to rest counts."""


def closed_mean(balance: sympy.Expr) -> sympy.Expr | None:
    """Solve a mean balance that is linear or quadratic in X0 and has no cases.

    Of the two roots of a quadratic the one is returned that vanishes with the constant part, if the linear
    stiffness is positive.
    """
    # SymPy sorts all terms of a polynomial first
    if not balance.has(X0) or len(sympy.Add.make_args(balance)) > MAX_TERMS:
        return None
    if balance.has(sympy.Piecewise, sympy.Integral) or not balance.is_polynomial(X0):
        return None
    coefficients = sympy.Poly(balance, X0).all_coeffs()
    if len(coefficients) == 2:
        slope, constant = coefficients
        return sympy.factor_terms(sympy.expand(-constant / slope))
    if len(coefficients) == 3:
        curvature, slope, constant = coefficients
        if slope.is_zero:
            return None
        return (-slope + sympy.sqrt(slope**2 - 4 * curvature * constant)) / (2 * curvature)
    return None


def solve_mean(balance: Balance, X: Array, stiffness: Array, flat: bool) -> Array:
    """Find the mean of every cycle, nearest to rest, at which the mean force rises through zero.

    Parameters
    ----------
    balance
        Mean force for trial means; rising with the mean where the structure is stable.
    X
        (n,) amplitudes [m].
    stiffness
        (n,) stiffness of the order of the law [N/m]: mean forces below 1e-14 of it times X are zero.
    flat
        The mean force may vanish on a range of means, as in a gap; the end of the range that is nearest to
        rest is then the mean.

    Returns
    -------
    (n,) means [m]; nan where the mean force does not pass through zero.
    """
    tiny = 1e-14 * np.abs(stiffness) * X
    at_rest = balance(np.zeros(len(X)), np.arange(len(X)))
    result = np.where(np.abs(at_rest) <= tiny, 0.0, np.nan)
    rows = np.flatnonzero(np.isnan(result) & np.isfinite(at_rest))
    if not len(rows):
        return result
    trials = SCAN * X[rows, None]
    forces = balance(trials.ravel(), np.repeat(rows, len(SCAN))).reshape(trials.shape)
    zeroed = np.where(np.abs(forces) <= tiny[rows, None], 0.0, forces)
    low, high, found = _nearest_rise(trials, zeroed, flat)
    rows = rows[found]
    result[rows] = _bisected(balance, rows, low[found], high[found], tiny[rows])
    return result


def _nearest_rise(trials: Array, forces: Array, flat: bool) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Find the interval nearest to zero on which the force rises through zero (or reaches it)."""
    lower, upper = forces[:, :-1], forces[:, 1:]
    with np.errstate(invalid="ignore"):
        rising = (lower < 0) & (upper > 0)
        if flat:
            rising |= ((lower < 0) & (upper == 0)) | ((lower == 0) & (upper > 0))
    distance = np.where(rising, np.abs(trials[:, :-1] + trials[:, 1:]), np.inf)
    place = np.argmin(distance, axis=1)
    rows = np.arange(len(trials))
    return trials[rows, place], trials[rows, place + 1], rising[rows, place]


_HALVINGS = 54
"""Of a bracket: to round-off."""


def _bisected(balance: Balance, rows: NDArray[np.intp], low: Array, high: Array, tiny: Array) -> Array:
    """Bisect each bracket; where the force is zero at one end, for the end of the range without force."""
    from_zero, to_zero = (np.abs(balance(end, rows)) <= tiny for end in (low, high))
    passed = np.select([from_zero, to_zero], [tiny, -tiny], 0.0)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        above = balance(middle, rows) > passed
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.where(to_zero, high, low)
