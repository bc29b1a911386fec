"""Results of a run for people and other programs: result.json, report.html, notebook.ipynb, index."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.report.files import draw_all, write_report
    from rsgen.report.page import write_index

__all__ = ["draw_all", "write_index", "write_report"]

# the sentences of this package need no figures, whose library takes half a second
__getattr__ = on_first_use(__name__, {"draw_all": "files", "write_index": "page", "write_report": "files"})
