"""Case files: TOML to the objects of rsgen, every fault at once; the only place that knows pydantic."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.cases.case import Case, case_schema
    from rsgen.cases.loading import DATA_VARIABLE, find_cases, load_case, name_clashes, read

__all__ = ["DATA_VARIABLE", "Case", "case_schema", "find_cases", "load_case", "name_clashes", "read"]

# a table [test] alone has no law, and is read without the library of algebra
__getattr__ = on_first_use(
    __name__,
    {
        "Case": "case",
        "DATA_VARIABLE": "loading",
        "case_schema": "case",
        "find_cases": "loading",
        "load_case": "loading",
        "name_clashes": "loading",
        "read": "loading",
    },
)
