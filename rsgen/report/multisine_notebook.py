"""The lesson on a case with a multisine, executed, that calls the public API only."""

from __future__ import annotations

from pathlib import Path

from rsgen.cases import Case
from rsgen.data.multisine import MultisineSpectra
from rsgen.files import MeasuredTest
from rsgen.report.notebook import render_lesson, save_lesson
from rsgen.report.notebook_cells import KnownResults

__all__ = ["write_multisine_notebook"]


def write_multisine_notebook(
    path: Path, case: Case, spectra: MultisineSpectra, results: KnownResults
) -> None:
    """Write, execute and save the lesson; it is saved even where a cell fails.

    Parameters
    ----------
    case
        As it was loaded.
    spectra
        Of its test.
    results
        What else is known, so that it is not computed again.

    Raises
    ------
    RsgenError
        A cell failed; the notebook with its traceback is on disk.
    """
    notebook = render_lesson(
        "notebook/multisine.txt",
        title=case.title or case.name,
        source=case.source,
        case_text=case.text,
        simulated=not isinstance(case.test, MeasuredTest),
        known=case.truth is not None,
        held_out=bool(case.model.observation.hold_out),
    )
    results.add("simulate", case.oscillator, case.test, result=spectra)
    results.add("read", case, result=spectra)
    save_lesson(path, notebook, results)
