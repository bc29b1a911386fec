"""What a test says otherwise: by another law, with more of a background, by halves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Severity, quantities
from rsgen.common.text_table import Printed, TextTable
from rsgen.common.tolerances import CHANCE, ERRORS, LARGE, NOISY, NORMAL, NOTICEABLE
from rsgen.identification.fitting.least_squares import Alternative


def spread_between(others: Iterable[Alternative], values: Array, error: Array) -> Array:
    """By how much standard errors grow for what alternatives say: (q,) factors of at least 1.

    An interval that rests on one law, one background and all points alike says nothing of that choice. Where
    the points rather want an alternative than not, the variance is that of the noise and the square of what
    it moves (Buckland, Burnham and Augustin, Biometrics 53, 1997).

    Parameters
    ----------
    others
        Alternatives to the fit, each to first order.
    values, error
        (q,) parameters, and their standard errors by noise alone.
    """
    likely = [np.abs(one.shift[: len(values)]) for one in others if one.gain > NORMAL**2]
    moved = np.max([np.zeros(len(values)), *likely], axis=0)
    # of exact data the misfit is that of waveforms, and so is what terms move
    known = np.isfinite(error) & (error > 0) & (moved > NOISY * np.abs(values))
    return np.where(known, np.hypot(1, moved / np.where(known, error, 1.0)), 1.0)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Alternatives(Printed):
    """What each alternative to a fit would move, to first order: ``print`` gives a table in standard errors.

    Parameters
    ----------
    names, error
        Parameters (q,), and their standard errors by noise alone.
    kinds
        By kind and name: a "term" beside the law; where the misfit is systematic also a "background" in
        place of the one there is, and "halves" of the test, identified apart.
    """

    names: tuple[str, ...] = ()
    error: Array = field(default_factory=lambda: np.zeros(0))
    kinds: Mapping[str, Mapping[str, Alternative]] = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[str, str, Alternative]]:
        """Kind, name and alternative, without terms that the law has."""
        every = ((kind, name, one) for kind, of_kind in self.kinds.items() for name, one in of_kind.items())
        return (entry for entry in every if np.isfinite(entry[2].error))

    @property
    def known(self) -> tuple[str, ...]:
        """Parameters with an error."""
        return tuple(n for n, e in zip(self.names, self.error, strict=True) if np.isfinite(e) and e > 0)

    def shifts(self, one: Alternative) -> dict[str, float]:
        """What an alternative moves each of the ``known`` parameters by, in standard errors."""
        moved = zip(self.names, one.shift, self.error, strict=False)
        # tenths: what is less is round-off of exact data
        return {name: round(shift / error, 1) + 0.0 for name, shift, error in moved if name in self.known}

    def judge(self, values: Array, misfit: float) -> tuple[Array, list[Finding]]:
        """Widen errors by what alternatives say, and doubt a value that one of them leaves open.

        Parameters
        ----------
        values
            (q,) of the parameters.
        misfit
            Relative, of the law [1]: corners and transients leave some, of which no value is doubted.

        Returns
        -------
        ratio, findings
            (q,) by which standard errors grow, and what is said of the alternative that moves a value most
            among those that stand out of the noise: a doubt where the interval leaves a tenth of it open.
        """
        ratio = spread_between((one for _, _, one in self), values, self.error)
        found, wider = list[Finding](), float(np.median(ratio[self.error > 0])) if self.known else 1.0
        if self.kinds.get("halves"):
            names = {"by": "other terms, backgrounds and halves of the test"}
            found = [Finding("intervals-widened", "warning", numbers=quantities(wider=wider), names=names)]
        share, said = np.zeros(len(values)), ("", "", 0.0)
        for kind, name, one in self:
            shift = one.shift[: len(values)]
            clear = (ratio > 1) & (np.abs(shift) > ERRORS * self.error) & (one.gain >= CHANCE**2)
            moved = np.where(clear, shift / values, 0.0)
            if np.max(np.abs(moved)) > np.max(np.abs(share)):
                share, said = moved, (kind, name, float(np.sqrt(one.gain)))
        worst, (kind, name, errors) = int(np.argmax(np.abs(share))), said
        if not kind:
            return ratio, found
        open_ = NORMAL * self.error[worst] * ratio[worst] > LARGE * abs(values[worst])
        severity: Severity = "doubt" if open_ and misfit > NOTICEABLE else "warning"
        numbers = quantities(errors=errors, moved=share[worst])
        return ratio, [*found, Finding("law-ambiguous", severity, self.names[worst], numbers, {kind: name})]

    def _table(self) -> TextTable:
        rows = [
            (kind, name, *(f"{z:.1f}" for z in (np.sqrt(one.gain), *self.shifts(one).values())))
            for kind, name, one in self
        ]
        heads = ("alternative", "", "stands out", *self.known)
        return TextTable(
            heads, tuple(rows), caption="What alternatives move, in standard errors by noise alone"
        )
