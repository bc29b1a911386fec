"""Time histories to response surfaces: swept sine, stepped sine, free decay.

With the samples of force and response as arrays, two lines make a surface::

    history = rsgen.data.history.TimeHistory(400, force, acceleration, "acceleration")  # sampled at 400 Hz
    surface = rsgen.data.history.from_swept_sine(history)

``TimeHistory.from_times`` takes instants in place of the sampling rate. Several histories (levels, up and
down) go in as a list. ``from_stepped_sine`` and ``from_free_decay`` do the same for the other tests, and
``from_multisine`` makes the spectra of a periodic multisine, which ``identify`` takes as well;
``follow_decay`` gives frequency and damping of a free decay against its amplitude, and ``record_findings``
finds where a record is clipped or stands still.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.data.history.decay import FreeDecay, follow_decay, from_free_decay
    from rsgen.data.history.multisine_records import from_multisine
    from rsgen.data.history.record import TimeHistory, record_findings
    from rsgen.data.history.stepped_sine import from_stepped_sine
    from rsgen.data.history.swept_sine import from_swept_sine
    from rsgen.data.history.tracking import SweepLaw

__all__ = [
    "FreeDecay",
    "SweepLaw",
    "TimeHistory",
    "follow_decay",
    "from_free_decay",
    "from_multisine",
    "from_stepped_sine",
    "from_swept_sine",
    "record_findings",
]

__getattr__ = on_first_use(
    __name__,
    {
        "FreeDecay": "decay",
        "SweepLaw": "tracking",
        "TimeHistory": "record",
        "follow_decay": "decay",
        "from_free_decay": "decay",
        "from_multisine": "multisine_records",
        "from_stepped_sine": "stepped_sine",
        "from_swept_sine": "swept_sine",
        "record_findings": "record",
    },
)


def __dir__() -> list[str]:
    return __all__
