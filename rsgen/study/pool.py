"""Many cases at once, in local processes; a case that fails does not stop the others."""

from __future__ import annotations

import copyreg
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from types import FrameType, MappingProxyType

from rsgen.case import Case, find_cases, load_case, name_clashes
from rsgen.errors import CaseError, RsgenError
from rsgen.study.cluster import run_on_cluster
from rsgen.study.folder import recover
from rsgen.study.progress import Step, Tell
from rsgen.study.run_case import CaseRun, check_place, current_result, run_case

__all__ = ["run_cases"]

Report = Callable[[CaseRun], None]

_LISTEN_SECONDS = 0.2
_CLEARING_SECONDS = 15.0

_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


_steps: list[SimpleQueue[Step]] = []
"""In a worker: where it tells how far its case has come; empty where nobody listens."""


def _prepare_worker(steps: SimpleQueue[Step] | None) -> None:
    if steps is not None:
        _steps.append(steps)
    # a worker whose parent was killed would wait for ever
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _frozen(content: dict[str, object]) -> MappingProxyType[str, object]:
    return MappingProxyType(content)


# cases hold read-only mappings and go to processes
copyreg.pickle(MappingProxyType, lambda mapping: (_frozen, (dict(mapping),)))


@contextmanager
def _beginning(workers: int) -> Iterator[None]:
    """Give each process begun meanwhile its share of the processors, and no ear for Ctrl-C.

    The libraries read these names when they are loaded; with a thread for each processor in each process,
    the cases would fight for all of them. Ctrl-C reaches every process of a terminal, those that still
    import as well; the parent alone answers it.
    """
    share = str(max(1, (os.cpu_count() or 1) // workers))
    added = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, share))
    kept = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if os.name == "posix" else None
    try:
        yield
    finally:
        if kept is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, kept)
        for name in added:
            del os.environ[name]


_working, _ending = threading.Event(), threading.Event()


def _end(number: int, frame: FrameType | None) -> None:
    _ending.set()
    if _working.is_set():
        # unwinds through the case, which removes its unfinished folder
        raise KeyboardInterrupt
    os._exit(1)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(
    case: Case, out: Path, data: Path | None, command: tuple[str, ...], figures: str | None
) -> CaseRun | None:
    # Ctrl-C reaches every process of a terminal; the parent alone answers it and ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    _working.set()
    try:
        tell = _steps[0].put if _steps else None
        return run_case(case, out, force=True, data=data, command=command, figures=figures, tell=tell)
    except KeyboardInterrupt:
        return None
    finally:
        _working.clear()
        if _ending.is_set():
            # back in the pool it would wait for a lock that another ended worker may have taken along
            os._exit(1)


def _sort(
    paths: Iterable[Path],
    out: Path,
    force: bool,
    data: Path | None,
    finished: Report,
    figures: str | None,
) -> dict[Path, Case]:
    """Report faulty and finished cases at once; give those that must be run, by path."""
    cases: list[Case] = []
    for path in paths:
        try:
            case = load_case(path, data)
            check_place(case, out)
            cases.append(case)
        except CaseError as fault:
            finished(CaseRun(path, path.stem, faults=fault.faults))
        except RsgenError as fault:
            finished(CaseRun(path, path.stem, faults=(str(fault),)))
    clashes = name_clashes(cases)
    todo: dict[Path, Case] = {}
    # laws with many parameters take longest; begun first, they do not keep one process busy at the end
    for case in sorted(cases, key=lambda case: -len(case.model.parameters)):
        earlier = None if force else current_result(case, out, figures)
        if case.path in clashes:
            finished(CaseRun(case.path, case.name, faults=(clashes[case.path],)))
        elif earlier is not None:
            finished(earlier)
        else:
            todo[case.path] = case
    return todo


def _spread(
    todo: dict[Path, Case],
    out: Path,
    data: Path | None,
    command: tuple[str, ...],
    workers: int,
    finished: Report,
    figures: str | None,
    tell: Tell | None,
) -> None:
    context = multiprocessing.get_context("spawn")
    steps = None if tell is None else context.SimpleQueue()
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_prepare_worker, initargs=(steps,))
    futures: dict[Future[CaseRun | None], Path] = {}
    try:
        with _beginning(workers):
            # submitting starts the processes
            futures = {
                pool.submit(_work, case, out, data, command, figures): path for path, case in todo.items()
            }
        open_futures = set(futures)
        while open_futures:
            pause = None if steps is None else _LISTEN_SECONDS
            done, open_futures = wait(open_futures, timeout=pause, return_when=FIRST_COMPLETED)
            while steps is not None and tell is not None and not steps.empty():
                tell(steps.get())
            for future in done:
                path = futures[future]
                try:
                    run = future.result()
                except BrokenProcessPool:
                    lost = f"{path.name}: its process was ended, perhaps for want of memory; try again"
                    run = CaseRun(path, path.stem, faults=(lost,))
                if run is None:
                    raise KeyboardInterrupt
                finished(run)
    except BaseException:
        _end_workers(list((pool._processes or {}).values()))
        pool.shutdown(wait=True, cancel_futures=True)
        for case in todo.values():
            # what a worker had no time to remove
            recover(out, case.name)
        raise
    pool.shutdown(wait=True)


def _end_workers(processes: list[BaseProcess]) -> None:
    """Ask workers to clear up and end; those that do not are killed, and `recover` clears up after them."""
    for process in processes:
        process.terminate()
    open_ends = [process.sentinel for process in processes]
    until = time.monotonic() + _CLEARING_SECONDS
    while open_ends and (left := until - time.monotonic()) > 0:
        for end in multiprocessing.connection.wait(open_ends, left):
            open_ends.remove(end)  # type: ignore[arg-type]
    for process in processes:
        if process.sentinel in open_ends:
            process.kill()


def run_cases(
    paths: Iterable[str | Path],
    out: str | Path,
    force: bool = False,
    data: str | Path | None = None,
    workers: int | None = None,
    command: Sequence[str] = (),
    finished: Report = lambda run: None,
    figures: str | None = None,
    tell: Tell | None = None,
    cluster: str | None = None,
) -> tuple[CaseRun, ...]:
    """Run cases, each in a process of its own, then write the index over all results in ``out``.

    Parameters
    ----------
    paths
        Case files and folders of them.
    out
        The folder of all results.
    force
        Run every case; otherwise those with a verified result from the same inputs are skipped.
    data
        The folder of measured files, if not each case's own or that of RSGEN_DATA.
    workers
        Processes at a time; default is the number of processors. 1 runs in this process.
    command
        What was called, for the manifests.
    finished
        Called after each case, in this process.
    figures
        "pdf", "svg" or "png": every figure is saved as a file, too.
    tell
        Called now and then, in this process, with how far each case has come; not from a cluster.
    cluster
        Address of a Dask scheduler whose workers see the same folders; ``workers`` is theirs then.

    Returns
    -------
    tuple of CaseRun
        In the order of the paths.

    Raises
    ------
    RsgenError
        A path does not exist or holds no case; the index cannot be written.
    """
    files = find_cases(paths)
    place = Path(out)
    folder = None if data is None else Path(data)
    runs: dict[Path, CaseRun] = {}

    def note(run: CaseRun) -> None:
        runs[run.path] = run
        finished(run)

    todo = _sort(files, place, force, folder, note, figures)
    number = min(workers or os.cpu_count() or 1, max(1, len(todo)))
    if cluster is not None:
        if todo:
            run_on_cluster(cluster, todo, place, folder, tuple(command), note, figures)
    elif number == 1:
        for case in todo.values():
            run = run_case(case, place, force=True, data=folder, command=command, figures=figures, tell=tell)
            note(run)
    else:
        _spread(todo, place, folder, tuple(command), number, note, figures, tell)
    changed = any(run.folder and not run.skipped for run in runs.values())
    missing = any(not (place / name).is_file() for name in ("index.html", "table1.md"))
    if changed or (missing and any(run.folder for run in runs.values())):
        from rsgen.report import write_index

        write_index(place)
    return tuple(runs[path] for path in files)
