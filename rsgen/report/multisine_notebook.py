"""The lesson on a case with a multisine, executed, that calls the public API only."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rsgen.case import Case
from rsgen.comparison import Comparison
from rsgen.figures import Drawing
from rsgen.identification import MultisineIdentification
from rsgen.measurement import MeasuredTest
from rsgen.multisine import MultisineSpectra
from rsgen.prediction.multisine import MultisinePrediction
from rsgen.report.notebook import render_lesson, save_lesson
from rsgen.report.notebook_cells import KnownResults

__all__ = ["write_multisine_notebook"]


def write_multisine_notebook(
    path: Path,
    case: Case,
    spectra: MultisineSpectra,
    found: MultisineIdentification,
    comparison: Comparison,
    prediction: MultisinePrediction,
    drawings: Sequence[Drawing],
) -> None:
    """Write, execute and save the lesson; it is saved even where a cell fails.

    Parameters
    ----------
    case
        As it was loaded.
    spectra, found, comparison, prediction, drawings
        What the run has, so that it is not computed again.

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
        held_out=bool(prediction.records),
    )
    results = KnownResults(case)
    results.add("simulate", case.oscillator, case.test, result=spectra)
    results.add("read", case, result=spectra)
    results.add("identify", spectra, case.model, result=found)
    results.add("compare", found, case.truth, case.accept, result=comparison)
    results.add("predict", found, result=prediction)
    for drawing in drawings:
        seen = prediction if drawing.name == "predicted-record" else found
        results.add(f"draw_{drawing.name.replace('-', '_')}", seen, result=drawing)
    save_lesson(path, notebook, results)
