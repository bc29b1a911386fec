"""Sentences about predictions."""

from __future__ import annotations

from rsgen.report.wording.sentences import NEXT_STEPS, say_plainly

say_plainly(
    {
        "curve-extrapolated": (
            "the curve of {level:.3q} leaves the tested amplitudes ({low:.3q} to {high:.3q}): nothing is "
            "known of the law there"
        ),
        "curves-need-mass": (
            "the mass is not known, so that neither resonance curves nor held-out levels are predicted: off "
            "resonance both depend on it"
        ),
        "no-steady-state": "no steady state in the tested frequencies under {level:.3q}",
        "held-out-points-missing": (
            "{missing:.0f} of {points:.0f} points of the held-out level {level:.3q} (sweep {sweep}) have no "
            "predicted steady state near the measured one"
        ),
        "held-out-by-label": (
            "hold_out = {label:g} is the label of the level of {level:.3q}, which is held out; the level at "
            "which {label:g} was measured is not"
        ),
        "held-out-missed": (
            "the held-out level {level:.3q} (sweep {sweep}) is predicted with an error of {error:.0%}, "
            "against a misfit of {misfit:.2p} where the law was fitted"
        ),
    }
)

NEXT_STEPS["held-out-missed"] = (
    "Identify with this level, too, and see whether the law still fits; if it does not, try another law or "
    "fewer levels."
)
