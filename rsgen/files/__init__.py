"""Measured files to response surfaces: one reader a format, one plan for where what is found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.files.files_to_surface import read_measurement
    from rsgen.files.surface_file import load_surface

__all__ = ["load_surface", "read_measurement"]

# a process that opens a file of strangers loads what it needs for that alone
__getattr__ = on_first_use(__name__, {"load_surface": "surface_file", "read_measurement": "files_to_surface"})
