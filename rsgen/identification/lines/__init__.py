"""Laws from periodic multisines: weighted least squares of the balance of forces at every line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.identification.lines.line_identification import identify_multisine

__all__ = ["identify_multisine"]

# most tests have one line a record
__getattr__ = on_first_use(__name__, {"identify_multisine": "line_identification"})
