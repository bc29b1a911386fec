"""Forward models: from parameters to force and motion at every test point; here the harmonic balance.

At a given amplitude X of the fundamental and a frequency the balance of  m a + n(x, v) - f  in every harmonic
has one solution, also where the response folds over the force; so it serves for measured points on any branch
(slices of constant amplitude). With one harmonic it is first-order harmonic balance, Liu et al.,
Eqs. (4), (5). The other forward model is the simulator, which is given the force (``simulator.py``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, ComplexArray, blocks, blocks_joined
from rsgen.common.tolerances import BLOCK, SAMPLES, TO_REST, TRIAL_STEPS
from rsgen.law.motion import FourierSeries, Motion, fourier_series
from rsgen.law.numeric import ForceLaw

__all__ = ["Forward", "HarmonicBalance", "Response", "following_harmonics", "hold_amplitude"]


_SETTLED = 1e-10
"""Relative step at which the harmonics have converged: the next one would be its square."""

_CONVERGED = 1e-6
"""Relative last step that is still called convergence."""

_FAR = 0.5
"""Relative change beyond which slopes no longer lead from one trial to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Force and motion at n points with H harmonics, and derivatives by q parameters (laws, then the mass).

    All phases count from one reference a point; ``size`` is what the forward model is asked for at each
    point, the amplitude X of the fundamental (harmonic balance) or that of the force (simulator).

    Parameters
    ----------
    force
        (n,) complex [N].
    harmonics
        (n, H+1) complex [m]; those that are not predicted are zero.
    force_slope, harmonics_slope
        (n,), (n, H+1): derivatives by the logarithm of the size.
    force_by, harmonics_by
        (n, q), (n, H+1, q): derivatives by the parameters.
    valid
        (n,) False where there is no prediction.
    force_load, harmonics_load
        (n, L), (n, H+1, L): derivatives by real and imaginary parts of the other harmonics of the force
        [N]; None where none were given.
    load_orders
        (L,) which harmonic each of them is a part of.
    force_phase
        (n,) derivative of the force by the phase of the reference; None where all of it follows the response.
    force_noise
        (n,) noise of the balance of forces, relative to that of the force alone; None where it is that.
    """

    force: ComplexArray
    harmonics: ComplexArray
    force_slope: ComplexArray
    harmonics_slope: ComplexArray
    force_by: ComplexArray
    harmonics_by: ComplexArray
    valid: NDArray[np.bool_]
    force_load: ComplexArray | None = None
    harmonics_load: ComplexArray | None = None
    load_orders: NDArray[np.intp] | None = None
    force_phase: ComplexArray | None = None
    force_noise: Array | None = None

    def select(self, chosen: Chosen) -> Response:
        """Take some of the points."""
        part: dict[str, Any] = {
            name: None if (column := getattr(self, name)) is None else column[chosen]
            for name in self.columns()
        }
        return replace(self, **part)

    @classmethod
    def columns(cls) -> list[str]:
        """Names of what has a row a point."""
        return [name for name in cls.__dataclass_fields__ if name != "load_orders"]


class Forward(Protocol):
    """From values to the response at every test point."""

    harmonics: tuple[int, ...]
    """Predicted ones other than the fundamental."""

    step: float
    """Change of the logarithm of the size by which second derivatives are taken."""

    exact_slopes: bool
    """Whether slopes are those of every call; else they stay for many."""

    def __call__(self, values: Array, mass: float, size: Array, phase: Array | None = None) -> Response:
        """Predict at (p,) values, a mass [kg], (n,) sizes and phases [rad] of the reference.

        A force that follows the response alone does not depend on the phase.
        """
        ...


def following_harmonics(law: ForceLaw, order: int, *, even: bool = False) -> tuple[int, ...]:
    """Harmonics up to ``order`` that follow from the fundamental: no even ones for an odd law.

    ``even`` says that the force has even harmonics of its own.
    """
    if law.odd and not even:
        return tuple(range(3, order + 1, 2))
    mean = (0,) if law.springs else ()
    return (*mean, *range(2, order + 1))


def hold_amplitude(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega: Array,
    amplitude: Array,
    start: ComplexArray,
    follow: tuple[int, ...],
    samples: int,
    load: ComplexArray | None = None,
) -> Response:
    """Solve the balance at given amplitudes of the fundamental, whose phase is zero.

    Parameters
    ----------
    law, values, mass
        The force law, its (p,) parameters and m [kg].
    omega, amplitude
        (n,) [rad/s] and X [m].
    start
        (n, H+1) first guess of the harmonics that follow [m].
    follow
        Harmonics that follow from the balance: a subset of 0, 2, ..., H.
    samples
        Samples a period, more than four times H.
    load
        (n, H+1) harmonics of the force [N] in the phase of the fundamental of the response; the fundamental,
        which is sought, is not looked at. None: there are no others.
    """
    # odd harmonics under an odd law repeat with the other sign after half a period; loops need the whole
    half = law.odd and not law.remembers and all(h % 2 for h in follow)
    series = fourier_series((1, *follow), samples, half)
    others = np.zeros((len(omega), 0)) if load is None else series.real(load[:, list(series.orders)])[:, 2:]
    load_orders = np.round(series.order_of[2:]).astype(np.intp) if others.shape[1] else None
    found = (
        (part, _block(law, values, mass, omega[part], amplitude[part], start[part], series, others[part]))
        for part in blocks(len(omega), BLOCK)
    )
    columns: dict[str, Any] = blocks_joined(len(omega), found, Response.columns())
    return Response(**columns, load_orders=load_orders)


def _block(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega: Array,
    amplitude: Array,
    start: ComplexArray,
    series: FourierSeries,
    load: Array,
) -> Response:
    orders = list(series.orders)
    at = series.real(start[:, orders])
    at[:, 0], at[:, 1] = amplitude, 0.0
    accelerated = -((series.order_of * omega[:, None]) ** 2)
    diagonal = np.arange(at.shape[1])
    update, step = np.zeros_like(at[:, 2:]), np.zeros(len(at))
    for _ in range(TRIAL_STEPS):
        x, v = at @ series.shape, (omega[:, None] * at) @ series.rate
        # only switches ask for the acceleration
        a = (omega[:, None] ** 2 * at) @ series.bend if law.switched else v
        sample = law.sample(x, v, a, (series.step / omega)[:, None], values)
        residual = mass * accelerated * at + sample.force @ series.project
        if load.shape[1]:
            residual[:, 2:] -= load
        tangent = sample.tangent(series, omega)
        tangent[:, diagonal, diagonal] += mass * accelerated
        if at.shape[1] == 2:
            break
        update = _solve(tangent[:, 2:, 2:], residual[:, 2:, None])[..., 0]
        size = np.abs(update).max(axis=1)
        update *= np.minimum(1.0, 0.5 * amplitude / np.maximum(size, 1e-300))[:, None]
        at[:, 2:] -= update
        step = size / amplitude
        if np.all(step < _SETTLED):
            break

    # slopes, and what the last step changed, are those of the place before it
    force = residual[:, :2] - (tangent[:, :2, 2:] @ update[..., None])[..., 0]
    columns = [part @ series.project for part in sample.by_parameter]
    by = np.stack([tangent[:, :, 0], *columns, accelerated * at], axis=-1)
    by[:, :, 0] *= amplitude[:, None]
    higher = -_solve(tangent[:, 2:, 2:], by[:, 2:]) if len(orders) > 1 else by[:, 2:]
    through = by[:, :2] + tangent[:, :2, 2:] @ higher
    fundamental = through[:, 0] + 1j * through[:, 1]
    harmonics = np.zeros(start.shape, dtype=complex)
    harmonics[:, orders] = series.complex(at)
    moved = np.zeros((*start.shape, by.shape[2]), dtype=complex)
    moved[:, orders[1:]] = series.complex(np.concatenate([by[:, :2], higher], axis=1))[:, 1:]
    moved[:, 1, 0] = amplitude
    loads = _by_load(tangent, series, start.shape) if load.shape[1] else {}
    return Response(
        force[:, 0] + 1j * force[:, 1],
        harmonics,
        fundamental[:, 0],
        moved[:, :, 0],
        fundamental[:, 1:],
        moved[:, :, 1:],
        step <= _CONVERGED,
        **loads,
    )


def _by_load(tangent: Array, series: FourierSeries, shape: tuple[int, ...]) -> dict[str, Any]:
    """Derivatives of force and harmonics (n, H+1) by the parts of the force in the harmonics that follow."""
    columns = tangent.shape[1] - 2
    higher = _solve(tangent[:, 2:, 2:], np.broadcast_to(np.eye(columns), (len(tangent), columns, columns)))
    force = tangent[:, :2, 2:] @ higher
    whole = np.concatenate([np.zeros((len(tangent), 2, columns)), higher], axis=1)
    moved = np.zeros((*shape, columns), dtype=complex)
    moved[:, list(series.orders)] = series.complex(whole)
    return {
        "force_load": force[:, 0] + 1j * force[:, 1],
        "harmonics_load": moved,
    }


def _solve(matrix: Array, right: Array) -> Array:
    """Solve a batch; a singular member gets the solution of smallest norm instead of spoiling the batch."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        solution = np.asarray(np.linalg.pinv(np.nan_to_num(matrix)) @ right)
        solution[~np.isfinite(matrix).all(axis=(1, 2))] = np.nan
        return solution


def _place_of_rest(law: ForceLaw, values: Array, size: float) -> float:
    """Displacement [m] near zero at which the law exerts no force, in steps of at most size [m]; or zero."""
    x = np.zeros(1)
    for _ in range(TO_REST):
        sample = law.still(x, values)
        force, slope = float(sample.force[0]), float(sample.by_x[0])
        step = -force / slope if slope > 0 and np.isfinite(force) else np.inf
        if abs(step) < _CONVERGED * size:
            return float(x[0])
        if not np.isfinite(step):
            return 0.0
        x = x + np.clip(step, -size, size)
    return 0.0


class HarmonicBalance:
    """The balance from trial to trial: each begins where slopes lead from the one before.

    Parameters
    ----------
    law
        The force law.
    start
        Motion that leads to the branch that was measured; serves the first trial, and points that did not
        converge.
    order
        Highest harmonic.
    mass_free
        Whether the mass is a parameter.
    about_rest
        Whether motions begin about the place of rest of the law, because the mean of ``start`` is not known.
    load
        (n, K+1) harmonics of the force [N] in the phase of the measured response, of which the fundamental is
        not looked at; None: the force is a sine.
    """

    exact_slopes = True
    step = 1e-4
    """Leaves the second derivatives eight digits: error of central differences h^2, round-off eps/h."""

    noise: Array | None = None
    """Nothing but force and response is measured."""

    def __init__(
        self,
        law: ForceLaw,
        start: Motion,
        order: int,
        *,
        mass_free: bool,
        about_rest: bool = False,
        load: ComplexArray | None = None,
    ) -> None:
        even = load is not None and bool(np.any(load[:, ::2]))
        self.harmonics = following_harmonics(law, order, even=even)
        self.samples = max(SAMPLES, 1 << (6 * order - 1).bit_length())
        self._start = np.zeros((len(start), max(order, 1) + 1), dtype=complex)
        known = [h for h in self.harmonics if h < len(start.orders)]
        self._start[:, known] = start.turned(-np.angle(start.harmonics[:, 1])).harmonics[:, known]
        self._load = None
        if load is not None:
            self._load = np.zeros_like(self._start)
            count = min(load.shape[1], self._start.shape[1])
            turned = Motion(start.omega, load).turned(-np.angle(start.harmonics[:, 1])).harmonics
            self._load[:, :count] = turned[:, :count]
        self._law, self._omega, self._mass_free = law, start.omega, mass_free
        self._about_rest = about_rest and 0 in self.harmonics
        self._last: tuple[Array, Array, int, Response] | None = None

    def weigh(self, values: Array, mass: float, force: Array) -> bool:
        """Count noise of other motions that were measured, as the law at (p,) values does: there are none."""
        return False

    def __call__(self, values: Array, mass: float, size: Array, phase: Array | None = None) -> Response:
        """Solve at (p,) values, a mass [kg] and (n,) amplitudes [m]."""
        parameters = np.append(values, mass)
        if self._about_rest:
            self._start[:, 0] = _place_of_rest(self._law, values, float(np.max(size)))
        guess = self._start
        if self._last is not None:
            before, last, sampled, response = self._last
            same = np.array_equal(before, parameters) and np.array_equal(last, size)
            if same and sampled == self.samples:
                return self._of(response)
            guess = self._next(response, parameters - before, np.log(size / last))
        response = hold_amplitude(
            self._law, values, mass, self._omega, size, guess, self.harmonics, self.samples, self._load
        )
        self._last = (parameters, np.array(size), self.samples, response)
        return self._of(response)

    def _of(self, response: Response) -> Response:
        if self._mass_free:
            return response
        return replace(
            response, force_by=response.force_by[:, :-1], harmonics_by=response.harmonics_by[:, :, :-1]
        )

    def _next(self, response: Response, change: Array, growth: Array) -> ComplexArray:
        along = response.harmonics_slope * growth[:, None] + response.harmonics_by @ change
        size = np.abs(response.harmonics[:, 1:2])
        # what did not converge is not finite at times, and no guide
        with np.errstate(invalid="ignore"):
            near = np.abs(along).max(axis=1, keepdims=True) < _FAR * size
            guess = response.harmonics + np.where(near, along, 0)
        good = response.valid & np.isfinite(guess).all(axis=1)
        return np.where(good[:, None], guess, self._start)
