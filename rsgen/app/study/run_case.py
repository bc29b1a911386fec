"""One case, from its file to its folder of results."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import rsgen.identification  # loads the ranking for cases that need it
import rsgen.report
from rsgen.app.study.folder import (
    case_file_of,
    file_hash,
    inputs_unchanged,
    read_manifest,
    recover,
    replaced_folder,
    write_manifest,
)
from rsgen.cases.case import Case, law_faults
from rsgen.cases.loading import load_case, read
from rsgen.common.errors import CaseError, MeasurementError, RsgenError, faults_of, quote, shown_path
from rsgen.common.finding import StatedVerdict
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.simulation import simulate
from rsgen.identification.identify import identify
from rsgen.identification.results import Identification
from rsgen.identification.results.result import table_of
from rsgen.report.result_json import Entry, read_estimate

RESULT = "result.json"


@dataclass(frozen=True, slots=True)
class Step:
    """A case has come to a stage, or to a share of it.

    Parameters
    ----------
    path
        The case file.
    stage
        "surface", "ranking" or "identification", "report", in this order.
    share
        From 0 to 1; stays 0 in a stage that does not report its share.
    """

    path: Path
    stage: str
    share: float


Progress = Callable[[Step], None]


def stage_reporter(case: Case, progress: Progress | None) -> Callable[[str, float], None]:
    """Return a function of stage and share that reports how far a case has come."""
    if progress is None:
        return lambda stage, share: None
    return lambda stage, share: progress(Step(case.path, stage, share))


@dataclass(frozen=True, slots=True)
class CaseRun:
    """Outcome of one case.

    Parameters
    ----------
    path, name
        The case file, and the name in it; the file's where it could not be read.
    folder
        Where the result lies; None where there is none.
    passed
        Whether every value is within the tolerance that ``[accept]`` gives it; None where the case failed.
    skipped
        True where a verified result from the same inputs was there.
    seconds
        How long it took.
    faults
        Why it failed, in sentences.
    verdict
        The entry "verdict" of the result.json; None where the case failed.
    held_out
        How well each held-out level is predicted, and what an untested one is predicted to do, a line each.
    values
        The law and the lines of the table of parameters, as `rsgen identify` prints them.
    warned
        The warnings of the report, without what decided the verdict.
    warnings, notes
        How many of each the report has, without what decided the verdict.
    """

    path: Path
    name: str
    folder: Path | None = None
    passed: bool | None = None
    skipped: bool = False
    seconds: float = 0.0
    faults: tuple[str, ...] = ()
    verdict: StatedVerdict | None = None
    held_out: tuple[str, ...] = ()
    values: tuple[str, ...] = ()
    warned: tuple[str, ...] = ()
    warnings: int = 0
    notes: int = 0


def _inputs(case: Case) -> dict[str, str | None]:
    """SHA-256 of the case and of its measured files: of several, the hash of their hashes."""
    try:
        hashes = [file_hash(path) for path in case.test.all_files]
    except OSError:
        # reading it will say what is wrong, in a sentence
        return {"case": case.sha256, "data": None}
    if not hashes:
        return {"case": case.sha256}
    data = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    return {"case": case.sha256, "data": data}


def check_place(case: Case, out: Path) -> None:
    """Refuse to write results into the folder that holds the case, or over those of another case file.

    Raises
    ------
    RsgenError
        The two are the same; the result of that name is from another file, which is still there.
    """
    where, place = shown_path(case.path), out / case.name
    if case.path.parent.resolve() in (out.resolve(), place.resolve()):
        raise RsgenError(f"{where}: results would go where the case lies; choose another --out")
    other = case_file_of(place)
    if other is not None and not other.samefile(case.path):
        raise RsgenError(
            f"{where}: name: {quote(case.name)} is also the name of {shown_path(other)}, whose result "
            f"is in {shown_path(place)}; give one of them another name, choose another --out, or move that "
            "result away"
        )


def current_result(case: Case, out: Path, figures: str | None = None) -> CaseRun | None:
    """Return the result of an earlier run if its manifest verifies and case, data and program are the same.

    With ``figures``, the kind of file, the figures must be there as well.
    """
    recover(out)
    folder = out / case.name
    manifest = read_manifest(folder)
    if manifest is None or not inputs_unchanged(manifest, _inputs(case)) or RESULT not in manifest["files"]:
        return None
    if figures and not any(name.endswith(f".{figures}") for name in manifest["files"]):
        return None
    try:
        return replace(_finished(case, folder), skipped=True)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _in_one_line(element: Mapping[str, Any]) -> str:
    """Return the force of an element, with the equations of its states."""
    return ", ".join((element["force"], *(f"{z}' = {rate}" for z, rate in element["memory"].items())))


def _finished(case: Case, folder: Path) -> CaseRun:
    """Return what the result in a folder says of a case."""
    result = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    fit = Entry(folder, result).fit()
    small_motion = (read_estimate(one, one) for one in result.get("small_motion", ()))
    severities = [finding["severity"] for finding in result["findings"]]
    said = list(zip(result["findings"], result["warnings"], strict=True))
    asked = [str(text) for finding, text in said if finding["code"] == "level-predicted"]
    return CaseRun(
        case.path,
        case.name,
        folder,
        bool(result["passed"]),
        verdict=result["verdict"],
        held_out=(*(str(entry["said"]) for entry in result["held_out"]), *asked),
        values=(
            " + ".join(_in_one_line(element) for element in result["elements"]),
            *str(table_of((*fit.estimates, *small_motion, *fit.background))).split("\n"),
            *(f"  {line}" for line in (result["outcome"], *result.get("mass_notes", ()))),
        ),
        warned=tuple(f"  warning: {text}" for finding, text in said if finding["severity"] == "warning"),
        warnings=severities.count("warning"),
        notes=severities.count("info"),
    )


def obtain_table(
    case: Case, progress: Callable[[float], None] = lambda share: None
) -> ResponseSurface | MultisineSpectra:
    """Simulate the test of a case, or read its measured files: a response surface, or spectra of a multisine.

    Raises
    ------
    RsgenError
        A file cannot be read, or no motion follows from the law, as ``rsgen check`` says.
    """
    if refused := law_faults(case):
        raise CaseError(refused)
    test: Any = case.test
    try:
        table: ResponseSurface | MultisineSpectra = (
            simulate(case.oscillator, test, progress=progress) if case.oscillator is not None else read(case)
        )
    except MeasurementError as fault:
        raise MeasurementError(f"{shown_path(case.path)}: test.file: {fault}") from fault
    return table


def identify_case(
    case: Case, table: ResponseSurface | MultisineSpectra, report: Callable[[str, float], None]
) -> Identification:
    """Identify the law of a case, or rank laws and identify the best; ``report`` stage and share.

    Raises
    ------
    RsgenError
        As ``identify`` and ``rank``.
    """
    if case.ranked:
        return rsgen.identification.rank(table, case.model, progress=partial(report, "ranking")).best
    report("identification", 0.0)
    return identify(table, case.model)


def _execute(
    case: Case, out: Path, command: Sequence[str], figures: str | None, report: Callable[[str, float], None]
) -> CaseRun:
    check_place(case, out)
    report("surface", 0.0)
    with replaced_folder(out, case.name) as folder:
        inputs = _inputs(case)
        started = time.perf_counter()
        surface = obtain_table(case, lambda share: report("surface", share))
        tested = time.perf_counter()
        identification = identify_case(case, surface, report)
        durations = {"surface": tested - started, "identification": time.perf_counter() - tested}
        report("report", 0.0)
        with _temporary_in(folder):
            # rsgen.report imports pages and figures, 0.5 s, when one of its names is first used
            rsgen.report.write_report(
                folder,
                surface,
                identification,
                case=case,
                durations=durations,
                command=command,
                figures=figures,
            )
        run = _finished(case, folder)
        write_manifest(folder, inputs, case.test.noise_seed, command, case.path)
    return replace(run, folder=out / case.name)


@contextlib.contextmanager
def _temporary_in(folder: Path) -> Iterator[None]:
    """Let temporary files lie in a folder, with which they go if the run is killed; TMPDIR may not exist."""
    before = tempfile.tempdir
    tempfile.tempdir = str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = before
        if os.environ.get("MPLCONFIGDIR", "").startswith(str(folder)):
            # matplotlib removes at exit the folder that it made here, which has gone by then
            atexit.unregister(shutil.rmtree)


def run_case(
    path: str | Path | Case,
    out: str | Path,
    *,
    force: bool = False,
    data: str | Path | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
    progress: Progress | None = None,
) -> CaseRun:
    """Run a case: simulate or read, identify, compare, report; the manifest is written last.

    A fault of the case is a value, so that one case cannot stop others; an earlier result then stays.

    Parameters
    ----------
    path
        The case file, or the case that was loaded from it.
    out
        The folder of all results; this one goes to ``out/<name>``.
    force
        Run even if a verified result from the same inputs is there.
    data
        The folder of measured files; default is the one of RSGEN_DATA, then the case's folder.
    command
        What was called, for the manifest.
    figures
        "pdf", "svg" or "png": every figure is saved as a file, too.
    progress
        Called now and then with how far the case has come.
    """
    started = time.perf_counter()
    place = Path(out)
    file = path.path if isinstance(path, Case) else Path(path)
    name = file.stem
    words = command or ("rsgen", "run", file.name)
    try:
        case = path if isinstance(path, Case) else load_case(path, data)
        name = case.name
        earlier = None if force else current_result(case, place, figures)
        if earlier is not None:
            return earlier
        run = _execute(case, place, words, figures, stage_reporter(case, progress))
    except Exception as fault:
        # a fault of the program must not stop other cases either
        run = CaseRun(file, name, faults=faults_of(fault, shown_path(file)))
    return replace(run, seconds=time.perf_counter() - started)
