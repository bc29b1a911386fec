"""What a kernel hands over from one call to the next for a law with memory: the rows of its states."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ALONE", "DEEPEST", "EVERYTHING", "NOTHING", "WITHIN", "MemoryRows"]

DEEPEST = 16
"""Reversals on the stack of a Masing law. When it is full, the pair next to the outermost reversal goes:
a transient has decayed for eight periods without closing a loop then, and the outermost reversal leads back
to the virgin curve."""

NOTHING, ALONE, EVERYTHING, WITHIN = 0.0, 1.0, 2.0, 3.0
"""What the memory of a Masing law is at the start: none, a closed loop and nothing else, all its rows, a
closed loop from which a larger motion leads to the virgin curve around its middle."""


@dataclass(frozen=True, slots=True)
class MemoryRows:
    """Which row is what: x and v/omega, ``states`` with equations, then those of ``curves`` Masing laws.

    The loop of a Masing law, its largest and smallest displacement, are numbers on which the motion depends
    smoothly, as on the states; the other rows are only carried along.
    """

    states: int
    curves: int

    @property
    def first(self) -> int:
        """The first row of the Masing laws: the largest displacement of the loop."""
        return 2 + self.states

    @property
    def smooth(self) -> int:
        """D, the rows on which the motion depends smoothly: they come first."""
        return self.first + (2 if self.curves else 0)

    @property
    def names(self) -> list[str]:
        """What stands in each row from ``first`` on, as the kernel names it; then the stack."""
        if not self.curves:
            return []
        forces = range(self.curves)
        return [
            "XT", "XB", "KIND", *(f"OFFSET + {c}" for c in forces), "CENTER", "SW", "IW", "XR", "XP",
            *(f"NR + {c}" for c in forces), "DEPTH", "TURNS",
        ]  # fmt: skip

    def row(self, name: str) -> int:
        """The row of a name; that of the first curve where each has one."""
        return self.first + self.names.index(name)

    @property
    def stack(self) -> int:
        """The first row of the stack: displacements, then the forces of each curve, DEEPEST rows each."""
        return self.first + len(self.names)

    @property
    def count(self) -> int:
        """R, all rows."""
        return self.stack + (DEEPEST * (1 + self.curves) if self.curves else 0)
