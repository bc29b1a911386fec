"""The balance of every harmonic at known motions, in units of its noise: linear in mass and coefficients.

At a motion near the measured one the balance  g = m a + n(x, v) - f  changes by J (z - z0) with the measured
harmonics and force z. Its covariance is J S J' with S that of the measurement; divided by its root every row
has the same noise, whatever law is tried: the errors-in-variables step of Britt and Luecke, The estimation of
parameters in nonlinear, implicit models, Technometrics 15 (1973).

What the sensors see of other modes moves z; its values join the balance linearly, so that every candidate has
the background that suits it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import permutations

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import BLOCK, EXPECTED_NOISE, ORDER
from rsgen.formula import parse, symbol
from rsgen.identification.fitting.observed import Observed
from rsgen.law.element import Element, Law, laws, make_element
from rsgen.law.library import Range, Search
from rsgen.law.memory import memory_form, rates_of
from rsgen.law.motion import Motion, fourier_series
from rsgen.law.numeric import ForceLaw, compile_law
from rsgen.law.pieces import normal_form

# ----------------------------------------------------------------------------
# What a ranking sums up: the laws of the library without their linear spring and damper.
#
# Every candidate has the base ``k*x + c*v``; a law of the library adds what is left of it without that, so
# that
# each of them stands for one idea and sums of them do not count the base twice.


@dataclass(frozen=True)
class Term:
    """What one law of the library adds to the linear spring and damper."""

    source: Law
    how: Search

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.source.name

    @property
    def search(self) -> Mapping[str, Range]:
        """Parameters in which the term is not linear."""
        return self.how.ranges

    @cached_property
    def law(self) -> ForceLaw:
        """The term, compiled for arrays."""
        return compile_law(self.source.added)

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """Parameters in which the term is linear; the others move the part of the last one only."""
        return tuple(name for name in self.law.parameters if name not in self.search)


def base_law() -> ForceLaw:
    """The linear damper and spring that every sum has; their coefficients in this order."""
    return compile_law(parse("c*v + k*x"))


@lru_cache(maxsize=1)
def library_terms() -> tuple[Term, ...]:
    """Give the terms of all laws of the library, each once."""
    return tuple(Term(law, law.search) for law in laws if law.search is not None)


@lru_cache(maxsize=256)
def terms_of(force: sympy.Expr) -> frozenset[str]:
    """Give the terms that the linear parameters multiply, in normal form: the same whatever their names.

    With the equations of states: without them all laws with a state would be one.
    """
    law = compile_law(force)
    # a blank: no parameter has such a name
    states = {z: sympy.Symbol(f"z {number}", real=True) for number, z in enumerate(rates_of(force))}
    found = []
    for order in permutations(law.nonlinear):
        names = {symbol(law.parameters[i]): symbol(f"p{rank}") for rank, i in enumerate(order)}
        plain = force.xreplace(names | states)
        parts = [plain.diff(symbol(law.parameters[i])) for i in law.linear]
        parts.append(plain.xreplace({symbol(law.parameters[i]): sympy.S.Zero for i in law.linear}))
        positive = frozenset(map(str, names.values()))
        memory = memory_form(plain)
        rates = () if memory is None else memory.rates
        found.append(
            sorted(str(normal_form(part, positive).expression) for part in parts)
            + [f"{each.symbol}' = {normal_form(each.rate, positive).expression}" for each in rates]
        )
    return frozenset(min(found))


@dataclass(frozen=True)
class Sum:
    """A candidate: the base and some terms, parameters renamed so that each name stands once.

    Parameters
    ----------
    terms
        None for the base alone.
    """

    terms: tuple[Term, ...]

    @property
    def name(self) -> str:
        """Names of the laws in it."""
        return " + ".join(term.name for term in self.terms) or "linear-spring + linear-damper"

    @property
    def has_spring(self) -> bool:
        """Whether the linear spring is in it."""
        return not any(term.how.spring for term in self.terms)

    @cached_property
    def names(self) -> tuple[dict[str, str], ...]:
        """New name of every parameter of every term."""
        taken = {"k", "c", "m"} if self.has_spring else {"c", "m"}
        renamed = []
        for term in self.terms:
            row = {}
            for name in term.law.parameters:
                new = name
                while new in taken:
                    new += "_"
                taken.add(new)
                row[name] = new
            renamed.append(row)
        return tuple(renamed)

    @cached_property
    def elements(self) -> tuple[Element, ...]:
        """Springs and dampers, ready for a model."""
        base = [make_element("linear-spring", "k*x")] if self.has_spring else []
        base.append(make_element("linear-damper", "c*v"))
        for term, names in zip(self.terms, self.names, strict=True):
            places = {symbol(old): symbol(new) for old, new in names.items()}
            base.append(make_element(term.name, term.source.added.xreplace(places)))
        return tuple(base)

    def limits(self, size: float, speed: float) -> dict[str, tuple[float, float]]:
        """Limits [SI] of the parameters it is not linear in, at largest displacement and velocity."""
        limits = {}
        for term, names in zip(self.terms, self.names, strict=True):
            for name, where in term.search.items():
                factor = where.factor(size, speed)
                limits[names[name]] = (where.limits[0] * factor, where.limits[1] * factor)
        return limits

    @property
    def dissipates(self) -> tuple[tuple[str, ...], ...]:
        """Parameters whose sum must not be negative."""
        return tuple(
            tuple(names[name] for name in group)
            for term, names in zip(self.terms, self.names, strict=True)
            for group in term.how.dissipates
        )


NEAR = 0.02
"""Relative distance of a motion from the measured one up to which it stands for it, and up to which the
linear balance carries a candidate's background there: the square of it is less than noise. What is farther
waits for the candidate's own motion."""

_SAMPLES = 128
"""A period; laws are compared along one waveform, so that coarse sampling cancels."""

_UNKNOWN = 1e3
"""Noise of a harmonic that was not measured, in units of that of the others: it follows from the balance."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceMotion:
    """Where the balance is looked at; phases relative to the fundamental.

    Parameters
    ----------
    omega
        (n,) [rad/s].
    harmonics
        (n, J+1) complex displacement [m] along which laws are evaluated.
    force
        (n,) complex [N].
    harmonics_off, force_off
        (n, H+1), (n,) measured minus these; zero where a harmonic was not measured.
    measured
        (H+1,) which harmonics were measured; up to H the balance is looked at.
    size
        (n,) amplitude that the sensor sees [m], to which noise is relative.
    receptance
        (n,) of the background [m/N].
    background
        (b,) its values here.
    fundamental_by, force_by
        (n, b) change of the measured mode by the values of the background.
    """

    omega: Array
    harmonics: ComplexArray
    force: ComplexArray
    harmonics_off: ComplexArray
    force_off: ComplexArray
    measured: NDArray[np.bool_]
    size: Array
    receptance: ComplexArray
    background: Array
    fundamental_by: ComplexArray
    force_by: ComplexArray

    @property
    def order(self) -> int:
        """H, the highest harmonic of the balance."""
        return len(self.measured) - 1

    @property
    def background_effect(self) -> Array:
        """(b,) root mean square relative change of the measured mode by the values of the background."""
        force = self.force_by / np.abs(self.force)[:, None]
        fundamental = self.fundamental_by / self.size[:, None]
        return np.asarray(np.sqrt(np.mean(np.abs(force) ** 2 + np.abs(fundamental) ** 2, axis=0)))

    def select(self, chosen: NDArray[np.intp]) -> ReferenceMotion:
        """Keep some points."""
        return ReferenceMotion(
            self.omega[chosen],
            self.harmonics[chosen],
            self.force[chosen],
            self.harmonics_off[chosen],
            self.force_off[chosen],
            self.measured,
            self.size[chosen],
            self.receptance[chosen],
            self.background,
            self.fundamental_by[chosen],
            self.force_by[chosen],
        )

    def trajectory(self, samples: int) -> tuple[Array, Array, Array, Array]:
        """x, v, a (n, samples) and the sampling interval (n, 1) [s]."""
        motion = Motion(self.omega, self.harmonics)
        return *motion.waveforms(samples), motion.interval(samples)


def measured_motion(observed: Observed, background: Array) -> ReferenceMotion:
    """Take mean and fundamental as measured: first order, a start without any law but with a background."""
    mode = observed.mode(background)
    phase = np.angle(mode.harmonics[:, 1])
    harmonics = np.array(mode.harmonics[:, :2])
    harmonics[:, 1] = np.abs(harmonics[:, 1])
    return ReferenceMotion(
        mode.omega,
        harmonics,
        mode.force * np.exp(-1j * phase),
        np.zeros_like(harmonics),
        np.zeros_like(mode.force),
        np.array([0 in mode.measured, True]),
        observed.points.amplitude,
        observed.background.receptance(background),
        background,
        *_mode_by(observed, background, phase),
    )


def predicted_motion(
    observed: Observed,
    background: Array,
    harmonics: ComplexArray,
    force: ComplexArray,
    turn: Array,
) -> ReferenceMotion:
    """Take the motion that a fitted law predicts nearest to the measured one.

    Parameters
    ----------
    observed, background
        The measured points, and the background fitted with the law.
    harmonics, force, turn
        Predicted, relative to a fundamental of phase zero, and the phase of the true one (``Fit``).
    """
    mode = observed.mode(background)
    count = min(ORDER + 1, mode.harmonics.shape[1])
    back = np.exp(-1j * turn)
    off = np.zeros((len(mode), ORDER + 1), dtype=complex)
    off[:, :count] = mode.harmonics[:, :count] * back[:, None] ** np.arange(count) - harmonics[:, :count]
    measured = np.isin(np.arange(ORDER + 1), mode.measured)
    off[:, ~measured] = 0
    return ReferenceMotion(
        mode.omega,
        harmonics,
        force,
        off,
        mode.force * back - force,
        measured,
        observed.points.amplitude,
        observed.background.receptance(background),
        background,
        *_mode_by(observed, background, turn),
    )


def _mode_by(observed: Observed, background: Array, turn: Array) -> tuple[ComplexArray, ComplexArray]:
    """(n, b) derivatives of fundamental and force of the mode, turned back, by the background."""
    shape = observed.background
    force = (observed.points.force * shape.turn(background) * np.exp(-1j * turn))[:, None]
    by_psi = np.zeros((len(turn), len(background)), dtype=complex)
    by_psi[:, :1] = 1j
    receptance = shape.receptance(background)[:, None]
    return -force * (shape.slopes(background) + receptance * by_psi), force * by_psi


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The balance at a motion as rows of unit noise; its law-dependent side is linear in forces.

    Parameters
    ----------
    trajectory
        x, v, a (n, samples) and the sampling interval, along which laws are evaluated.
    inertia
        (n, 2H+1) of a unit mass.
    right
        (n, 2H+1) what laws and inertia have to balance.
    background
        (n, 2H+1, b) of changes of the values of the background from ``background_at``.
    background_at
        (b,) those at the motion.
    background_weight
        (b,) of these changes in the sum of squares.
    compared
        (2H+1,) False for rows that only serve to find a harmonic that was not measured.
    """

    trajectory: tuple[Array, Array, Array, Array]
    inertia: Array
    right: Array
    background: Array
    background_at: Array
    background_weight: Array
    compared: NDArray[np.bool_]
    _project: Array
    _known: dict[ForceLaw, tuple[Array, Array]] = field(default_factory=dict)

    def along(self, law: ForceLaw, values: Array) -> tuple[Array, Array]:
        """(n, 2H+1) rows of a law at values and (n, 2H+1, q) their slopes by the values."""
        if law.nonlinear:
            sample = law.sample(*self.trajectory, values)
            columns = self.of(np.stack([sample.force, *sample.by_parameter], axis=-1))
            return columns[:, :, 0], columns[:, :, 1:]
        if law not in self._known:
            sample = law.sample(*self.trajectory, np.zeros(len(values)))
            columns = self.of(np.stack([sample.force, *sample.by_parameter], axis=-1))
            self._known[law] = columns[:, :, 0], columns[:, :, 1:]
        still, slopes = self._known[law]
        return still + slopes @ values, slopes

    def of(self, signals: Array) -> Array:
        """(n, 2H+1, j) rows of j forces (n, samples, j) along the motion."""
        # a trial may overflow; whoever asked looks at what comes out
        with np.errstate(all="ignore"):
            return np.asarray(self._project @ signals)

    def select(self, chosen: NDArray[np.intp]) -> Rows:
        """Keep some points."""
        x, v, a, step = (part[chosen] for part in self.trajectory)
        return Rows(
            (x, v, a, step),
            self.inertia[chosen],
            self.right[chosen],
            self.background[chosen],
            self.background_at,
            self.background_weight,
            self.compared,
            self._project[chosen],
        )


def make_rows(
    motion: ReferenceMotion,
    law: ForceLaw,
    values: Array,
    mass: float,
    noise: Array,
    *,
    balanced: bool,
) -> Rows:
    """Prepare rows at a motion; a law near the truth says how noise of the motion becomes noise of the force.

    Parameters
    ----------
    motion
        Where.
    law, values, mass
        A law near the truth.
    noise
        (H+1,) relative noise of mean, fundamental (and force) and harmonics, that of complex numbers.
    balanced
        True where the motion is one of this very law. Other laws are then compared with it along the same
        waveform, so that what a truncated waveform leaves of a jump or corner cancels.
    """
    width, count = 2 * motion.order + 1, len(motion.omega)
    right, columns = np.empty((count, width)), np.empty((count, width))
    background = np.empty((count, width, motion.force_by.shape[1]))
    project = np.empty((count, width, _SAMPLES))
    trajectory = motion.trajectory(_SAMPLES)
    series = fourier_series(tuple(range(motion.order + 1)), _SAMPLES, half=False)
    projection = series.project.T
    known = np.repeat(motion.measured, 2)[1:]
    spread = np.where(known, np.repeat(noise, 2)[1:], _UNKNOWN * float(noise[1])) / np.sqrt(2)
    diagonal = np.arange(width)
    # rows of unknown harmonics first: what they do not need is left to the others
    order = np.argsort(known, kind="stable")
    for low in range(0, count, BLOCK):
        part = slice(low, low + BLOCK)
        x, v, a, step = (column[part] for column in trajectory)
        sample = law.sample(x, v, a, step, values)
        omega = motion.omega[part, None]
        jacobian = sample.tangent(series, motion.omega[part])
        inertia = -((series.order_of * omega) ** 2)
        jacobian[:, diagonal, diagonal] += mass * inertia

        def moved(fundamental: ComplexArray, force: ComplexArray, jacobian: Array = jacobian) -> Array:
            """(n, 2H+1, j) what j changes (n, j) of the measurement leave in f - J z."""
            by = fundamental[:, None]
            change = -(jacobian[:, :, [1]] * by.real + jacobian[:, :, [2]] * by.imag)
            change[:, 1] += force.real
            change[:, 2] += force.imag
            return np.asarray(change)

        noisy = jacobian * (motion.size[part, None] * spread)[:, None, :]
        covariance = noisy @ np.swapaxes(noisy, 1, 2)
        # noise of the force moves the mode, too: the background is measured with it
        force = motion.force[part, None] * np.array([1, 1j]) * noise[1] / np.sqrt(2)
        driven = moved(-motion.receptance[part, None] * force, force)
        covariance += driven @ np.swapaxes(driven, 1, 2)
        # harmonics that were not measured make the matrix badly scaled: stay above round-off
        covariance[:, diagonal, diagonal] *= 1 + 1e-9
        root = np.empty_like(covariance)
        sorted_rows = covariance[:, order[:, None], order]
        root[:, order[:, None], order] = np.linalg.inv(np.linalg.cholesky(sorted_rows))
        accelerated = inertia * series.real(motion.harmonics[part, : motion.order + 1])
        if balanced:
            rest = sample.force @ series.project + mass * accelerated
        else:
            rest = np.zeros((len(x), width))
            rest[:, 1], rest[:, 2] = motion.force[part].real, motion.force[part].imag
        # the balance wanted is  n + m a = f - J (z - z0)
        rest -= (jacobian @ series.real(motion.harmonics_off[part])[:, :, None])[:, :, 0]
        rest[:, 1] += motion.force_off[part].real
        rest[:, 2] += motion.force_off[part].imag
        # a change of the background is one of the measurement
        background[part] = root @ -moved(motion.fundamental_by[part], motion.force_by[part])
        right[part] = (root @ rest[:, :, None])[:, :, 0]
        columns[part] = (root @ accelerated[:, :, None])[:, :, 0]
        project[part] = root @ projection
    weight = motion.background_effect / NEAR * (1.0 if balanced else EXPECTED_NOISE)
    return Rows(trajectory, columns, right, background, motion.background, weight, known, project)
