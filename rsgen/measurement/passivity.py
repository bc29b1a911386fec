"""Whether force and response, as the case reads them, are those of a structure that takes energy.

A structure without a source of energy takes power from its shaker at every frequency, and its dynamic
stiffness F/X = k(X) - m omega^2 + i omega c(X) falls with the frequency. A phase read in the wrong sense
mirrors the second, a channel with the sign reversed both; neither shows in the quality of a fit.
"""

from __future__ import annotations

import numpy as np

from rsgen.surface import ResponseSurface

__all__ = ["energy_note"]

_FED = -0.1
"""Power over the most that forces and velocities could bring; errors of the phase leave a few percent."""
_RISES = 0.5
"""Correlation of the real part with the square of the frequency that is no falling one with scatter."""
_FEWEST = 8


def _power(surface: ResponseSurface) -> float:
    """Give the power that goes in over the most that could, from -1 to 1."""
    velocity = 2j * np.pi * surface.frequency * surface.harmonics[:, 1]
    work = np.real(surface.force * velocity.conj())
    most = float(np.sum(np.abs(surface.force) * np.abs(velocity)))
    return float(np.sum(work)) / most if most > 0 else 0.0


def _slope(surface: ResponseSurface) -> float:
    """Correlate the real part of the dynamic stiffness with the square of the frequency, level by level."""
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


def energy_note(surface: ResponseSurface, sense: str | None, quantity: str) -> tuple[str, ...]:
    """Say what is reversed where force and response cannot be those of a passive structure.

    Parameters
    ----------
    surface
        With phase.
    sense
        How the case reads the phase of the response, "lag" or "lead"; None where it has none to read.
    quantity
        What was recorded: a velocity read in the wrong sense is a displacement mirrored and turned round.

    Returns
    -------
    One sentence, or none.
    """
    good = surface.settled & (surface.harmonics[:, 1] != 0) & (surface.force != 0)
    if not surface.phase_known or np.count_nonzero(good) < _FEWEST:
        return ()
    kept = surface.select(good)
    fed, rises = _power(kept) < _FED, _slope(kept) > _RISES
    if not (fed or rises):
        return ()
    odd = ["the structure would feed energy into the shaker"] if fed else []
    odd += ["the moving mass would be negative"] if rises else []
    told = f"as the case reads force and response, {' and '.join(odd)}"
    sign = "give test.response.factor the other sign"
    if fed and rises:
        return (f"{told}: a channel is probably reversed; {sign}",)
    if sense is None:
        return (f"{told}: the channels are probably late against each other, or one is reversed",)
    turn = f'set test.response.phase_sense = "{"lag" if sense == "lead" else "lead"}"'
    if fed == (quantity != "velocity"):
        return (f"{told}: the phase is probably reversed; {turn}",)
    return (f"{told}: a channel and its phase are probably reversed; {turn} and {sign}",)
