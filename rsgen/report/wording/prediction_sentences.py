"""Sentences about predictions."""

from __future__ import annotations

from rsgen.report.wording.sentences import say_plainly

say_plainly(
    {
        "curve-extrapolated": (
            "the curve of {level:.3q} leaves the tested amplitudes ({low:.3q} to {high:.3q}): nothing is "
            "known of the law there"
        ),
        "no-steady-state": "no steady state in the tested frequencies under {level:.3q}",
        "held-out-points-missing": (
            "{missing:.0f} of {points:.0f} points of the held-out level {level:.3q} (sweep {sweep}) have no "
            "predicted steady state near the measured one"
        ),
    }
)
