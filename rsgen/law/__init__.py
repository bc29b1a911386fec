"""Force laws: elements, their normal form, their numbers along a motion, and the library."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.law.loops import compile_loops

__all__ = ["compile_loops"]

# most laws have no loops
__getattr__ = on_first_use(__name__, {"compile_loops": "loops"})
