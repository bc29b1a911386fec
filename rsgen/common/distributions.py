"""Quantiles and tails of the distributions by which fits and intervals are judged.

SciPy is loaded by the first question: that takes a tenth of a second, and looking at a case asks none.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = [
    "chi_square_exceeded",
    "f_quantile",
    "f_tail",
    "normal_quantile",
    "normal_share",
    "t_quantile",
]


def _special() -> Any:
    return import_module("scipy.special")


def normal_share(value: float) -> float:
    """Give the probability that a standard normal number is below a value."""
    return float(_special().ndtr(value))


def normal_quantile(share: float) -> float:
    """Give what a standard normal number is below with probability ``share``."""
    return float(_special().ndtri(share))


def t_quantile(freedom: Any, share: float) -> Any:
    """Give what a number of Student's distribution is below with probability ``share``, of any freedoms."""
    return _special().stdtrit(freedom, share)


def f_tail(above: float, below: float, value: float) -> float:
    """Give the probability that a ratio of variances, of these degrees of freedom, exceeds a value."""
    return float(_special().fdtrc(above, below, value))


def f_quantile(above: float, below: float, share: float) -> float:
    """Give what a ratio of variances, of these degrees of freedom, is below with probability ``share``."""
    return float(_special().fdtri(above, below, share))


def chi_square_exceeded(freedom: int, chance: float) -> float:
    """Give what a sum of so many squares of standard normal numbers exceeds with probability ``chance``."""
    return float(_special().chdtri(freedom, chance))
