"""Modal tables: resonance frequency, damping ratio, stiffness and damping over the amplitude, no law."""

from __future__ import annotations

from rsgen.identification.modal.modal_result import ModalTable
from rsgen.identification.modal.modal_table import modal_table

__all__ = ["ModalTable", "modal_table"]
