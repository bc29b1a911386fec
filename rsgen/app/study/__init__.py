"""From case files to finished reports: one case, many cases, and what makes a result a result."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.app.study.folder import MANIFEST, read_manifest
from rsgen.app.study.run_case import CaseRun, Step, obtain_table, run_case
from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.app.study.many_cases import run_cases

__all__ = ["MANIFEST", "CaseRun", "Step", "obtain_table", "read_manifest", "run_case", "run_cases"]

# most commands have one case and need no processes
__getattr__ = on_first_use(__name__, {"run_cases": "many_cases"})
