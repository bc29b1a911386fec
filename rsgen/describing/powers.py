"""Real powers: |sin|**p |cos|**q over quarters of a cycle, by gamma functions.

The quarter integral is half a beta function,
integral_0^(pi/2) sin**p cos**q = Gamma((p+1)/2) Gamma((q+1)/2) / (2 Gamma((p+q)/2 + 1))
(Abramowitz and Stegun, 6.2.1 and 6.2.2); with q = 0 it is the factor of docs/method.md, 3 for |x|**(p-1) x.
"""

from __future__ import annotations

import sympy

from rsgen.common.errors import ExpressionError

__all__ = ["over_quarters", "quarter"]


def quarter(p: sympy.Expr, q: sympy.Expr) -> sympy.Expr:
    """Integrate sin**p cos**q over a quarter of a cycle; p and q real, both above -1."""
    half = sympy.Rational(1, 2)
    return sympy.gamma((p + 1) * half) * sympy.gamma((q + 1) * half) / (2 * sympy.gamma((p + q) * half + 1))


def over_quarters(
    m: int, p: sympy.Expr, n: int, q: sympy.Expr, only_positive_x: bool, only_positive_v: bool
) -> sympy.Expr:
    """Integrate sin**m |sin|**p cos**n |cos|**q over a cycle, or where sin (cos) is positive.

    Raises
    ------
    ExpressionError
        The integral has no finite value.
    """
    sides_x = 1 if only_positive_x else 2 * (m % 2 == 0)
    sides_v = 1 if only_positive_v else 2 * (n % 2 == 0)
    if not sides_x * sides_v:
        return sympy.S.Zero
    for power in (m + p, n + q):
        if (power <= -1) == True:  # noqa: E712 - a sympy relation, undecided is no
            raise ExpressionError(
                f"law: a power is so singular at zero that the force has no fundamental (it needs the "
                f"integral of |sin|**({power}), which is not finite); use an exponent above -2 of x or v"
            )
    return sides_x * sides_v * quarter(m + p, n + q)
