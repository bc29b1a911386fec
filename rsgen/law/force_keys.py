"""What the ``accept`` of a case may judge beside parameters: the whole force of a law."""

from __future__ import annotations

import sympy

from rsgen.formula.memory import remembers

__all__ = ["FORCE_KEYS", "force_keys"]

FORCE_KEYS = {
    "stiffness_force": "stiffness force",
    "damping_force": "damping force",
    "loop_force": "loop force",
}
"""Keys of ``accept`` that judge a whole force, and its name: its largest deviation over the tested range,
relative to its largest value. The stiffness force is n(x, 0), the damping force n(0, v); the force of a law
with memory is that of its loops."""


def force_keys(force: sympy.Expr) -> tuple[str, ...]:
    """Give the keys of FORCE_KEYS that a law has: of one with memory only its loops are defined."""
    return ("loop_force",) if remembers(force) else ("stiffness_force", "damping_force")
