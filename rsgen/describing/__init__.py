"""Exact describing functions: equivalent stiffness and damping of any force law, each with its proof.

    k = 1/(pi X) integral n sin(phi) dphi,  c = 1/(pi omega X) integral n cos(phi) dphi,  integral n dphi = 0

The cycle x = X0 + X sin(phi), v = omega X cos(phi) is split at the angles at which switches of the normal
form go on and off. ``closed`` integrates powers of sine and cosine between them and sums the addends;
``bessel`` has trigonometric, hyperbolic and exponential laws. ``regimes`` writes the sum as cases in X, with
its ends, ``quadrature`` integrates what has no closed form, ``function`` balances the mean and holds the
formulas and those of a source against them, and ``derivation`` leads through it.

Of laws with memory ``remembering`` adds the parts: ``masing`` has closed forms of Masing laws by the pieces
of their virgin curves, the others are projected along the closed loops of their states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.describing.remembering import add_memory, split_by_memory

__all__ = ["add_memory", "split_by_memory"]

# most laws have no memory
__getattr__ = on_first_use(__name__, dict.fromkeys(__all__, "remembering"))
