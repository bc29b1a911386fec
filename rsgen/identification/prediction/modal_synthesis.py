"""Responses from a modal table, without a law: nonlinear single-mode synthesis.

k(X) and c(X, omega) of the table take the place of a law in F = X (k - m omega^2 + i omega c), so that the
resonance curve of any force follows by choosing X and solving for omega. Above the amplitudes of the table
nothing is known; below them, on the flanks, inertia and stiffness decide, and k and c are taken as constant.
"""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.common.tolerances import ANY_LAW
from rsgen.data.oscillator import Model
from rsgen.identification.fitting.forward import Response
from rsgen.identification.modal import ModalTable
from rsgen.identification.modal.modal_splines import SplineMode
from rsgen.identification.prediction.amplitude_balance import AmplitudeBalance
from rsgen.identification.prediction.prediction_result import BEYOND
from rsgen.identification.results import EquivalentCurve, Estimate, Identification

__all__ = ["SynthesisBalance", "table_as_identification"]

_MATTERS = 0.05
"""Where k and c below the smallest amplitude seen might change the response by more, relatively, it is not
predicted: a twentieth is as good as most sensors."""


class SynthesisBalance(AmplitudeBalance):
    """The balance of one harmonic with the splines of a modal table in place of a law."""

    def __init__(self, table: ModalTable, frequencies: tuple[float, float]) -> None:
        splines = table.splines
        self._splines, self._mass = splines, splines.mass
        self._covariance = np.nan_to_num(splines.covariance)
        self._least, self._largest = splines.basis.lowest, table.tested[1]
        self._centre = np.pi * sum(frequencies)
        self._tabulate(BEYOND * self._largest)

    def solve(self, size: Array, omega: Array, start: ComplexArray | None = None) -> Response:
        """Force that holds the amplitudes X [m] at the frequencies [rad/s]; both (n,)."""
        splines = self._splines
        mode = SplineMode(omega, splines.basis, splines.orders, mass_free=True)
        return mode(splines.values, splines.mass, size)

    def _tabulate(self, largest: float) -> None:
        """Keep the backbone up to an amplitude [m]: to the end of the table, never beyond."""
        super()._tabulate(min(largest, BEYOND * self._largest))

    def respond(self, force: ComplexArray, omega: Array, near: Array) -> ComplexArray:
        """As of a law; NaN beyond the table, and below it where k and c would matter."""
        found = super().respond(force, omega, near)
        size = np.abs(found)
        with np.errstate(divide="ignore", invalid="ignore"):
            # a force that is smooth changes k by no more than its slope there, by ln X, down to rest
            below = np.clip(np.log(self._least / size), 0.0, 1.0)
            changed = self._drift(omega) * below * size / np.abs(force)
            known = (size <= BEYOND * self._largest) & (changed < _MATTERS)
        return np.where(known, found, np.nan)

    def _drift(self, omega: Array) -> Array:
        """(n,) change of the dynamic stiffness [N/m] by ln X at the lower end of the table."""
        size = np.full(len(omega), self._least * BEYOND)
        at = self.solve(size, omega)
        return np.asarray(np.abs(at.force_slope - at.force) / size)


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
            per_mass=test.per_mass,
        ),
        residual=table.misfit / np.sqrt(2),
        noise=table.misfit,
        levels=test.levels,
        amplitude_range=table.tested,
        frequency_range=test.frequencies,
        outcome=Finding("values-given", "info"),
        solution=np.zeros(len(Model(ANY_LAW).parameters)),
        background=test.background,
    )
