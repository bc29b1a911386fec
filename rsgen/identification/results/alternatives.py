"""Alternatives to a fit, to first order: another term, a larger background, halves of the test.

Errors are widened by the shift that an alternative makes, sigma^2 + weight shift^2: model averaging of two
laws that are equally likely before the test (Buckland, Burnham and Augustin, Biometrics 53, 1997).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import exp

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity, Severity, quantities
from rsgen.common.text_table import Brief
from rsgen.common.tolerances import (
    MISFIT_NEGLIGIBLE,
    MISFIT_OF_NOISE,
    NOISE_LIMIT_SIGMAS,
    RELATIVE_ERROR_DOUBTFUL,
    STANDARD_ERRORS_OF_DIFFERENCE,
    interval_sigmas,
    normal_share,
)
from rsgen.data.oscillator import BACKGROUNDS
from rsgen.identification.fitting.least_squares import Alternative

CHANCE_OF_ALTERNATIVE = 0.05
"""Noise that gives an alternative of several columns its gain more often than this does not count for it."""

_WIDENED = 2.0
"""An interval that an alternative widens more than so many times is mostly that of the choice of the law."""


def weight_of(one: Alternative) -> float:
    """Return the weight of an alternative: of one column its likelihood over the sum of both; of several,
    whose shifts noise alone makes large, 1 where noise has such a gain less than once in twenty, else 0.
    """
    return 1 / (1 + exp(-one.gain / 2)) if one.columns == 1 else float(one.exceeds(CHANCE_OF_ALTERNATIVE))


def spread_between(others: Iterable[Alternative], values: Array, error: Array) -> Array:
    """Return the factors (q,), at least 1, by which alternatives widen standard errors.

    The interval of one law with one background does not contain the uncertainty of that choice: the variance
    is that of noise plus the largest square of a shift times the weight of its alternative.

    Parameters
    ----------
    others
        Alternatives to the fit, each to first order.
    values, error
        (q,) parameters, and their standard errors by noise alone.
    """
    shifts = [np.sqrt(weight_of(one)) * np.abs(one.shift[: len(values)]) for one in others]
    moved = np.max([np.zeros(len(values)), *shifts], axis=0)
    # the misfit of exact data, and the shift by terms, are due to truncated waveforms
    known = np.isfinite(error) & (error > 0) & (moved > MISFIT_OF_NOISE * np.abs(values))
    return np.where(known, np.hypot(1, moved / np.where(known, error, 1.0)), 1.0)


def stands_out(one: Alternative) -> bool:
    """Return True if noise gives an alternative its gain less often than four standard errors to a value."""
    return one.exceeds(2 * normal_share(-NOISE_LIMIT_SIGMAS))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Alternatives(Brief):
    """Shifts of the parameters by alternatives, to first order; ``rsgen.compare_fits(found)`` shows them.

    Parameters
    ----------
    names, error
        Parameters (q,), and their standard errors by noise alone.
    kinds
        Alternatives by kind and name: an additional "term", a larger "background", and, if they disagree,
        "halves" of the test, identified separately.
    """

    names: tuple[str, ...] = ()
    error: Array = field(default_factory=lambda: np.zeros(0))
    kinds: Mapping[str, Mapping[str, Alternative]] = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[str, str, Alternative]]:
        """Iterate over kind, name and alternative, without terms of the law."""
        every = ((kind, name, one) for kind, of_kind in self.kinds.items() for name, one in of_kind.items())
        return (entry for entry in every if np.isfinite(entry[2].error))

    @property
    def any_stands_out(self) -> bool:
        """True if some alternative takes up more than noise of four standard errors."""
        return any(stands_out(one) for _, _, one in self)

    def largest(self, values: Array) -> dict[str, Alternative]:
        """Return, by name, the alternatives of each kind that widen an error of values (q,) most, by much."""
        found = {}
        for kind, of_kind in self.kinds.items():
            wider = {
                name: float(np.max(spread_between([one], values, self.error)))
                for name, one in of_kind.items()
            }
            name = max(wider, key=wider.__getitem__, default="")
            if name and wider[name] > _WIDENED:
                found[f"{kind}: {name}"] = of_kind[name]
        return found

    def judge(self, values: Array, misfit: float) -> tuple[Array, list[Finding]]:
        """Return factors that widen the errors, and findings about a value that an alternative changes.

        Parameters
        ----------
        values
            (q,) values of the parameters.
        misfit
            Relative misfit of the law [1]; no value is doubted for that of corners and transients.

        Returns
        -------
        ratio, findings
            (q,) factors of the standard errors; findings about the interval that is widened most, and about
            the largest significant shift: a doubt if the interval is wider than a tenth of the value.
        """
        fitted = list(self)
        widening = [spread_between([one], values, self.error) for _, _, one in fitted]
        ratio = np.max([np.ones(len(values)), *widening], axis=0)
        found, widest = list[Finding](), int(np.argmax(ratio))
        if ratio[widest] > _WIDENED:
            kind, name, _ = fitted[int(np.argmax([wider[widest] for wider in widening]))]
            severity: Severity = "warning" if self.kinds.get("halves") else "info"
            numbers = quantities(wider=ratio[widest])
            found = [Finding("intervals-widened", severity, self.names[widest], numbers, {kind: name})]
        share, said = np.zeros(len(values)), ("", "", 0.0)
        for kind, name, one in fitted:
            shift = one.shift[: len(values)]
            clear = (
                (ratio > 1) & (np.abs(shift) > STANDARD_ERRORS_OF_DIFFERENCE * self.error) & stands_out(one)
            )
            moved = np.where(clear, shift / values, 0.0)
            if np.max(np.abs(moved)) > np.max(np.abs(share)):
                share, said = moved, (kind, name, float(np.sqrt(one.gain)))
        worst, (kind, name, errors) = int(np.argmax(np.abs(share))), said
        if not kind:
            return ratio, found
        open_ = interval_sigmas() * self.error[worst] * ratio[worst] > RELATIVE_ERROR_DOUBTFUL * abs(
            values[worst]
        )
        severity = "doubt" if open_ and misfit > MISFIT_NEGLIGIBLE else "warning"
        numbers = quantities(errors=errors, moved=share[worst])
        # one that stands out is named with its shift
        found = [f for f in found if (f.parameter, f.names) != (self.names[worst], {kind: name})]
        return ratio, [*found, Finding("law-ambiguous", severity, self.names[worst], numbers, {kind: name})]

    def within_noise(
        self,
        values: Array,
        covariance: Array,
        reasons: Mapping[str, Finding | None],
        units: Mapping[str, str],
    ) -> list[Finding]:
        """Find what a background that noise hides would move: the test does not tell whether the response has
        other modes. No interval contains such shifts: of a right law that would be far too wide.

        Parameters
        ----------
        values, covariance
            (q,) values of the parameters, and the covariance (q, q) that is stated.
        reasons, units
            By parameter: why it is not identifiable, and its unit.
        """
        other = self.kinds.get("background", {}).get(BACKGROUNDS[-2])
        if other is None or other.hidden is None:
            return []
        error = np.sqrt(np.diag(covariance))
        known = np.array([reasons.get(name) is None for name in self.names]) & (error > 0)
        # the best estimate of a background says little of the one that noise hides: its interval does
        shift = interval_sigmas() * other.hidden[: len(values)]
        # shifts of exact data are due to truncated waveforms
        moved = np.where(known & (shift > MISFIT_OF_NOISE * np.abs(values)), shift / error, 0.0)
        far = moved > NOISE_LIMIT_SIGMAS
        if not far.any():
            return []
        worst = int(np.argmax(moved))
        numbers = quantities(moved=shift[worst] / values[worst], times=moved[worst])
        numbers["shift"] = Quantity(float(shift[worst]), units[self.names[worst]])
        every = ", ".join(name for name, moves in zip(self.names, far, strict=True) if moves)
        names = {"background": BACKGROUNDS[-2], "parameters": every}
        return [Finding("law-ambiguous", "info", self.names[worst], numbers, names)]
