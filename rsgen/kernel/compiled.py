"""A compiled force law: carries many test points over periods of the force, on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.kernel.generation import generate, parameter_order
from rsgen.kernel.store import load_kernel

__all__ = ["Kernel", "March", "compile_kernel"]

_LANES = 64  # as in the template
_POINTS_WORTH_A_THREAD = 4 * _LANES


@dataclass(frozen=True, slots=True, eq=False)
class March:
    """Where n points are after some periods of the force.

    Parameters
    ----------
    state
        (n, 2) displacement [m] and velocity [m/s].
    trail
        (n, 2, 2) the states two periods and one period before.
    harmonics
        (n, H+1) complex displacement of the last period [m]; (n, 0) where none was recorded.
    peak
        (n, 2) largest and smallest displacement of the last period [m]; (0, 2) where none were recorded.
    """

    state: NDArray[np.float64]
    trail: NDArray[np.float64]
    harmonics: NDArray[np.complex128]
    peak: NDArray[np.float64]


def threads() -> int:
    """How many cores work on one march: ``RSGEN_THREADS`` where it is set, else all of this process."""
    chosen = os.environ.get("RSGEN_THREADS", "")
    if chosen.isdigit() and int(chosen) > 0:
        return int(chosen)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


@lru_cache(maxsize=1)
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    # the process is part of the key: threads do not survive a fork
    return ThreadPoolExecutor(count, thread_name_prefix="rsgen-march")


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
        state: NDArray[np.float64],
        force: NDArray[np.complex128],
        omega: NDArray[np.float64],
        mass: float,
        values: NDArray[np.float64],
        *,
        steps: int,
        periods: int,
        harmonics: int | None = None,
        peaks: bool = True,
    ) -> March:
        """Carry points over some periods of f(t) = Re F exp(i omega t), from t = 0.

        Parameters
        ----------
        state
            (n, 2) displacement [m] and velocity [m/s] at the start; left as it is.
        force, omega
            (n,) complex F [N] and angular frequency [rad/s].
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
        n = len(omega)
        after = np.array(state, dtype=np.float64, order="C")
        trail = np.empty((n, 2, 2))
        waves = np.empty((n, 0 if harmonics is None else harmonics + 1), dtype=np.complex128)
        wave = waves.view(np.float64)
        peak = np.empty((n if peaks and harmonics is not None else 0, 2))
        parts = np.column_stack([force.real, force.imag])
        table = _phases(steps)

        def run(first: int, stride: int) -> None:
            self._march(
                after, trail, parts, omega, mass, values, table, periods, first, stride, wave, peak
            )  # fmt: skip

        count = min(threads(), -(-n // _POINTS_WORTH_A_THREAD))
        if count > 1:
            list(_pool(os.getpid(), threads()).map(run, range(count), [count] * count))
        elif n:
            run(0, 1)
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
