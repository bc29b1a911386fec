"""What a run leaves for people and for other programs: result.json, report.html, notebook.ipynb, index."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsgen.report.index import write_index
    from rsgen.report.write_report import draw_all, write_report

__all__ = ["draw_all", "write_index", "write_report"]

_PLACES = {"draw_all": "write_report", "write_index": "index", "write_report": "write_report"}


def __getattr__(name: str) -> Any:
    # on first use: the sentences of this package need no figures, whose library takes half a second
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = value
    return value
