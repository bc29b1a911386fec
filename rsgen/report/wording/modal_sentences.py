"""Sentences about modal tables."""

from __future__ import annotations

from rsgen.report.wording.sentences import say_plainly

say_plainly(
    {
        "modal-mass-unknown": (
            "all {points:.0f} points of the modal table lie at phase resonance, where the mass is not "
            "identifiable: k/m and c are known, stiffness and damping ratio are not; give the mass, or "
            "measure one slice off resonance"
        ),
        "modal-across": (
            "the modal table is over the amplitude of the response; the motion across two sensors, which was "
            "measured, too, may have another course, so that k and c need not be one curve"
        ),
        "modal-scattered": (
            "the points of the modal table depart by {misfit:.1%} from one curve k(X) and one curve c(X): "
            "noise, several modes in the band, or a response that depends on more than its amplitude"
        ),
    }
)
