"""Equivalent stiffness and damping as splines of the logarithm of the amplitude: a mode without a law.

At one amplitude X the structure acts as a linear one, F/X = k(X) - m omega^2 + i omega c(X, omega). Off
resonance it matters how c depends on the frequency: a force that does not depend on the rate, as of joints
and friction, has omega c = c_0(X), a linear damper omega c = omega c_1(X), a drag v|v| omega c = omega^2
c_2(X). With B-splines for k and c_j all is linear in their coefficients and in the mass, so that it is one
more forward model, which is given the amplitude. Smooth springs are polynomials of X^2, drag and gaps of X,
friction of 1/X; logarithms give a spring that hardens over decades as many knots everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array
from rsgen.common.splines import b_splines
from rsgen.dynamics.harmonic_balance import Response

__all__ = ["ModalSplines", "SplineBasis", "SplineMode"]


_MARGIN = 0.02
"""Splines reach so far beyond the amplitudes of the points, relatively: noise moves single ones outside."""

_BELOW = 2
"""Intervals below the tested amplitudes, whose points show the background and nothing that is tabulated."""


@dataclass(frozen=True, slots=True, eq=False)
class SplineBasis:
    """B-splines of a given degree, with knots in u = X^power; -X^power if that is negative, ln X if zero."""

    knots: Array
    degree: int
    power: int

    @classmethod
    def over(
        cls, amplitude: Array, tested: tuple[float, float], degree: int, intervals: int, power: int
    ) -> SplineBasis:
        """Share the amplitudes [m] within the tested ones among the intervals; two more serve those below."""
        size = amplitude[(amplitude >= tested[0]) & (amplitude <= tested[1])]
        inner = np.quantile(_place(size, power), np.linspace(0, 1, intervals + 1))
        inner[0] = _place(tested[0] / (1 + _MARGIN), power)
        inner[-1] = _place(float(amplitude.max()) * (1 + _MARGIN), power)
        lowest = float(_place(float(amplitude.min()) / (1 + _MARGIN), power))
        if degree and lowest < inner[0]:
            inner = np.concatenate([np.linspace(lowest, inner[0], _BELOW + 1)[:-1], inner])
        return cls(np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree]), degree, power)

    @property
    def count(self) -> int:
        """How many functions."""
        return len(self.knots) - self.degree - 1

    @property
    def lowest(self) -> float:
        """Smallest amplitude [m] that points have shown."""
        first = float(self.knots[0])
        return float(np.exp(first) if not self.power else abs(first) ** (1 / self.power)) * (1 + _MARGIN)

    def __call__(self, amplitude: Array) -> tuple[Array, Array]:
        """(n, f) functions at amplitudes [m], and their derivatives by ln X; constant beyond the ends."""
        u = _place(amplitude, self.power)
        inside = np.clip(u, self.knots[0], self.knots[-1])
        by_log = np.where(u == inside, self.power * u if self.power else 1.0, 0.0)
        functions, slopes = b_splines(inside, self.knots, self.degree)
        return functions, slopes * by_log[:, None]


def _place(amplitude: ArrayLike, power: int) -> Array:
    """Coordinate u of amplitudes [m], which grows with them."""
    return np.asarray(np.log(amplitude) if not power else np.copysign(np.power(amplitude, power), power))


class SplineMode:
    """The mode as a forward model: values are the coefficients of k [N/m], then those of each c_j.

    ``orders`` are the powers j of omega with which the damping force grows at constant amplitude.
    """

    harmonics: tuple[int, ...] = ()
    exact_slopes = True
    step = 1e-4
    """As of the harmonic balance: error of central differences h^2, round-off eps/h."""

    def __init__(self, omega: Array, basis: SplineBasis, orders: tuple[int, ...], *, mass_free: bool) -> None:
        self._basis, self._mass_free, self._inertia = basis, mass_free, omega**2
        self._factors = [np.ones(len(omega)), *(1j * omega**order for order in orders)]

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (2 f,) coefficients, a mass [kg] and (n,) amplitudes [m]."""
        shape, slope = self._basis(size)
        by = np.concatenate([factor[:, None] * shape for factor in self._factors], axis=1)
        turn = np.concatenate([factor[:, None] * slope for factor in self._factors], axis=1)
        force = np.asarray(size * (by @ values - mass * self._inertia), dtype=np.complex128)
        if self._mass_free:
            by = np.column_stack([by, -self._inertia])
        harmonics = np.zeros((len(size), 2), dtype=np.complex128)
        harmonics[:, 1] = size
        return Response(
            force=force,
            harmonics=harmonics,
            force_slope=np.asarray(force + size * (turn @ values), dtype=np.complex128),
            harmonics_slope=harmonics,
            force_by=size[:, None] * by,
            harmonics_by=np.zeros((len(size), 2, by.shape[1]), dtype=np.complex128),
            valid=np.isfinite(force),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ModalSplines:
    """Fitted splines of k [N/m] and of the damping, the mass m [kg], and what is known of their errors.

    Parameters
    ----------
    basis
        Of all.
    orders
        Powers of omega with which the damping force grows at constant amplitude.
    values
        (f + f o,) coefficients of k, then of the damping of each order.
    mass
        Identified, or given.
    covariance
        (q + 1, q + 1) of the values and of the mass; a given mass has none.
    freedom
        Degrees of freedom of the noise that the covariance rests on.
    others
        Splines of other shapes that fit as well, each with its weight (these make one): where they differ,
        as in gaps between amplitudes, points do not determine k and c.
    """

    basis: SplineBasis
    orders: tuple[int, ...]
    values: Array
    mass: float
    covariance: Array
    freedom: int
    others: tuple[tuple[float, ModalSplines], ...] = ()

    def at(self, amplitude: Array) -> tuple[Array, Array, Array]:
        """k [N/m], c [N s/m] at resonance, each (n,), and the covariance of k, c, m (n, 3, 3); X in m.

        To that of noise comes the spread of the other shapes (Burnham and Anderson, Model Selection and
        Multimodel Inference, 2002, Sec. 4.3).
        """
        k, c, errors = self._alone(amplitude)
        for weight, other in self.others:
            k_other, c_other, _ = other._alone(amplitude)
            mass = np.full(len(k), other.mass - self.mass)
            apart = np.nan_to_num(np.stack([k_other - k, c_other - c, mass], axis=1))
            errors = errors + weight * apart[:, :, None] * apart[:, None, :]
        return k, c, errors

    def _alone(self, amplitude: Array) -> tuple[Array, Array, Array]:
        """What this shape says, with the covariance of noise."""
        shape, _ = self.basis(amplitude)
        parts = self.values.reshape(-1, self.basis.count) @ shape.T
        k = parts[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            omega = np.sqrt(k / self.mass)
            rates = [omega ** (order - 1) for order in self.orders]
            c = np.sum(rates * parts[1:], axis=0)
            # resonance moves with k and m, and c with it
            by_omega = [(j - 1) * rate / omega for j, rate in zip(self.orders, rates, strict=True)]
            turn = np.sum(by_omega * parts[1:], axis=0) * omega / 2
            by_k, by_mass = turn / k, -turn / self.mass
        slopes = np.zeros((len(amplitude), 3, len(self.covariance)))
        count = self.basis.count
        slopes[:, 0, :count] = shape
        slopes[:, 1, :count] = by_k[:, None] * shape
        for place, rate in enumerate(rates, 1):
            slopes[:, 1, place * count : (place + 1) * count] = rate[:, None] * shape
        slopes[:, 1, -1] = by_mass
        slopes[:, 2, -1] = 1.0
        return k, c, slopes @ self.covariance @ np.swapaxes(slopes, 1, 2)

    def respond(self, amplitude: Array, omega: Array) -> NDArray[np.complex128]:
        """(n,) complex force [N] that holds the amplitudes X [m] at frequencies [rad/s]; phase of X zero."""
        mode = SplineMode(omega, self.basis, self.orders, mass_free=False)
        return mode(self.values, self.mass, amplitude).force
