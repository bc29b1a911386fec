"""The periodic response of an oscillator to a force with many lines, to round-off for smooth laws.

    m (i h omega0)^2 X_h + N_h(x) = F_h,    h = 0 ... H,    N_h the lines of n(x(t), x'(t))

Newton's method: the tangent of step d is m d'' + (dn/dv) d' + (dn/dx) d. With thousands of lines it would be
a dense matrix, which is never made: its product with d is one of waveforms (FFT), and GMRES (Y. Saad and
M. H. Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856) solves with such products, preconditioned by the same
tangent in central differences, whose sparse factors cost no more than some transforms. From a start that is
given Newton's method is tried once. Without one it starts from the motion of the slopes at rest; where that
is too far, the force grows to the whole in steps. A law with a negative stiffness at rest needs a start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.solvers import CONVERGED_STEP, Rows, newton
from rsgen.common.tolerances import HARMONIC_TRUNCATION
from rsgen.data.multisine.spectra import MultisineSpectra, rms
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.virtual_test import MultisineTest
from rsgen.law.motion import Motion, harmonics_of, waveform
from rsgen.law.normal_form import ForceSample
from rsgen.law.numeric import ForceLaw, compile_law

OVERSAMPLED = 4
"""Samples a period over the number of lines: cubes of signals reach three times their highest line, and fold
back above it only."""
_SHARES = np.linspace(0.1, 1.0, 10)
"""Of the force, one after the other, where the whole is too much for Newton's method."""
_GMRES_TOLERANCE = 1e-4
"""Accuracy of the linear solution of a step: Newton's own error is larger until the last steps."""
SWITCHED_RESIDUAL = 1e-5
"""Residual relative to the force that a law with switches leaves: a sample shares a switch linearly, and the
kink stays; a change of recorded lines that the next doubling of the lines would halve."""


@dataclass(frozen=True, slots=True, eq=False)
class PeriodicResponse:
    """A periodic motion.

    Parameters
    ----------
    spectrum
        (H+1,) complex displacement [m], the mean first.
    residual
        Root mean square of the balance left over that of the force [1].
    converged
        False where Newton's method did not end; the spectrum is then its last state.
    """

    spectrum: ComplexArray
    residual: float
    converged: bool


class _Problem:
    """The balance of one record as a problem of Newton's method, with an iterative linear solver."""

    def __init__(
        self, law: ForceLaw, values: Array, mass: float, omega0: float, force: ComplexArray, samples: int
    ) -> None:
        self.law, self.values, self.mass = law, values, mass
        self.force, self.samples, self.count = force, samples, len(force)
        self.rate = 1j * omega0 * np.arange(len(force))
        self.interval = 2 * np.pi / omega0 / samples
        self._last: tuple[Array, ComplexArray, ComplexArray, ForceSample] | None = None

    def wave(self, spectrum: ComplexArray) -> Array:
        return waveform(spectrum, self.samples)

    def spectrum(self, wave: Array) -> ComplexArray:
        return harmonics_of(wave, self.count)

    def left(self, unknowns: Array) -> tuple[ComplexArray, ForceSample]:
        """Return what is left of the balance (H+1,) [N], and the law along the motion."""
        if self._last is not None and np.array_equal(self._last[0], unknowns) and self._last[1] is self.force:
            return self._last[2:]
        motion = _parted(unknowns[0])
        x, v, a = (self.wave(motion * self.rate**power)[None] for power in range(3))
        sample = self.law.sample(x, v, a, np.full((1, 1), self.interval), self.values)
        force = np.broadcast_to(sample.force, (1, self.samples))[0]
        left = self.force - self.mass * self.rate**2 * motion - self.spectrum(force)
        self._last = unknowns, self.force, left, sample
        return left, sample

    def slopes(self, sample: ForceSample) -> tuple[Array, Array]:
        """dn/dx and dn/dv as waveforms."""
        shape = (1, self.samples)
        return np.broadcast_to(sample.by_x, shape)[0], np.broadcast_to(sample.by_v, shape)[0]

    def product(self, sample: ForceSample, change: ComplexArray) -> ComplexArray:
        """The tangent times a change of the motion: what it adds to m a + n."""
        dx, dv = self.wave(change), self.wave(change * self.rate)
        by_x, by_v = self.slopes(sample)
        moved = by_x * dx + by_v * dv
        for slope, perturbation in sample.by_memory:
            # (q, n, d, s) of one motion and one change
            moved = moved + np.sum(slope[:, 0] * perturbation(dx[None], dv[None, None])[:, 0, 0], axis=0)
        return self.spectrum(moved) + self.mass * self.rate**2 * change

    def residual(self, rows: Rows, unknowns: Array) -> Array:
        """(1, M)."""
        return _joined(self.left(unknowns)[0])[None]

    def step(self, rows: Rows, unknowns: Array) -> tuple[Array, Array, Array]:
        """Newton's step by GMRES; the preconditioner is the tangent in second differences, sparse."""
        left, sample = self.left(unknowns)
        factors = scipy.sparse.linalg.splu(_differences(self.mass, *self.slopes(sample), self.interval))
        size = unknowns.shape[1]
        tangent, inverse = (
            scipy.sparse.linalg.LinearOperator((size, size), matvec=product, dtype=np.float64)
            for product in (
                lambda z: _joined(self.product(sample, _parted(z))),
                lambda z: _joined(self.spectrum(factors.solve(self.wave(_parted(z))))),
            )
        )
        right = _joined(left)
        move, _ = scipy.sparse.linalg.gmres(
            tangent, right, M=inverse, rtol=_GMRES_TOLERANCE, restart=40, maxiter=3
        )
        moving = np.linalg.norm(move) / max(float(np.linalg.norm(unknowns)), 1e-300)
        return right[None], move[None], np.array([moving])


def periodic_response(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega0: float,
    force: ComplexArray,
    start: ComplexArray | None = None,
    far: ComplexArray | None = None,
) -> PeriodicResponse:
    """Compute the periodic response to a periodic force.

    Parameters
    ----------
    law, values
        n(x, v; p) and p (p,).
    mass
        m [kg].
    omega0
        2 pi over the period [rad/s].
    force
        (H+1,) complex lines [N], the mean first; as many lines of the motion are computed.
    start
        (H+1,) a motion near it [m], from which alone the method starts; None: the motion of the law's slopes
        at rest, or one under a smaller force; not converged where the stiffness at rest is negative.
    far
        (H+1,) the motion across two sensors less the share of the response in it [m], if some elements follow
        it; with a ``start``.
    """
    samples = 1 << (OVERSAMPLED * len(force) - 1).bit_length()
    if far is not None:
        law = law.with_far(Motion(np.array([omega0]), far[None]).waveforms(samples))
    problem = _Problem(law, values, mass, omega0, force, samples)
    with np.errstate(all="ignore"):
        return _from_rest(problem) if start is None else _solve(problem, start)


def _solve(problem: _Problem, motion: ComplexArray) -> PeriodicResponse:
    roots = newton(problem, _joined(motion)[None])
    found = _parted(roots.unknowns[0])
    size = float(np.linalg.norm(problem.force)) or 1.0
    left = float(np.linalg.norm(problem.left(roots.unknowns)[0])) / size
    # a step that gains nothing is round-off there
    enough = SWITCHED_RESIDUAL if problem.law.switched else CONVERGED_STEP
    return PeriodicResponse(found, left, bool(roots.last_step[0] < CONVERGED_STEP or left < enough))


def _joined(spectrum: ComplexArray) -> Array:
    """Real coordinates of the lines: real parts, then imaginary ones without that of the mean."""
    return np.concatenate([spectrum.real, spectrum.imag[1:]])


def _parted(values: Array) -> ComplexArray:
    """The lines (H+1,) of real coordinates (2 H + 1,)."""
    count = len(values) // 2 + 1
    found = values[:count].astype(complex)
    found[1:] += 1j * values[count:]
    return found


def _differences(mass: float, by_x: Array, by_v: Array, step: float) -> Any:
    """m x'' + (dn/dv) x' + (dn/dx) x of a periodic motion in central differences, sparse."""
    count = len(by_x)
    here = np.arange(count)
    entries = [by_x - 2 * mass / step**2, mass / step**2 + by_v / 2 / step, mass / step**2 - by_v / 2 / step]
    columns = [here, (here + 1) % count, (here - 1) % count]
    return scipy.sparse.csc_matrix((np.concatenate(entries), (np.tile(here, 3), np.concatenate(columns))))


def _from_rest(problem: _Problem) -> PeriodicResponse:
    """Start from the motion of the slopes at rest; if that is too far, let the force grow to the whole."""
    rest = problem.law.still(np.zeros((1, 1)), problem.values)
    stiffness, damping = float(np.ravel(rest.by_x)[0]), float(np.ravel(rest.by_v)[0])
    whole = problem.force
    if stiffness < 0:
        # the motion about a place that pushes away is none that a structure has
        return PeriodicResponse(whole, np.inf, converged=False)
    dynamic = stiffness + damping * problem.rate + problem.mass * problem.rate**2
    motion = np.where(dynamic == 0, 0, whole / np.where(dynamic == 0, 1, dynamic))
    found = _solve(problem, motion)
    if found.converged:
        return found
    last = 1.0
    for share in _SHARES:
        problem.force = share * whole
        found = _solve(problem, motion * (share / last))
        motion, last = found.spectrum, share
    return found


# ----------------------------------------------------------------------------
# The records of a virtual test with a multisine.

_MAX_LINES = 1 << 15
"""Lines of a motion at most: its waveforms have four times as many samples."""


def simulate_multisine(oscillator: Oscillator, test: MultisineTest) -> MultisineSpectra:
    """Compute the periodic response of every record.

    Raises
    ------
    RsgenError
        A record has no periodic response that Newton's method finds, as where dry friction holds the mass.
    """
    law = compile_law(oscillator.force)
    values = law.ordered(oscillator.values)
    phases = np.random.default_rng([test.seed, 0])
    levels = np.repeat(test.level, test.realisations)
    excited = test.excited
    forces, responses = [], []
    for level in levels:
        force = np.zeros(test.highest + 1, dtype=complex)
        force[excited] = level * np.sqrt(2 / len(excited))
        force[excited] *= np.exp(2j * np.pi * phases.random(len(excited)))
        force = test.drive(oscillator.mass, force, np.arange(len(force)) / test.period)
        found = _respond(law, values, oscillator.mass, 2 * np.pi / test.period, force)
        if found is None:
            raise RsgenError(
                f"test.level: {level:g} {test.level_unit}: no periodic response was found; where dry "
                "friction holds the mass for a while, or several motions are possible, test at higher levels"
            )
        forces.append(force)
        responses.append(found)
    per = 1.0 if test.base is None else oscillator.mass
    return MultisineSpectra(
        level=levels,
        omega0=2 * np.pi / test.period,
        force=_noisy(np.array(forces) / per, test, 1),
        response=_noisy(np.array(responses), test, 2),
        origin="simulated",
        per_mass=test.base is not None,
        base=test.base or "",
    )


def _respond(
    law: ForceLaw, values: Array, mass: float, omega0: float, force: ComplexArray
) -> ComplexArray | None:
    """The recorded lines (H+1,) of the motion, with as many lines as they need; None without convergence."""
    count = len(force)
    before: ComplexArray | None = None
    start: ComplexArray | None = None
    enough = SWITCHED_RESIDUAL if law.switched else HARMONIC_TRUNCATION
    lines = count - 1
    while True:
        drive = np.zeros(lines + 1, dtype=complex)
        drive[:count] = force
        found = periodic_response(law, values, mass, omega0, drive, start)
        if not found.converged:
            return None
        recorded = found.spectrum[:count]
        if before is not None:
            change = float(np.linalg.norm(recorded - before)) / float(np.linalg.norm(recorded))
            if change < enough or 2 * lines > _MAX_LINES:
                return recorded
        before = recorded
        lines *= 2
        start = np.zeros(lines + 1, dtype=complex)
        start[: len(found.spectrum)] = found.spectrum


def _noisy(clean: ComplexArray, test: MultisineTest, stream: int) -> ComplexArray:
    """(r, p, H+1) periods of spectra (r, H+1) with white noise; the mean of a record is real."""
    periods = np.repeat(clean[:, None], test.periods, axis=1)
    if test.noise_relative == 0:
        return periods
    generator = np.random.default_rng([test.seed, stream])
    size = test.noise_relative * rms(clean)[:, None, None] / np.sqrt(clean.shape[1] - 1)
    drawn = generator.standard_normal((*periods.shape, 2))
    noise = drawn[..., 0] + 1j * drawn[..., 1]
    noise[..., 0] = noise[..., 0].real
    return np.asarray(periods + size * noise)
