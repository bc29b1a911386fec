"""Exact describing functions: equivalent stiffness and damping of any force law, each with its proof.

The cycle x = X0 + X sin(phi), v = omega X cos(phi) is split at the angles at which switches of the normal
form go on and off. ``arcs`` integrates powers of sine and cosine between them, ``powers`` real powers by
gamma functions, ``bessel`` trigonometric, hyperbolic and exponential laws; ``terms`` says which addend is
which and ``closed`` sums them. ``regimes`` writes the sum as cases in X, ``limits`` its ends, ``mean``
balances the mean, ``quadrature`` integrates what has no closed form, ``proof`` compares, ``printed`` holds
the formulas of a source against ours, and ``derivation`` leads through it.

Of laws with memory ``remembering`` adds the parts: ``masing`` has closed forms of Masing laws by the pieces
of their ``virgin`` curves, ``branches`` their loops for quadrature, ``loops`` the closed loops of states,
which ``stepping`` advances.
"""

from rsgen.describing.derivation import derive
from rsgen.describing.function import DescribingFunction, Equivalent, variables_of
from rsgen.describing.limits import Limit
from rsgen.describing.printed import PrintedComparison, compare_printed

__all__ = [
    "DescribingFunction",
    "Equivalent",
    "Limit",
    "PrintedComparison",
    "compare_printed",
    "derive",
    "variables_of",
]
