"""A compiled force law that integrates many test points over periods of the force.

    m x'' + n(x, x') = Re F exp(i omega t),    (x, x'/omega) at t = 0  ->  the same q periods later

``generation`` writes the integrator as source and says how it works, ``store`` compiles and keeps it. Here
the arrays are checked, because machine code checks nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.dynamics.kernel.generation import MemoryRows, generate, parameter_order
from rsgen.dynamics.kernel.store import load_kernel
from rsgen.law.memory import memory_form

_WORK_NUMBERS = 1024 * 64
"""Numbers of work space: more rows of 64 points than any law that can be read needs."""

_space = threading.local()


@dataclass(frozen=True, slots=True, eq=False)
class Integrated:
    """Where k points are after some periods of the force.

    Parameters
    ----------
    state
        (R, k) y = (x, v/omega) [m], so that both parts weigh the same; then what a law remembers, as in
        ``MemoryRows``.
    history
        (2, D, k) the rows on which the motion depends smoothly, two periods and one period before.
    harmonics
        (k, H+1) complex displacement of the last period [m]; (k, 0) where none was recorded.
    peak
        (k, 2) largest and smallest displacement of the last period [m]; (0, 2) where none were recorded.
    """

    state: Array
    history: Array
    harmonics: ComplexArray
    peak: Array


@lru_cache(maxsize=32)
def _phases(steps: int) -> Array:
    angle = np.pi / steps * np.arange(2 * steps)
    return np.ascontiguousarray([np.cos(angle), np.sin(angle)])


def _address(array: NDArray[Any]) -> int:
    address: int = array.__array_interface__["data"][0]
    return address


def _work() -> Array:
    """Work space of one thread."""
    if not hasattr(_space, "rows"):
        _space.rows = np.zeros(_WORK_NUMBERS)
    rows: Array = _space.rows
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """The compiled law and the order of its parameters.

    Parameters
    ----------
    parameters
        Names in the order in which ``integrate`` takes their values.
    rows
        What stands in the rows of a state.
    """

    parameters: tuple[str, ...]
    rows: MemoryRows
    _enter: Callable[..., Any]

    def integrate(
        self,
        points: NDArray[np.intp],
        state: Array,
        force: Array,
        omega: Array,
        mass: float,
        values: Array,
        *,
        steps: int,
        periods: int,
        harmonics: int | None = None,
        peaks: bool = True,
    ) -> Integrated:
        """Integrate points over some periods of f(t) = Re F exp(i omega t), from t = 0.

        Parameters
        ----------
        points
            (k,) rows of ``force`` and ``omega``; a row may occur more than once.
        state
            (R, k) y = (x, v/omega) [m], then what the law remembers, at the start; left as it is. Without the
            stack of reversals (``MemoryRows.stack`` rows) the memory of Masing laws is a closed loop alone.
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
            Record the peaks, too.

        Raises
        ------
        RsgenError
            Shapes or types of the arrays do not belong together.
        """
        k, columns = len(points), 0 if harmonics is None else harmonics + 1
        size = self.rows.stack if len(state) == self.rows.stack else self.rows.count
        after = np.array(state, dtype=np.float64, order="C")
        history = np.empty((2, self.rows.smooth, k))
        waves = np.empty((k, columns), dtype=np.complex128)
        peak = np.empty((k if peaks and columns else 0, 2))
        rows = np.ascontiguousarray(points, dtype=np.int64)
        F, w = np.ascontiguousarray(force), np.ascontiguousarray(omega)
        p = np.ascontiguousarray(values)
        # machine code checks nothing: shapes and types must be right here
        if (
            after.shape != (size, k) or F.shape != (len(w), 2) or p.shape != (len(self.parameters),)
            or not all(a.dtype == np.float64 for a in (F, w, p))
            or (k and not (rows.min() >= 0 and rows.max() < len(w)))
        ):  # fmt: skip
            raise RsgenError(
                f"integrate: {k} points, states {after.shape}, forces {F.shape}, {len(w)} frequencies, "
                f"{len(p)} values do not belong together; (k,), ({size}, k), (n, 2), (n,) and (P,) of "
                "float64 are needed"
            )
        self._enter(
            _address(rows), k, _address(after), size, _address(history), _address(F), _address(w), len(w),
            mass, _address(p), len(p), _address(_phases(steps)), steps, periods,
            _address(waves), 2 * columns, _address(peak), len(peak), _address(_work()),
        )  # fmt: skip
        return Integrated(after, history, waves, peak)


def compile_kernel(
    force: sympy.Expr,
    *,
    values: Mapping[str, float] | None = None,
    locate_all: bool = False,
    coarse: bool = False,
) -> Kernel:
    """Compile a force law, or find it compiled.

    Parameters
    ----------
    force
        n(x, v) [N].
    values, locate_all, coarse
        As in ``generate``.

    Raises
    ------
    ExpressionError
        The law holds a function that no law may use.
    """
    source = generate(force, values=values, locate_all=locate_all, coarse=coarse)
    memory = memory_form(force)
    rows = MemoryRows(0, 0) if memory is None else MemoryRows(len(memory.rates), len(memory.curves))
    return Kernel(parameter_order(force), rows, load_kernel(source))
