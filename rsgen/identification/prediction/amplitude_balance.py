"""Frequency response of an identified structure, with the amplitude as the independent variable.

With the equivalent stiffness k(X, omega) and damping c(X, omega) of the whole waveform at amplitude X,

    F^2 = X^2 ((k - m omega^2)^2 + omega^2 c^2)

is quadratic in omega^2 while k and c are kept. With the slope of the loss a few such steps give the two
frequencies at which a force F has the amplitude X; they meet at the peak. Every X has one solution on each
side of the resonance, so that stable and unstable branches come without continuation. At a given frequency
Newton's method in X gives the response.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from math import nan

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from rsgen.common.arrays import Array, ComplexArray, blocks_joined
from rsgen.common.tolerances import (
    BALANCE_HARMONICS,
    BRANCH_DISTANCE,
    HELD_OUT_ERROR_SMALL,
    MAX_LINEAR_CHANGE,
    MAX_TRIAL_STEPS,
    NOISE_RATIO_BY_CHANCE,
    RELATIVE_CHANGE_NEGLIGIBLE,
    SAMPLES_PER_PERIOD,
    SAMPLES_PER_PERIOD_SWITCHED,
    START_HARMONICS,
    interval_sigmas,
)
from rsgen.data.surface.mode_findings import force_changes
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import (
    Response,
    all_harmonics,
    decisive_multiplier,
    following_harmonics,
    hold_amplitude,
)
from rsgen.identification.fitting.across import MeasuredAcross, law_of
from rsgen.identification.fitting.forward import MAX_POWER_OF_FORCE
from rsgen.identification.misfit import law_misses
from rsgen.identification.modal_result import ModalTable, SplineMode
from rsgen.identification.prediction.prediction_result import BEYOND
from rsgen.identification.results import Identification
from rsgen.law.motion import Motion, sine_motion
from rsgen.law.numeric import compile_law

_TABLE_SIZE = 120
"""Amplitudes of a table of forces over the amplitude."""

_MIN_AMPLITUDE = 1e-4
"""Smallest amplitude of the backbone table, relative to the largest tested."""

_BISECTION_POINTS = 25
"""Amplitudes of each of three refinements of an end of a curve."""

_LOWEST_FREQUENCY = 0.01
"""Relative to that of the resonance: from there a step that led below it is taken again; none below it."""
_FREQUENCY_TOLERANCE = 1e-7
_FORCE_TOLERANCE = 1e-8
"""Relative error of the force at which Newton's method ends."""

_MAX_ITERATIONS = 40
"""Newton steps of at most a fifth of the amplitude, or bisections of an interval."""

_SAMPLES_OF_DISTURBANCE = (SAMPLES_PER_PERIOD_SWITCHED, 8 * SAMPLES_PER_PERIOD_SWITCHED)
"""A period; the second where the first says that a motion does not last: corners err by 0.02 in it."""


class AmplitudeBalance:
    """The balance of an identified structure as a function of amplitude and frequency."""

    def __init__(self, identification: Identification) -> None:
        self._law = compile_law(identification.model.force)
        self._values = np.array(identification.solution)
        self._mass, self._driven = identification.mass, bool(identification.curve.base)
        # with jumps the higher harmonics of a balance do not converge near sticking
        self._order = START_HARMONICS if self._law.jumps else BALANCE_HARMONICS
        self._following = following_harmonics(self._law, self._order)
        self._samples = 2 * SAMPLES_PER_PERIOD if self._law.switched else SAMPLES_PER_PERIOD
        known = np.isfinite(identification.covariance)
        # without any error there is no band
        self._covariance = np.where(known | ~known.any(), identification.covariance, 0.0)
        names = (*self._law.parameters, "m")
        self._places = [names.index(estimate.name) for estimate in identification.refined]
        # the force of a driven base follows a mass that has an error
        self._following_mass = np.array(self._places) == (len(names) - 1 if identification.curve.base else -1)
        self._largest = identification.amplitude_range[1]
        self._centre = np.pi * sum(identification.frequency_range)
        self._misses = identification.fit is not None and law_misses(identification.fit)

    def solve(self, size: Array, omega: Array, start: ComplexArray | None = None) -> Response:
        """Return the response with amplitudes X (n,) [m] at the frequencies (n,) [rad/s]."""
        guess = np.zeros((len(size), self._order + 1), dtype=complex) if start is None else start
        hold = partial(hold_amplitude, self._law, self._values, self._mass)
        at = hold(omega, size, guess, self._following, self._samples)
        lost = ~(at.valid & np.isfinite(at.force))
        if not lost.any():
            return at
        # first order where the higher harmonics do not converge
        mean = tuple(h for h in self._following if h == 0)
        rough = hold(omega[lost], size[lost], np.zeros_like(guess[lost]), mean, self._samples)
        parts = [(~lost, at.select(~lost)), (lost, rough)]
        return Response(**blocks_joined(len(size), parts, Response.columns()))

    def force_spread(self, at: Response) -> Array:
        """Return the half width (n,) of the 95 % band of the force amplitude [N]."""
        return self._spread(self._by_values(at) / np.abs(at.force)[:, None])

    def _by_values(self, at: Response) -> Array:
        """Return the slopes (n, p) of |F|^2/2 [N^2] by the values."""
        slope = (np.conj(at.force)[:, None] * at.force_by[:, self._places]).real
        return np.asarray(slope - np.abs(at.force)[:, None] ** 2 / self._mass * self._following_mass)

    def _spread(self, slope: Array) -> Array:
        """Return the half width (n,) of the 95 % band of what has slopes (n, p) by the values."""
        variance = np.einsum("np,pq,nq->n", slope, self._covariance, slope).clip(0.0)
        return np.asarray(interval_sigmas() * np.sqrt(variance))

    def at_top(self, size: Array, omega: Array, seen: ComplexArray) -> Array:
        """Return what a curve has at its largest amplitude X (1,) [m], each with its 95 % bounds (4, 3).

        These are its frequency [Hz], with bounds where a peak is near, the least and the largest displacement
        [m], and the largest |acceleration| [m/s^2]. With P = |F|^2/2, P_omega is zero at a force:
        P_ww d omega + P_wX dX + P_wp dp = 0, P_X dX = -P_p dp. Extrema move as the waveform there.
        """
        if not len(size):
            return np.full((4, 3), nan)
        (peak, _), step = self.backbone(size, omega), 1e4 * _FREQUENCY_TOLERANCE * omega
        near = np.abs(peak - omega) < step
        middle = np.where(near, peak, omega)
        before, at, after = three = [self.solve(size, middle + by) for by in (-step, 0, step)]
        low, power, high = (np.abs(one.force) ** 2 / 2 for one in three)
        by_values = [self._by_values(one) for one in three]
        by_size = [(np.conj(one.force) * one.force_slope).real / size for one in three]
        with np.errstate(divide="ignore", invalid="ignore"):
            size_by = -by_values[1] / by_size[1]
            omega_by = by_values[2] - by_values[0] + (by_size[2] - by_size[0]) * size_by
            omega_by *= step / 2 / (2 * power - high - low)
            known = near & (self._spread(omega_by) < MAX_LINEAR_CHANGE * omega)
        omega_by = np.where(known, omega_by, 0.0)
        x, acceleration = self.in_time(at, middle, seen)
        places = [x.argmin(), x.argmax(), np.abs(acceleration).argmax()]
        most, orders = acceleration[places[2]], np.arange(at.harmonics.shape[1])
        motion_by = at.harmonics_by[0][:, self._places] + np.outer(at.harmonics_slope / size, size_by)
        motion_by += np.outer(after.harmonics - before.harmonics, omega_by / (2 * step))
        turn = np.exp(2j * np.pi / len(x) * np.outer(places, orders))
        turn[2] *= -((orders * omega) ** 2) * np.sign(most)
        by = np.vstack([omega_by / (2 * np.pi), (turn @ motion_by).real])
        by[3] += 2 * np.abs(most) / omega * omega_by[0]
        known = np.append(known, np.repeat(self._spread(size_by) < MAX_LINEAR_CHANGE * size, 3))
        amounts = np.array([middle[0] / (2 * np.pi), x.min(), x.max(), np.abs(most)])
        half = np.where(known, self._spread(by), nan)
        return np.stack([amounts, amounts - half, amounts + half], axis=1)

    def in_time(self, at: Response, omega: Array, seen: ComplexArray) -> tuple[Array, Array]:
        """Return displacement [m] and acceleration [m/s^2] (s,) of a motion over a period.

        The fundamental at the sensor is ``seen`` (1,) [m]. On a driven base m x'' + f = F = -m a_base, and
        the acceleration is the absolute one, -f/m.
        """
        samples = _SAMPLES_OF_DISTURBANCE[1]
        motion, inner, force = all_harmonics(self._law, self._values, self._mass, omega, at, samples)
        push = (0 if self._driven else force) - self._mass * omega**2 * (seen - at.harmonics[:, 1])
        motion[:, 1] *= seen / at.harmonics[:, 1]
        acceleration = (sine_motion(omega, push).waveforms(samples)[0] - inner) / self._mass
        return Motion(omega, motion).waveforms(samples)[0][0], acceleration[0]

    def frequency_spread(self, spread: Array, size: Array, omega: Array, start: ComplexArray) -> Array:
        """Return the half width (n,) of the 95 % band [rad/s] of the frequency of folds at X (n,) [m].

        d|F|/dX = 0 there, so that |F|_omega d omega + |F|_p dp = 0, with the ``spread`` (n,) of the force
        [N] for the second. NaN where the band is too wide.
        """
        if not len(size):
            return size
        step = 100 * _FREQUENCY_TOLERANCE * omega
        low, high = (np.abs(self.solve(size, omega + by, start).force) for by in (-step, step))
        half = spread / np.maximum(np.abs(high - low) / (2 * step), 1e-300)
        return np.where(half <= np.minimum(MAX_LINEAR_CHANGE * omega, np.ptp(omega) or np.inf), half, np.nan)

    def multiplier(self, at: Response, omega: Array) -> ComplexArray:
        """Return ``decisive_multiplier`` (n,); NaN with memory, and with jumps, where disturbances jump."""
        found, rows = np.full(len(omega), np.nan + 0j), np.arange(len(omega))
        if self._law.jumps or self._law.remembers:
            return found
        for samples in _SAMPLES_OF_DISTURBANCE:
            along = self._law.along(at.motion(omega).select(rows), self._values, samples)
            found[rows] = decisive_multiplier(along, self._mass, omega[rows], odd=self._law.odd)
            rows = np.flatnonzero(np.abs(found) > 1)
        return found

    def explained(self, test: ResponseSurface, misfit: float, *, held: bool) -> float:
        """Return the relative error of predicted motions that noise and the errors of the values explain.

        NaN where the misfit has a pattern, so that it is no noise and widens those errors (not of decays),
        and where a quarter of the motion, by its square, may be on another branch.
        With b = dF_p/F and s = d ln F/d ln X a motion under a given force moves by -Re b (1 - i Im s)/Re s
        - i Im b. Force and response have a noise of the misfit each, of which chance makes 1.5 times as much.

        Parameters
        ----------
        test
            The points, with the motion that was measured.
        misfit
            That of the fit, relative.
        held
            True if forces at a given amplitude are compared.
        """
        if self._misses and not test.decays:
            return nan
        at = self.solve(test.amplitude, test.omega)
        by = at.force_by[:, self._places] / at.force[:, None] - self._following_mass / self._mass
        follows = np.ones(len(test), dtype=complex)
        if not held:
            slope = at.force_slope / at.force
            follows = (1 - 1j * slope.imag) / slope.real
            by = by.real * follows[:, None] + 1j * by.imag
        variance = np.einsum("np,pq,nq->n", by, self._covariance, np.conj(by)).real.clip(0.0)
        noise = NOISE_RATIO_BY_CHANCE**2 * misfit**2 * (3 + np.abs(follows) ** 2) / 2
        error = np.sqrt(interval_sigmas() ** 2 * variance + noise)
        # what is farther off is on another branch
        limit, size = np.inf if held else BRANCH_DISTANCE, np.linalg.norm(test.amplitude)
        if np.linalg.norm(test.amplitude[error > limit]) > size / 2:
            return nan
        return float(np.linalg.norm(np.minimum(error, limit) * test.amplitude) / size)

    def equivalent(
        self, size: Array, omega: Array, start: ComplexArray | None
    ) -> tuple[Array, Array, ComplexArray]:
        """Return k [N/m] and c [N s/m] (n,) of motions with all harmonics, and the harmonics (n, K+1) [m]."""
        at = self.solve(size, omega, start)
        stiffness = at.force / size
        guess = np.where(np.isfinite(at.harmonics), at.harmonics, 0)
        return stiffness.real + self._mass * omega**2, stiffness.imag / omega, guess

    def _iterate_frequency(
        self, size: Array, guess: Array, side: int, level: float = 0.0
    ) -> tuple[Array, Array, ComplexArray, ComplexArray]:
        """Iterate u = omega^2 until |F| at the amplitudes is the level [N]; where it is least for side 0.

        (F/X)^2 = (k - m u)^2 + h(u), with k and h of the last omega and, of h, the slope, which takes up that
        of k. So both sides meet where the force is least, however the loss depends on omega. Returns omega
        [rad/s]; its last square, 0 where there is no frequency, NaN where the iteration does not end;
        k + i omega c [N/m], each (n,), and the harmonics (n, K+1) [m].
        """
        omega, last = np.array(guess), np.full(len(size), np.nan)
        stiffness, moving = np.full(len(size), np.nan + 0j), np.arange(len(size))
        _, _, harmonics = self.equivalent(size, omega, None)
        for _ in range(3 * MAX_TRIAL_STEPS):
            here, amplitude, start = omega[moving], size[moving], harmonics[moving]
            stiff, damping, harmonics[moving] = self.equivalent(amplitude, here, start)
            near = here * (1 + 1e3 * _FREQUENCY_TOLERANCE)
            stiff_near, damping_near, _ = self.equivalent(amplitude, near, harmonics[moving])
            loss = (here * damping) ** 2
            moved = (stiff_near - self._mass * near**2) ** 2 - (stiff - self._mass * near**2) ** 2
            slope = (moved + (near * damping_near) ** 2 - loss) / (near**2 - here**2)
            middle = stiff / self._mass - 0.5 * slope / self._mass**2
            rest = stiff**2 + loss - slope * here**2 - (level / amplitude) ** 2
            root = np.sqrt(np.maximum(middle**2 - rest / self._mass**2, 0.0))
            square, lowest = middle + side * root, (_LOWEST_FREQUENCY * guess[moving]) ** 2
            last[moving] = np.where(square <= lowest, 0.0, square)
            stiffness[moving] = stiff + 1j * here * damping
            new = np.sqrt(np.maximum(square, lowest))
            far = np.abs(new / here - 1) >= _FREQUENCY_TOLERANCE
            omega[moving] = np.where(np.isfinite(new), new, here)
            if not far.any():
                break
            moving = moving[far]
        else:
            last[moving] = np.nan
        return omega, last, stiffness, harmonics

    def backbone(self, size: Array, guess: Array) -> tuple[Array, Array]:
        """Return the frequency [rad/s] of the least force at each amplitude, and that force [N], both (n,).

        The two solutions of a level coincide there; with strong damping below the phase resonance. NaN if
        there is none, or the loss is larger than the stiffness: friction all but sticks.
        """
        omega, square, stiffness, _ = self._iterate_frequency(size, guess, 0)
        known = (square != 0) & (stiffness.real > stiffness.imag)
        least = size * np.abs(stiffness - self._mass * omega**2)
        return np.where(known, omega, np.nan), np.where(known, least, np.nan)

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Return the backbone up to twice the largest tested amplitude; see ``_tabulated``."""
        return self._tabulated(2 * self._largest)

    @cached_property
    def _least_between(self) -> dict[tuple[float, float], Array]:
        """Least forces [N] between two amplitudes [m]: ends where friction begins to stick recur."""
        return {}

    def _tabulated(self, largest: float) -> tuple[Array, Array, Array]:
        """Return the backbone up to an amplitude [m]: amplitudes [m], frequencies [rad/s] and forces [N]."""
        size = np.geomspace(_MIN_AMPLITUDE * self._largest, largest, _TABLE_SIZE)
        near = np.full(len(size), self._frequency_near_resonance(self._largest))
        return (size, *self.backbone(size, near))

    def _interpolated_frequency(self, size: Array) -> Array:
        """Interpolate the resonance frequency (n,) [rad/s] in the table."""
        table, omega, _ = self._table
        known = np.isfinite(omega)
        found = np.interp(size, table[known], omega[known]) if known.any() else self._centre
        return np.broadcast_to(found, size.shape)

    def _frequency_near_resonance(self, size: float) -> float:
        """Return a frequency [rad/s] near the resonance at an amplitude [m]."""
        omega = self._centre
        for _ in range(20):
            stiffness, _, _ = self.equivalent(np.array([size]), np.array([omega]), None)
            new = float(np.sqrt(abs(stiffness[0] / self._mass)))
            if not new > 0 or abs(new - omega) < 1e-3 * omega:
                break
            omega = new
        return omega

    def spans(self, level: float, window: tuple[float, float]) -> list[tuple[float, float]]:
        """Return the ranges of amplitudes [m] that a level [N] reaches at some frequency, ascending."""
        size, _, force = self._table
        for _ in range(8):
            # enlarge the table until the level does not reach its end
            if not force[-1] < level:
                break
            size, _, force = self._table = self._tabulated(2 * float(size[-1]))
        reached = force <= level
        # an amplitude at which no motion was found, between two that are reached, ends no range
        known = np.flatnonzero(np.isfinite(force))
        place = np.searchsorted(known, np.arange(len(force)))
        lost = np.isnan(force) & (place > 0) & (place < len(known))
        reached[lost] = reached[known[place[lost] - 1]] & reached[known[place[lost]]]
        edges = np.flatnonzero(np.diff(reached.astype(int)))
        ends = [self._refine_end(float(size[i]), float(size[i + 1]), level) for i in edges]
        if reached[0]:
            # a little less than the smallest amplitude within the window: at its edges the force is largest
            least, edge = np.meshgrid(np.append(1e-3 * self._largest, size), window)
            needed = np.abs(self.solve(least.ravel(), edge.ravel()).force).reshape(least.shape).max(axis=0)
            below = np.cumprod(needed[1:] <= level).sum()
            ends.insert(0, float(min(0.8 * level * least[0, 0] / needed[0], size[max(below - 1, 0)])))
        if reached[-1]:
            ends.append(float(size[-1]))
        return [(low, high) for low, high in zip(ends[::2], ends[1::2], strict=False) if high > low]

    def _refine_end(self, low: float, high: float, level: float) -> float:
        """Return the amplitude [m] between two others whose least force is the level [N].

        It is interpolated once the force is all but a line around it, a millionth inside, where both sides
        are distinct; at a step or a gap one of the points is the end.
        """
        inside = level * (1 - 10 * _FREQUENCY_TOLERANCE)
        for _ in range(3):
            size = np.linspace(low, high, _BISECTION_POINTS)
            if (low, high) not in self._least_between:
                _, force = self.backbone(size, self._interpolated_frequency(size))
                self._least_between[low, high] = force
            force = self._least_between[low, high]
            reached = force <= level
            i = next(iter(np.flatnonzero(np.diff(reached.astype(int)))), 0)
            low, high = float(size[i]), float(size[i + 1])
            steps = np.diff(force[max(i - 1, 0) : i + 3])
            line = np.ptp(steps) < RELATIVE_CHANGE_NEGLIGIBLE * abs(force[i + 1] - force[i])
            if line and reached[i] != reached[i + 1]:
                return low + (high - low) * float((inside - force[i]) / (force[i + 1] - force[i]))
        return low if reached[i] else high

    def peak(self, level: float, window: tuple[float, float]) -> tuple[Array, Array]:
        """Return the frequency [rad/s] and the amplitude [m] of the peak under a level [N], each (1,).

        The frequency is NaN where the motion grows up to that amplitude, to which a peak was sought.
        """
        size = np.array([high for _, high in self.spans(level, window)][-1:])
        omega, least = self.backbone(size, self._interpolated_frequency(size))
        return np.where(np.abs(least / level - 1) < RELATIVE_CHANGE_NEGLIGIBLE, omega, np.nan), size

    def frequencies(self, size: Array, level: float, side: int) -> tuple[Array, ComplexArray]:
        """Return the frequency (n,) [rad/s] below (side -1) or above (+1) the resonance, 0 if there is none,
        NaN if it is not found, and the harmonics (n, K+1) [m] of the motion.
        """
        guess = self._interpolated_frequency(size)
        omega, square, _, harmonics = self._iterate_frequency(size, guess, side, level)
        return np.where(np.isfinite(square), np.where(square == 0, 0.0, omega), np.nan), harmonics

    def respond(self, mode: ResponseSurface) -> ComplexArray:
        """Return the complex fundamental (n,) [m] on the stable branch nearest to the measured one.

        Where the test held the amplitude, the predicted force at that amplitude is compared with the measured
        one, as X F/F_predicted: near a fold, and on an unstable branch, a force determines no amplitude. So
        are free decays, whose points all lie on the resonance, and a sweep that falls from fold to fold
        through the unstable branch: its force, corrected for that, would hold the motion there. A shaker that
        loses force at the resonance does hold motions there.
        """
        force, omega, near = mode.force, mode.omega, mode.amplitude
        if not (mode.response_held or mode.overlapping or force_changes(near, force)):
            return self._settled(force, omega, near)
        at = self.solve(near, omega)
        found = np.asarray(near * force / at.force)
        if not (mode.response_held or mode.decays):
            stable = (np.conj(at.force) * at.force_slope).real > np.abs(at.force) ** 2 / MAX_POWER_OF_FORCE
            found[stable] = self._settled(force[stable], omega[stable], near[stable])
        return found

    def _settled(self, force: ComplexArray, omega: Array, near: Array) -> ComplexArray:
        """Return the stable fundamental (n,) [m] under forces [N] that is nearest to amplitudes [m]."""
        level = np.abs(force)
        size, ok = self.newton_amplitude(level, omega, np.array(near))
        if not ok.all():
            size[~ok] = self._scan_amplitudes(level[~ok], omega[~ok], near[~ok])
        known = np.isfinite(size)
        result = np.full(len(size), np.nan + 0j)
        if known.any():
            at = self.solve(size[known], omega[known])
            result[known] = size[known] * force[known] / level[known] * np.exp(-1j * np.angle(at.force))
        return result

    def newton_amplitude(self, level: Array, omega: Array, size: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Solve for the amplitudes (n,) [m] of the levels by Newton's method; return a mask of converged."""
        start, first = None, np.array(size)
        for _ in range(_MAX_ITERATIONS):
            at = self.solve(size, omega, start)
            start = np.where(np.isfinite(at.harmonics), at.harmonics, 0)
            gain = (np.conj(at.force) * at.force_slope).real / np.abs(at.force) / size
            miss = np.abs(at.force) - level
            if np.all(np.abs(miss) <= _FORCE_TOLERANCE * level):
                break
            step = miss / np.where(np.abs(gain) > 1e-300, gain, 1e-300)
            size = size - np.clip(step, -0.2 * size, 0.2 * size)
        good = (np.abs(miss) <= 1e-6 * level) & (gain > 0) & (np.abs(size / first - 1) < MAX_LINEAR_CHANGE)
        return size, good

    def _scan_amplitudes(self, level: Array, omega: Array, near: Array) -> Array:
        """Return the stable amplitude nearest to ``near`` among all amplitudes; NaN if there is none."""

        def force_at(sizes: Array) -> Array:
            rows = np.repeat(np.arange(len(sizes)), sizes.shape[1])
            return np.abs(self.solve(sizes.ravel(), omega[rows]).force).reshape(sizes.shape)

        grid = np.geomspace(1e-3 * self._largest, 3 * self._largest, _TABLE_SIZE)
        sizes = np.tile(grid, (len(level), 1))
        force = force_at(sizes)
        # near a fold the force falls below the level and rises again within one step
        least = (force[:, 1:-1] < force[:, :-2]) & (force[:, 1:-1] <= force[:, 2:])
        distance = np.abs(np.log(grid[1:-1] / near[:, None]))
        place = np.argmin(np.where(least, distance, np.inf), axis=1)
        fine = np.geomspace(grid[place], grid[place + 2], _TABLE_SIZE, axis=1)[:, 1:-1]
        sizes, force = np.hstack([sizes, fine]), np.hstack([force, force_at(fine)])
        order = np.argsort(sizes, axis=1)
        sizes, force = (np.take_along_axis(part, order, axis=1) for part in (sizes, force))
        result = np.full(len(level), np.nan)
        for i, (size, row, wanted) in enumerate(zip(sizes, force, level, strict=True)):
            up = np.flatnonzero((row[:-1] < wanted) & (row[1:] >= wanted))
            if len(up):
                share = (wanted - row[up]) / (row[up + 1] - row[up])
                roots = size[up] + share * (size[up + 1] - size[up])
                result[i] = roots[np.argmin(np.abs(np.log(roots / near[i])))]
        return result


# ----------------------------------------------------------------------------
# Responses from a modal table, without a law: nonlinear single-mode synthesis.
#
# k(X) and c(X, omega) of the table take the place of a law in F = X (k - m omega^2 + i omega c). Above the
# amplitudes of the table nothing is predicted; below them, on the flanks of a resonance, inertia and
# stiffness decide, and k and c are taken as constant.


class SynthesisBalance(AmplitudeBalance):
    """The balance of one harmonic with the splines of a modal table in place of a law."""

    def __init__(self, table: ModalTable, frequencies: tuple[float, float]) -> None:
        splines = table.splines
        self._splines, self._mass = splines, splines.mass
        spread = splines.spread(np.ones(1))[0, 2]
        self._covariance = block_diag(np.nan_to_num(splines.covariance), np.eye(len(spread)))
        self._places, self._misses = list(range(len(self._covariance))), False
        mass = np.concatenate([np.zeros(len(splines.values)), [1.0], spread])
        self._following_mass = mass * bool(table.test.base)
        self._least, self._largest = splines.basis.lowest, table.tested[1]
        self._centre = np.pi * sum(frequencies)

    def solve(self, size: Array, omega: Array, start: ComplexArray | None = None) -> Response:
        """Force that holds the amplitudes X [m] at the frequencies [rad/s]; both (n,)."""
        splines = self._splines
        at = SplineMode(omega, splines.basis, splines.orders)(splines.values, splines.mass, size)
        shares = size * np.stack([np.ones(len(omega)), 1j * omega, -(omega**2)])
        spread = np.einsum("jn,njs->ns", shares, splines.spread(size))
        force_by = np.concatenate([at.force_by, spread], axis=1)
        return replace(at, force_by=force_by, harmonics_by=np.zeros((*at.harmonics.shape, force_by.shape[1])))

    def in_time(self, at: Response, omega: Array, seen: ComplexArray) -> tuple[Array, Array]:
        """Return NaN: a table has no harmonics."""
        return np.full(1, nan), np.full(1, nan)

    def frequency_spread(self, spread: Array, size: Array, omega: Array, start: ComplexArray) -> Array:
        """Return the half width as of a law; a fold at a level held may lie anywhere next to it.

        There lines between the levels have a corner. With the force of an amplitude next to it, which is
        less well known, the frequency may go as far as the error of that force exceeds its difference.
        """
        held, level = np.log(self._splines.held), np.abs(self.solve(size, omega).force)
        for share in np.linspace(-1, 1, _BISECTION_POINTS) if len(held) > 1 else ():
            places = np.interp(np.log(size), held, np.arange(len(held))) + share
            at = self.solve(np.exp(np.interp(places, np.arange(len(held)), held)), omega)
            spread = np.maximum(spread, self.force_spread(at) - np.abs(np.abs(at.force) - level))
        return super().frequency_spread(spread, size, omega, start)

    def multiplier(self, at: Response, omega: Array) -> ComplexArray:
        """Return NaN (n,): the slopes of a law are not known."""
        return np.full(len(omega), np.nan + 0j)

    def _tabulated(self, largest: float) -> tuple[Array, Array, Array]:
        """Return the backbone as of a law, at most to the end of the modal table."""
        return super()._tabulated(min(largest, BEYOND * self._largest))

    def respond(self, mode: ResponseSurface) -> ComplexArray:
        """Return the response as for a law; NaN above the table, and below it if k and c matter there.

        Where the measured response lies above it, another branch inside is none of that point.
        """
        found = super().respond(mode)
        size, end = np.abs(found), np.full(len(found), self._least * BEYOND)
        at = self.solve(end, mode.omega)
        with np.errstate(divide="ignore", invalid="ignore"):
            # k changes by at most its slope by ln X at the lower end, down to rest
            below = np.clip(np.log(self._least / size), 0.0, 1.0)
            changed = np.abs(at.force_slope - at.force) / end * below * size / np.abs(mode.force)
            largest = np.fmax(size, mode.amplitude)
            known = (largest <= BEYOND * self._largest) & (changed < HELD_OUT_ERROR_SMALL)
        return np.where(known, found, np.nan)


# ----------------------------------------------------------------------------
# Responses of a law across two sensors, at points where the motion across was measured with the response.

_AMPLITUDE_RATIOS = np.union1d(np.geomspace(0.1, 10.0, _TABLE_SIZE), np.linspace(0.9, 1.1, 201))
"""Amplitudes among which a solution is sought, relative to the measured one: closer than branches lie."""


class MeasuredBalance(AmplitudeBalance):
    """The balance of a law across two sensors, at points where both motions were measured."""

    def __init__(self, identification: Identification) -> None:
        self._law = law_of(identification.model.elements)
        self._values, self._mass = np.array(identification.solution), identification.mass

    def explained(self, test: ResponseSurface, misfit: float, *, held: bool) -> float:
        """Return NaN: the slopes of the motion across are not known."""
        return nan

    def respond(self, mode: ResponseSurface) -> ComplexArray:
        """Return the complex fundamental (n,) [m] under the measured force.

        The motion across keeps its measured ratio to the response. Of several solutions the one nearest to
        the measured amplitude is returned; NaN if there is none.
        """
        if not mode.across.size:
            return np.full(len(mode), np.nan, dtype=complex)
        motions = (Motion(mode.omega, np.nan_to_num(motion)) for motion in (mode.harmonics, mode.across))
        forward = MeasuredAcross(self._law, *motions)
        measured, level = mode.amplitude, np.abs(mode.force)

        def force_at(size: Array) -> ComplexArray:
            return forward(self._values, self._mass, size).force

        if mode.response_held:
            return np.asarray(measured * mode.force / force_at(measured))
        ratios = _AMPLITUDE_RATIOS
        table = np.array([np.abs(force_at(share * measured)) - level for share in ratios])
        crossed = (table[:-1] < 0) != (table[1:] < 0)
        distance = np.where(crossed, np.abs(np.log(ratios[:-1, None])), np.inf)
        row = np.argmin(distance, axis=0)
        upward = np.take_along_axis(table, row[None, :], axis=0)[0] < 0
        low, high = ratios[row] * measured, ratios[row + 1] * measured
        for _ in range(_MAX_ITERATIONS):
            middle = (low + high) / 2
            above = (np.abs(force_at(middle)) >= level) == upward
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        found = high * np.exp(1j * (np.angle(mode.force) - np.angle(force_at(high))))
        return np.where(np.isfinite(distance.min(axis=0)), found, np.nan)


def balance_of(found: Identification) -> AmplitudeBalance:
    """Return the balance that predicts an identified structure."""
    return MeasuredBalance(found) if found.model.sensors else AmplitudeBalance(found)
