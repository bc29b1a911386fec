"""What a run leaves for people and for other programs: result.json, report.html, notebook.ipynb, index."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsgen.report.files import draw_all, write_report
    from rsgen.report.index import write_index

__all__ = ["draw_all", "write_index", "write_report"]

_PLACES = {"draw_all": "files", "write_index": "index", "write_report": "files"}


def __getattr__(name: str) -> Any:
    # on first use: the sentences of this package need no figures, whose library takes half a second
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = value
    return value
