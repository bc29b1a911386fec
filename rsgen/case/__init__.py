"""Case files: TOML to the objects of rsgen, every fault at once; the only place that knows pydantic."""

from __future__ import annotations

from rsgen.case.case import Case
from rsgen.case.case_list import find_cases, name_clashes
from rsgen.case.document import case_schema
from rsgen.case.load_case import DATA_VARIABLE, load_case, read

__all__ = ["DATA_VARIABLE", "Case", "case_schema", "find_cases", "load_case", "name_clashes", "read"]
