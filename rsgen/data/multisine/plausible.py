"""Whether records of a multisine, and the mode found from them, have sizes that a vibration test can have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rsgen.common.finding import Finding
from rsgen.data.multisine.spectra import MultisineSpectra, rms
from rsgen.data.surface.plausibility import Sizes, size_findings

__all__ = ["implausible"]


def implausible(
    spectra: MultisineSpectra, *, mass: float | None = None, damping: float | None = None
) -> Iterator[Finding]:
    """Find sizes of another unit, as ``size_findings`` of a surface; amplitudes are sqrt(2) rms.

    Parameters
    ----------
    spectra
        Calibrated.
    mass, damping
        Of the mode [kg] and its smallest damping ratio, where they are known.
    """
    first, last = (end[:, None] for end in spectra.reach())
    taken = (spectra.lines >= first) & (spectra.lines <= last)
    motion = np.where(taken, spectra.mean_response, 0)
    rate = spectra.lines * spectra.omega0
    parts = [float(np.sqrt(2) * rms(motion * rate**power).max()) for power in range(3)]
    strongest = int(np.argmax(np.abs(motion[:, 1:]).max(axis=0))) + 1
    force = float(np.sqrt(2) * spectra.rms_force().max())
    sizes = Sizes(float(spectra.frequency[strongest]), parts[0], parts[1], parts[2], force, mass, damping)
    yield from size_findings(sizes)
