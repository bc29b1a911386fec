"""Time histories to response surfaces: swept sine, stepped sine, free decay."""

from __future__ import annotations

from rsgen.history.decay import RingDown, follow_decay
from rsgen.history.record import TimeHistory
from rsgen.history.soundness import record_findings
from rsgen.history.stepped_sine import fit_steps
from rsgen.history.sweep_law import SweepLaw
from rsgen.history.swept_sine import demodulate_sweep

__all__ = [
    "RingDown",
    "SweepLaw",
    "TimeHistory",
    "demodulate_sweep",
    "fit_steps",
    "follow_decay",
    "record_findings",
]
