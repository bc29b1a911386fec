"""The identified structure at a given amplitude: forces, frequencies and responses that belong to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.common.tolerances import ANY_LAW, NORMAL, ORDER, SAMPLES
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import Response, following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import Inertia
from rsgen.identification.fitting.across import MeasuredAcross, law_of
from rsgen.identification.modal_result import ModalTable, SplineMode
from rsgen.identification.prediction.prediction_result import BEYOND
from rsgen.identification.results import EquivalentCurve, Estimate, Identification
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law

_ORDER_WITH_JUMPS = 3
"""Where friction holds the mass for a while, higher harmonics of a balance do not settle."""

_SAMPLES_SWITCHED = 128
"""A period, of a law with switches: a curve is drawn, not fitted."""

_COARSE = 120
"""Amplitudes at which the least force that holds them is tabulated."""

_SMALLEST = 1e-4
"""Smallest amplitude of the table, relative to the largest tested."""

_FINE = 25
"""Amplitudes of each of three looks at an edge: every look divides the interval by 24."""

_ROUNDS = 12
"""Iterations to a frequency at most: stiffness and damping change little with it."""

_CLOSE = 1e-7
"""Relative change at which a frequency is found."""

_EXACT = 1e-8
"""Relative error of the force at which a descent ends: far below the noise of any test."""

_DESCENT = 40
"""Newton steps at most: by a fifth each they reach a thousandth of the start, and a thousand times it."""

_NEXT = 0.5
"""Newton steps from the measured amplitude that lead farther, relatively, have left its branch."""


class AmplitudeBalance:
    """The balance of an identified structure as a function of amplitude and frequency."""

    about: tuple[Finding, ...] = ()
    """What a reader of its predictions should know."""

    def __init__(self, identification: Identification) -> None:
        self._law = compile_law(identification.model.force)
        self._values = np.array(identification.solution)
        self._mass = identification.mass
        self._order = _ORDER_WITH_JUMPS if self._law.jumps else ORDER
        self._following = following_harmonics(self._law, self._order)
        self._samples = _SAMPLES_SWITCHED if self._law.switched else SAMPLES
        self._covariance = np.nan_to_num(identification.covariance)
        names = (*self._law.parameters, "m")
        self._places = [names.index(estimate.name) for estimate in identification.refined]
        self._largest = identification.amplitude_range[1]
        self._centre = np.pi * sum(identification.frequency_range)
        self._tabulate(2 * self._largest)

    def drawn(self, levels: list[float]) -> list[float]:
        """Which levels have a curve: all of them."""
        return levels

    def solve(self, size: Array, omega: Array, start: ComplexArray | None = None) -> Response:
        """Hold the amplitudes X [m] at the frequencies [rad/s]; both (n,)."""
        guess = np.zeros((len(size), self._order + 1), dtype=complex) if start is None else start
        hold = partial(hold_amplitude, self._law, self._values, Inertia(self._mass))
        at = hold(omega, size, guess, self._following, self._samples)
        lost = ~(at.valid & np.isfinite(at.force))
        if not lost.any():
            return at
        # first order where the higher harmonics do not settle
        mean = tuple(h for h in self._following if h == 0)
        rough = hold(omega[lost], size[lost], np.zeros_like(guess[lost]), mean, self._samples)
        merged = {}
        for entry in fields(Response):
            if getattr(at, entry.name) is None:
                continue
            merged[entry.name] = np.array(getattr(at, entry.name))
            merged[entry.name][lost] = getattr(rough, entry.name)
        return Response(**merged)

    def force_spread(self, at: Response) -> Array:
        """(n,) half width of the 95 % band of the force amplitude [N]."""
        slope = (np.conj(at.force)[:, None] * at.force_by[:, self._places]).real / np.abs(at.force)[:, None]
        variance = np.einsum("np,pq,nq->n", slope, self._covariance, slope)
        return np.asarray(NORMAL * np.sqrt(np.maximum(variance, 0.0)))

    def _equivalent(
        self, size: Array, omega: Array, start: ComplexArray | None
    ) -> tuple[Array, Array, ComplexArray]:
        at = self.solve(size, omega, start)
        stiffness = at.force / size
        guess = np.where(np.isfinite(at.harmonics), at.harmonics, 0)
        return stiffness.real + self._mass * omega**2, stiffness.imag / omega, guess

    def _settle(
        self, size: Array, omega: Array, square: Callable[[Array, Array, Array], Array]
    ) -> tuple[Array, Array, Array, Array]:
        """Iterate omega^2 = square(u, k, X), u = k/m - c^2/(2 m^2), as k and c depend on omega.

        Gives omega [rad/s], k [N/m], u and the last square [rad^2/s^2], each (n,).
        """
        omega, (stiffness, middle, last) = np.array(omega), np.full((3, len(size)), np.nan)
        start: ComplexArray | None = None
        moving = np.arange(len(size))
        for _ in range(_ROUNDS):
            stiff, damping, start = self._equivalent(size[moving], omega[moving], start)
            stiffness[moving] = stiff
            middle[moving] = stiff / self._mass - 0.5 * (damping / self._mass) ** 2
            last[moving] = square(middle[moving], stiff, size[moving])
            new = np.sqrt(np.where(last[moving] > 0, last[moving], np.nan))
            far = np.abs(new / omega[moving] - 1) >= _CLOSE
            omega[moving] = np.where(np.isfinite(new), new, omega[moving])
            if not far.any():
                break
            moving, start = moving[far], start[far]
        return omega, stiffness, middle, last

    def backbone(self, size: Array, guess: Array) -> tuple[Array, Array]:
        """(n,) frequency [rad/s] at which each amplitude takes the least force, and that force [N].

        There the two frequencies at which a level holds the amplitude meet, below the phase resonance where
        damping is strong: u = omega^2 = k/m - c^2/(2 m^2), F^2 = X^2 (k^2 - m^2 u^2). NaN where the least
        force is at rest or the equivalent stiffness is not positive. ``guess`` is (n,) [rad/s].
        """
        omega, stiffness, middle, _ = self._settle(size, guess, lambda middle, *_: middle)
        known = (stiffness > 0) & (middle > 0)
        least = size * np.sqrt(np.maximum(stiffness**2 - (self._mass * middle) ** 2, 0.0))
        return np.where(known, omega, np.nan), np.where(known, least, np.nan)

    def _tabulate(self, largest: float) -> None:
        """Keep the backbone up to an amplitude [m]."""
        size = np.geomspace(_SMALLEST * self._largest, largest, _COARSE)
        omega, force = self.backbone(size, np.full(len(size), self._typical(self._largest)))
        self._table = (size, omega, force)

    def _near(self, size: Array) -> Array:
        """Frequency [rad/s] of the resonance from the table: a good first guess."""
        table, omega, _ = self._table
        known = np.isfinite(omega)
        return (
            np.interp(size, table[known], omega[known]) if known.any() else np.full(len(size), self._centre)
        )

    def _typical(self, size: float) -> float:
        """Some frequency near the resonance at an amplitude."""
        omega = self._centre
        for _ in range(20):
            stiffness, _, _ = self._equivalent(np.array([size]), np.array([omega]), None)
            new = float(np.sqrt(abs(stiffness[0] / self._mass)))
            if not new > 0 or abs(new - omega) < 1e-3 * omega:
                break
            omega = new
        return omega

    def spans(self, level: float, window: tuple[float, float]) -> list[tuple[float, float]]:
        """Ranges of the amplitude [m] that the level [N] can hold at some frequency, ascending."""
        for _ in range(8):
            # enlarge until the level no longer holds the largest amplitude at its resonance
            size, _, force = self._table
            if not force[-1] < level:
                break
            self._tabulate(2 * float(size[-1]))
        size, _, force = self._table
        held = force <= level
        edges = np.flatnonzero(np.diff(held.astype(int)) != 0)
        ends = [self._edge(float(size[i]), float(size[i + 1]), level) for i in edges]
        if held[0]:
            ends.insert(0, self._lowest(level, window))
        if held[-1]:
            ends.append(float(size[-1]))
        return [(low, high) for low, high in zip(ends[::2], ends[1::2], strict=False) if high > low]

    def _edge(self, low: float, high: float, level: float) -> float:
        """Amplitude between two others at which the level just holds the resonance."""
        for _ in range(3):
            size = np.linspace(low, high, _FINE)
            _, force = self.backbone(size, self._near(size))
            held = force <= level
            i = int(np.flatnonzero(np.diff(held.astype(int)) != 0)[0]) if held.any() and not held.all() else 0
            low, high = float(size[i]), float(size[i + 1])
        return low if held[i] else high

    def _lowest(self, level: float, window: tuple[float, float]) -> float:
        """A little less than the smallest amplitude within the window of frequencies."""
        size = np.full(2, 1e-3 * self._largest)
        at = self.solve(size, np.array(window))
        return float(0.8 * np.min(level * size / np.abs(at.force)))

    def frequencies(self, size: Array, level: float, side: int) -> Array:
        """(n,) frequency [rad/s] below (side -1) or above (+1) the resonance at which the level holds X.

        NaN where there is none.
        """

        def square(middle: Array, stiffness: Array, size: Array) -> Array:
            # (k - m u)^2 + u c^2 = (F/X)^2 is quadratic in u = omega^2 while k and c stay
            root = middle**2 + ((level / size) ** 2 - stiffness**2) / self._mass**2
            return np.asarray(middle + side * np.sqrt(np.maximum(root, 0.0)))

        omega, _, _, last = self._settle(size, self._near(size), square)
        return np.where(last > 0, omega, np.nan)

    def respond(self, mode: ResponseSurface) -> ComplexArray:
        """(n,) complex fundamental [m] under its force, on the stable branch nearest to the measured one."""
        force, omega, near = mode.force, mode.omega, mode.amplitude
        level = np.abs(force)
        size, ok = self._descend(level, omega, np.array(near))
        if not ok.all():
            size[~ok] = self._scan(level[~ok], omega[~ok], near[~ok])
        known = np.isfinite(size)
        result = np.full(len(size), np.nan + 0j)
        if known.any():
            at = self.solve(size[known], omega[known])
            result[known] = size[known] * force[known] / level[known] * np.exp(-1j * np.angle(at.force))
        return result

    def _descend(self, level: Array, omega: Array, size: Array) -> tuple[Array, NDArray[np.bool_]]:
        start, first = None, np.array(size)
        gain = np.ones(len(size))
        miss = np.full(len(size), np.inf)
        for _ in range(_DESCENT):
            at = self.solve(size, omega, start)
            start = np.where(np.isfinite(at.harmonics), at.harmonics, 0)
            gain = (np.conj(at.force) * at.force_slope).real / np.abs(at.force) / size
            miss = np.abs(at.force) - level
            if np.all(np.abs(miss) <= _EXACT * level):
                break
            step = miss / np.where(np.abs(gain) > 1e-300, gain, 1e-300)
            size = size - np.clip(step, -0.2 * size, 0.2 * size)
        good = (np.abs(miss) <= 1e-6 * level) & (gain > 0) & (np.abs(size / first - 1) < _NEXT)
        return size, good

    def _scan(self, level: Array, omega: Array, near: Array) -> Array:
        """Stable amplitude nearest to ``near`` by a scan over all amplitudes; NaN where there is none."""
        sizes = np.geomspace(1e-3 * self._largest, 3 * self._largest, _COARSE)
        rows = np.repeat(np.arange(len(level)), len(sizes))
        force = np.abs(self.solve(np.tile(sizes, len(level)), omega[rows]).force).reshape(len(level), -1)
        result = np.full(len(level), np.nan)
        for i, (row, wanted) in enumerate(zip(force, level, strict=True)):
            up = np.flatnonzero((row[:-1] < wanted) & (row[1:] >= wanted))
            if len(up):
                share = (wanted - row[up]) / (row[up + 1] - row[up])
                roots = sizes[up] + share * (sizes[up + 1] - sizes[up])
                result[i] = roots[np.argmin(np.abs(np.log(roots / near[i])))]
        return result


# ----------------------------------------------------------------------------
# Responses from a modal table, without a law: nonlinear single-mode synthesis.
#
# k(X) and c(X, omega) of the table take the place of a law in F = X (k - m omega^2 + i omega c), so that
# the
# resonance curve of any force follows by choosing X and solving for omega. Above the amplitudes of the
# table
# nothing is known; below them, on the flanks, inertia and stiffness decide, and k and c are taken as
# constant.

_MATTERS = 0.05
"""Where k and c below the smallest amplitude seen might change the response by more, relatively, it is not
predicted: a twentieth is as good as most sensors."""


class SynthesisBalance(AmplitudeBalance):
    """The balance of one harmonic with the splines of a modal table in place of a law."""

    def __init__(self, table: ModalTable, frequencies: tuple[float, float]) -> None:
        splines = table.splines
        self._splines, self._mass = splines, splines.mass
        self._covariance = np.nan_to_num(splines.covariance)
        self._places = list(range(len(self._covariance)))
        self._least, self._largest = splines.basis.lowest, table.tested[1]
        self._centre = np.pi * sum(frequencies)
        self._tabulate(BEYOND * self._largest)

    def solve(self, size: Array, omega: Array, start: ComplexArray | None = None) -> Response:
        """Force that holds the amplitudes X [m] at the frequencies [rad/s]; both (n,)."""
        splines = self._splines
        mode = SplineMode(omega, splines.basis, splines.orders)
        return mode(splines.values, splines.mass, size)

    def _tabulate(self, largest: float) -> None:
        """Keep the backbone up to an amplitude [m]: to the end of the table, never beyond."""
        super()._tabulate(min(largest, BEYOND * self._largest))

    def respond(self, mode: ResponseSurface) -> ComplexArray:
        """As of a law; NaN beyond the table, and below it where k and c would matter."""
        found = super().respond(mode)
        size = np.abs(found)
        with np.errstate(divide="ignore", invalid="ignore"):
            # a force that is smooth changes k by no more than its slope there, by ln X, down to rest
            below = np.clip(np.log(self._least / size), 0.0, 1.0)
            changed = self._drift(mode.omega) * below * size / np.abs(mode.force)
            known = (size <= BEYOND * self._largest) & (changed < _MATTERS)
        return np.where(known, found, np.nan)

    def _drift(self, omega: Array) -> Array:
        """(n,) change of the dynamic stiffness [N/m] by ln X at the lower end of the table."""
        size = np.full(len(omega), self._least * BEYOND)
        at = self.solve(size, omega)
        return np.asarray(np.abs(at.force_slope - at.force) / size)


# ----------------------------------------------------------------------------
# Responses of a law across two sensors: only where the motion across was measured with the response.

_RANGE = (0.1, 10.0)
"""Amplitudes that are tried, relative to the measured one: an error of that size predicts nothing."""

_TRIED = 120
"""Amplitudes in that range: four per cent apart, closer than the branches of a jump lie."""

_NEAR = np.linspace(0.9, 1.1, 201)
"""Amplitudes near the measured one, a thousandth apart: two states that lie closer are one measurement."""

_HALVINGS = 40
"""Of an interval of four per cent: to round-off."""


class MeasuredBalance(AmplitudeBalance):
    """The balance of a law across two sensors: only where the motion across was measured too."""

    def __init__(self, identification: Identification) -> None:
        self._law = law_of(identification.model.elements)
        self._values, self._mass = np.array(identification.solution), identification.mass
        names = {"sensors": identification.model.sensors}
        self.about = (Finding("predicted-along-measured", "info", names=names),)

    def drawn(self, levels: list[float]) -> list[float]:
        """None: there are no curves without the motion across."""
        return []

    def respond(self, mode: ResponseSurface) -> ComplexArray:
        """(n,) complex fundamental [m] under the measured force.

        The motion across goes with the response as it was measured at the same point. Of several amplitudes
        that the force holds the one nearest to the measured one is taken; NaN where there is none.
        """
        if not mode.across.size:
            return np.full(len(mode), np.nan, dtype=complex)
        motions = (Motion(mode.omega, np.nan_to_num(motion)) for motion in (mode.harmonics, mode.across))
        forward = MeasuredAcross(self._law, *motions)
        measured, level = mode.amplitude, np.abs(mode.force)

        def force_at(size: Array) -> ComplexArray:
            return forward(self._values, self._mass, size).force

        sizes = np.union1d(np.geomspace(*_RANGE, _TRIED), _NEAR)
        table = np.array([np.abs(force_at(share * measured)) - level for share in sizes])
        crossed = (table[:-1] < 0) != (table[1:] < 0)
        distance = np.where(crossed, np.abs(np.log(sizes[:-1, None])), np.inf)
        row = np.argmin(distance, axis=0)
        upward = np.take_along_axis(table, row[None, :], axis=0)[0] < 0
        low, high = sizes[row] * measured, sizes[row + 1] * measured
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            above = (np.abs(force_at(middle)) >= level) == upward
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        found = high * np.exp(1j * (np.angle(mode.force) - np.angle(force_at(high))))
        return np.where(np.isfinite(distance.min(axis=0)), found, np.nan)


def balance_of(found: Identification) -> AmplitudeBalance:
    """Make the balance that predicts an identified structure."""
    return MeasuredBalance(found) if found.model.sensors else AmplitudeBalance(found)


def table_as_identification(table: ModalTable) -> Identification:
    """Give what a prediction reads of an identification: ranges, levels, background, misfit, the mass.

    Raises
    ------
    RsgenError
        The mass is not known, so that no response off resonance follows.
    """
    if "damping_ratio" not in table.known:
        raise RsgenError(
            "predict: the modal table has no mass, so that responses off resonance do not follow; give the "
            "mass to modal_table, or measure off resonance"
        )
    none = np.zeros(0)
    test = table.test
    return Identification(
        model=Model(ANY_LAW, observation=test.observation),
        paper=(),
        first_order=(),
        refined=(Estimate("m", table.splines.mass, 0.0, (table.splines.mass,) * 2, "kg"),),
        first_order_bias=(),
        covariance=np.zeros((1, 1)),
        resonances=(),
        curve=EquivalentCurve(
            none,
            none,
            none,
            none,
            none,
            none.astype(bool),
            level_unit=test.level_unit,
            units=test.units,
        ),
        residual=table.misfit,
        noise=table.misfit,
        levels=test.levels,
        amplitude_range=table.tested,
        frequency_range=test.frequencies,
        outcome=Finding("identified", "info"),
        solution=np.zeros(len(Model(ANY_LAW).parameters)),
        background=test.background,
    )
