"""Faults of the algebra library on texts that nobody would write: a refusal of the law, with its kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from rsgen.common.errors import ExpressionError

__all__ = ["algebra_faults"]

_LIBRARIES = ("sympy", "mpmath")


@contextmanager
def algebra_faults() -> Iterator[None]:
    """Turn a fault that the algebra library raises into a refusal of the law.

    It raises some on numbers that it cannot compare, such as the root of a number of 600 digits less another
    one, and calls itself without end on some nested cases.

    Raises
    ------
    ExpressionError
        The library raised; what rsgen raises itself passes as it is.
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as fault:
        # those of its polynomials and limits are of no class of Python's own
        if not isinstance(fault, RecursionError) and not _of_library(fault.__traceback__):
            raise
        raise ExpressionError(
            f"law: the algebra library cannot work it out ({type(fault).__name__}); write it with fewer "
            "cases or functions in each other, or with less extreme numbers"
        ) from fault


def _of_library(trace: TracebackType | None) -> bool:
    """Whether a fault began in the algebra library."""
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and str(trace.tb_frame.f_globals.get("__name__")).startswith(_LIBRARIES)
