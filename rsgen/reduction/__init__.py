"""From a law as it is written to pieces behind switches: abs, sign, Heaviside, Piecewise, Min, Max disappear.

``form`` is the algebra of sums of terms behind unit steps, ``steps`` finds where a smooth function changes
its sign, ``law`` walks through an expression. Types with names for users live in ``rsgen.element``.
"""

from rsgen.reduction.form import ALWAYS, Form, Key
from rsgen.reduction.law import inner_switches, reduce_law

__all__ = ["ALWAYS", "Form", "Key", "inner_switches", "reduce_law"]
