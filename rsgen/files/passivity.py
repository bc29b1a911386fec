"""Whether force and response, as the case reads them, are those of a structure that takes energy.

A structure without a source of energy takes power from its shaker at every frequency, and its dynamic
stiffness F/X = k(X) - m omega^2 + i omega c(X) falls with the frequency. A phase read in the wrong sense
mirrors the second, a channel with the sign reversed both; neither shows in the quality of a fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsgen.common.finding import Finding
from rsgen.data.surface import ResponseSurface
from rsgen.law.motion import cycle_work

__all__ = ["passivity_findings"]

_FED = -0.1
"""Power over the most that forces and velocities could bring; errors of the phase leave a few percent."""
_RISES = 0.5
"""Correlation of the real part with the square of the frequency that is no falling one with scatter."""
_FEWEST = 8


def _power(surface: ResponseSurface) -> float:
    """Give the power that goes in over the most that could, from -1 to 1."""
    work = cycle_work(surface.force, surface.harmonics[:, 1])
    most = float(surface.frequency @ (np.pi * np.abs(surface.force) * surface.amplitude))
    return float(surface.frequency @ work) / most if most > 0 else 0.0


@np.errstate(all="ignore")
def _slope(surface: ResponseSurface) -> float:
    """Correlate the real part of the dynamic stiffness with the square of the frequency, level by level.

    Numbers that no test has may overflow; then nothing is concluded from them.
    """
    stiffness = surface.force / surface.harmonics[:, 1]
    weight = 1 / np.abs(stiffness) ** 2
    square = surface.frequency**2
    products = np.zeros(3)
    for level in np.unique(surface.level):
        at = surface.level == level
        if np.count_nonzero(at) < _FEWEST:
            continue
        w = weight[at] / weight[at].sum()
        x = square[at] - w @ square[at]
        y = stiffness.real[at] - w @ stiffness.real[at]
        products += w @ (x * y), w @ x**2, w @ y**2
    scale = float(np.sqrt(products[1] * products[2]))
    return float(products[0]) / scale if scale > 0 else 0.0


def passivity_findings(surface: ResponseSurface, sense: str | None, quantity: str) -> tuple[Finding, ...]:
    """Find what is reversed where force and response cannot be those of a passive structure; none or one.

    Parameters
    ----------
    surface
        With phase.
    sense
        How the case reads the phase of the response, "lag" or "lead"; None where it has none to read.
    quantity
        What was recorded: a velocity read in the wrong sense is a displacement mirrored and turned round.
    """
    good = surface.settled & (surface.harmonics[:, 1] != 0) & (surface.force != 0)
    if not surface.phase_known or np.count_nonzero(good) < _FEWEST:
        return ()
    chosen = surface.select(good)
    # signs do not depend on the scale; squares of absurd units would overflow
    chosen = replace(
        chosen,
        force=chosen.force / np.max(np.abs(chosen.force)),
        harmonics=chosen.harmonics / np.max(np.abs(chosen.harmonics[:, 1])),
        frequency=chosen.frequency / np.max(chosen.frequency),
    )
    fed, rises = _power(chosen) < _FED, _slope(chosen) > _RISES
    if not (fed or rises):
        return ()
    names = {"against": " and ".join(["power"] * fed + ["mass"] * rises)}
    if sense is not None:
        names["phase_sense"] = "lag" if sense == "lead" else "lead"
    if fed and rises:
        names["reversed"] = "channel"
    elif sense is None:
        names["reversed"] = "unknown"
    else:
        names["reversed"] = "phase" if fed == (quantity != "velocity") else "channel and phase"
    return (Finding("not-passive", "doubt", names=names),)
