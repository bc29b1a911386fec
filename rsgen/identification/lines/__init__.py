"""Laws from periodic multisines: weighted least squares of the balance of forces at every line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.identification.lines.line_identification import fit_multisine, identify_multisine
    from rsgen.identification.lines.modal_lines import table_of_lines

__all__ = ["fit_multisine", "identify_multisine", "table_of_lines"]

# most tests have one line a record
__getattr__ = on_first_use(
    __name__,
    {
        "fit_multisine": "line_identification",
        "identify_multisine": "line_identification",
        "table_of_lines": "modal_lines",
    },
)
