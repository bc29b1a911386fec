"""Force laws as compiled functions: SymPy to readable Python to machine code, cached on disk."""

from __future__ import annotations

from rsgen.dynamics.kernel.compiled import Integrated, Kernel, cache_fault, cache_folder, compile_kernel
from rsgen.dynamics.kernel.generation import generate, parameter_order

__all__ = [
    "Integrated",
    "Kernel",
    "cache_fault",
    "cache_folder",
    "compile_kernel",
    "generate",
    "parameter_order",
]
