"""One case, from its file to its folder of results."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rsgen.case import Case, load_case
from rsgen.case.trial import law_faults
from rsgen.errors import CaseError, RsgenError
from rsgen.measurement import MeasuredTest, read_measurement
from rsgen.simulation import SimulatedTest, simulate
from rsgen.study.folder import recover, replaced_folder
from rsgen.study.manifest import file_hash, inputs_unchanged, read_manifest, write_manifest
from rsgen.study.progress import Progress, stage_reporter
from rsgen.surface import ResponseSurface, load_surface

__all__ = ["CaseRun", "check_place", "current_result", "obtain_surface", "rewrite_report", "run_case"]

RESULT = "result.json"
SURFACE = "surface.h5"


@dataclass(frozen=True, slots=True)
class CaseRun:
    """What became of a case.

    Parameters
    ----------
    path
        The case file.
    name
        The case's name; the file's where it could not be read.
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
    judged
        False where nothing was asked: ``[accept]`` is empty, so ``passed`` says nothing.
    """

    path: Path
    name: str
    folder: Path | None = None
    passed: bool | None = None
    skipped: bool = False
    seconds: float = 0.0
    faults: tuple[str, ...] = ()
    judged: bool = True


def _inputs(case: Case) -> dict[str, str | None]:
    inputs: dict[str, str | None] = {"case": case.sha256}
    if isinstance(case.test, MeasuredTest):
        try:
            hashes = [file_hash(path) for path in (*case.test.files, *case.test.response_files)]
            # of several files the hash of their hashes
            inputs["data"] = (
                hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
            )
        except OSError:
            # reading it will say what is wrong, in a sentence
            inputs["data"] = None
    return inputs


def check_place(case: Case, out: Path) -> None:
    """Refuse to write results into the folder that holds the case.

    Raises
    ------
    RsgenError
        The two are the same.
    """
    if (
        out.resolve() == case.path.parent.resolve()
        or (out / case.name).resolve() == case.path.parent.resolve()
    ):
        raise RsgenError(f"{case.path.name}: results would go where the case lies; choose another --out")


def current_result(case: Case, out: Path, figures: str | None = None) -> CaseRun | None:
    """Give the result of an earlier run if its manifest verifies and case, data and program are the same.

    With ``figures``, the kind of file, the figures must be there as well.
    """
    recover(out, case.name)
    folder = out / case.name
    manifest = read_manifest(folder)
    if manifest is None or not inputs_unchanged(manifest, _inputs(case)) or RESULT not in manifest["files"]:
        return None
    if figures and not any(name.endswith(f".{figures}") for name in manifest["files"]):
        return None
    try:
        passed = json.loads((folder / RESULT).read_text(encoding="utf-8"))["passed"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return CaseRun(case.path, case.name, folder, bool(passed), skipped=True, judged=bool(case.accept))


def obtain_surface(case: Case, progress: Callable[[float], None] = lambda share: None) -> ResponseSurface:
    """Simulate the test of a case, or read its measured files.

    Raises
    ------
    RsgenError
        A file cannot be read, or a simulated case has no true values.
    """
    if isinstance(case.test, MeasuredTest):
        return read_measurement(case.test)
    if case.oscillator is None:
        raise RsgenError(f"{case.path.name}: truth: is missing; a simulated case needs it")
    return simulate(case.oscillator, case.test, progress=progress)


def _execute(
    case: Case,
    out: Path,
    obtain: Callable[[Case, Callable[[float], None]], ResponseSurface],
    command: Sequence[str],
    figures: str | None,
    progress: Progress | None,
) -> CaseRun:
    check_place(case, out)
    refused = law_faults(case)
    if refused:
        raise CaseError(refused)
    report = stage_reporter(case, progress)
    report("surface", 0.0)
    # the heavy parts are imported when there is something to do
    from rsgen.comparison import compare
    from rsgen.identification import identify
    from rsgen.ranking import identify_best
    from rsgen.report import write_report

    noisy = isinstance(case.test, SimulatedTest) and case.test.noise_relative > 0
    seed = case.test.seed if isinstance(case.test, SimulatedTest) and noisy else None
    with replaced_folder(out, case.name) as folder:
        inputs = _inputs(case)
        started = time.perf_counter()
        surface = obtain(case, lambda share: report("surface", share))
        tested = time.perf_counter()
        report("identification", 0.0)
        identification = (identify_best if case.ranked else identify)(surface, case.model)
        truth = case.with_model(identification.model).truth
        comparison = compare(identification, truth, case.accept)
        durations = {"surface": tested - started, "identification": time.perf_counter() - tested}
        report("report", 0.0)
        results = (case, surface, identification, comparison)
        with _failed_notebook(folder, out / f"{case.name}-failed.ipynb"):
            write_report(folder, *results, durations=durations, command=command, figures=figures)
        write_manifest(folder, inputs, seed, command)
    return CaseRun(case.path, case.name, out / case.name, comparison.passed, judged=bool(case.accept))


@contextlib.contextmanager
def _failed_notebook(folder: Path, place: Path) -> Iterator[None]:
    """Save a notebook with its traceback from a folder that goes; remove one of an earlier run."""
    try:
        yield
    except RsgenError:
        with contextlib.suppress(OSError):
            (folder / "notebook.ipynb").replace(place)
        raise
    place.unlink(missing_ok=True)


def run_case(
    path: str | Path | Case,
    out: str | Path,
    force: bool = False,
    data: str | Path | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
    progress: Progress | None = None,
) -> CaseRun:
    """Run a case: simulate or read, identify, compare, report; the manifest is written last.

    A fault of the case is a value, so that one case cannot stop others.

    Parameters
    ----------
    path
        The case file, or the case that was loaded from it.
    out
        The folder of all results; this one goes to ``out/<name>``.
    force
        Run even if a verified result from the same inputs is there.
    data
        The folder of measured files, if not the case's own or that of RSGEN_DATA.
    command
        What was called, for the manifest.
    figures
        "pdf", "svg" or "png": every figure is saved as a file, too.
    progress
        Called now and then with how far the case has come.

    Returns
    -------
    CaseRun
        With ``faults`` where the case failed; an earlier result is then still there.
    """
    place = Path(out)

    def run(case: Case) -> CaseRun:
        earlier = None if force else current_result(case, place, figures)
        words = command or ("rsgen", "run", case.path.name)
        return earlier or _execute(case, place, obtain_surface, words, figures, progress)

    return _attempt(path, data, run)


def rewrite_report(
    path: str | Path,
    out: str | Path,
    data: str | Path | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
    progress: Progress | None = None,
) -> CaseRun:
    """Identify and report anew from the surface that an earlier run of the same case left.

    Parameters
    ----------
    path, out, data, command, figures, progress
        As for ``run_case``.

    Returns
    -------
    CaseRun
        With ``faults`` where there is no verified result of this very case.
    """
    place = Path(out)

    def saved(case: Case, progress: Callable[[float], None]) -> ResponseSurface:
        manifest = read_manifest(place / case.name)
        if manifest is None or manifest.get("inputs") != _inputs(case) or SURFACE not in manifest["files"]:
            raise RsgenError(
                f"{case.path.name}: {place / case.name} holds no surface of this very case; use `rsgen run`"
            )
        return load_surface(place / case.name / SURFACE)

    def rewrite(case: Case) -> CaseRun:
        words = command or ("rsgen", "report", case.path.name)
        return _execute(case, place, saved, words, figures, progress)

    return _attempt(path, data, rewrite)


def _attempt(path: str | Path | Case, data: str | Path | None, run: Callable[[Case], CaseRun]) -> CaseRun:
    """Load a case if need be and run it; every fault becomes a sentence."""
    started = time.perf_counter()
    file = path.path if isinstance(path, Case) else Path(path)
    name = file.stem
    try:
        case = path if isinstance(path, Case) else load_case(path, data)
        name = case.name
        done = run(case)
        return done if done.skipped else replace(done, seconds=time.perf_counter() - started)
    except CaseError as fault:
        faults = fault.faults
    except RsgenError as fault:
        text = " ".join(str(fault).split())
        faults = (text if text.startswith(file.name) else f"{file.name}: {text}",)
    except Exception as fault:
        # a fault of the program must not stop other cases either; the log has the details
        logging.getLogger("rsgen").debug("%s failed", file.name, exc_info=True)
        text = " ".join(f"{type(fault).__name__}: {fault}".split())
        faults = (f"{file.name}: {text[:300]}; this is a fault of rsgen, please report it with the case",)
    return CaseRun(file, name, seconds=time.perf_counter() - started, faults=faults)
