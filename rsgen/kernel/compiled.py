"""A compiled force law: carries many test points over periods of the force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.kernel.generation import generate, parameter_order
from rsgen.kernel.store import load_kernel

__all__ = ["Kernel", "March", "compile_kernel"]


@dataclass(frozen=True, slots=True, eq=False)
class March:
    """Where k lanes are after some periods of the force.

    Parameters
    ----------
    state
        (2, k) y = (x, v/omega) [m], so that both parts weigh the same.
    trail
        (2, 2, k) the states two periods and one period before.
    harmonics
        (k, H+1) complex displacement of the last period [m]; (k, 0) where none was recorded.
    peak
        (k, 2) largest and smallest displacement of the last period [m]; (0, 2) where none were recorded.
    """

    state: NDArray[np.float64]
    trail: NDArray[np.float64]
    harmonics: NDArray[np.complex128]
    peak: NDArray[np.float64]


@lru_cache(maxsize=32)
def _phases(steps: int) -> NDArray[np.float64]:
    angle = np.pi / steps * np.arange(2 * steps)
    return np.ascontiguousarray([np.cos(angle), np.sin(angle)])


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """The compiled law and the order of its parameters.

    Parameters
    ----------
    parameters
        Names in the order in which ``march`` takes their values.
    """

    parameters: tuple[str, ...]
    _march: Callable[..., Any]

    def march(
        self,
        points: NDArray[np.intp],
        state: NDArray[np.float64],
        force: NDArray[np.float64],
        omega: NDArray[np.float64],
        mass: float,
        values: NDArray[np.float64],
        *,
        steps: int,
        periods: int,
        harmonics: int | None = None,
        peaks: bool = True,
    ) -> March:
        """Carry lanes over some periods of f(t) = Re F exp(i omega t), from t = 0.

        Parameters
        ----------
        points
            (k,) the test point of each lane, a row of ``force`` and ``omega``.
        state
            (2, k) y = (x, v/omega) [m] at the start; left as it is.
        force, omega
            (n, 2) real and imaginary part of F [N], and (n,) angular frequency [rad/s].
        mass
            m [kg].
        values
            (P,) values of the parameters [SI], ordered as ``parameters``.
        steps
            Steps in a period, at least 16.
        periods
            How many.
        harmonics
            Record the mean and harmonics 1 to this in the last period; None: record nothing.
        peaks
            Record the peaks besides.
        """
        k = len(points)
        after = np.array(state, dtype=np.float64, order="C")
        trail = np.empty((2, 2, k))
        waves = np.empty((k, 0 if harmonics is None else harmonics + 1), dtype=np.complex128)
        peak = np.empty((k if peaks and harmonics is not None else 0, 2))
        self._march(
            points, after, trail, force, omega, mass, values, _phases(steps), periods,
            waves.view(np.float64), peak,
        )  # fmt: skip
        return March(after, trail, waves, peak)


@lru_cache(maxsize=64)
def compile_kernel(force: sympy.Expr, *, locate_all: bool = False) -> Kernel:
    """Compile a force law, or find it compiled.

    Parameters
    ----------
    force
        n(x, v) [N].
    locate_all
        As in ``generate``.

    Raises
    ------
    ExpressionError
        The law holds a function that no law may use.
    RsgenError
        The compiled law can be kept nowhere.
    """
    return Kernel(parameter_order(force), load_kernel(generate(force, locate_all=locate_all)))
