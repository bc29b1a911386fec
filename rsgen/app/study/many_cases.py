"""Many cases at once; a case that fails does not stop the others."""

from __future__ import annotations

import copyreg
import importlib
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import Any

import rsgen.report
from rsgen.app.study.folder import check_index, recover
from rsgen.app.study.run_case import (
    CaseRun,
    Progress,
    check_place,
    current_result,
    run_case,
)
from rsgen.cases.case import Case
from rsgen.cases.loading import find_cases, load_case, name_clashes
from rsgen.common.errors import RsgenError, faults_of, keep_from_terminal, one_line, shown_path
from rsgen.common.process import ALGEBRA, collect_seldom

# ----------------------------------------------------------------------------
# Processes of this machine, each with one case at a time.

_CLEARING_SECONDS = 1.0
"""A worker that was asked to end has this long to remove what it began; the parent removes the rest."""

_ATTEMPTS = 2
"""Attempts per case: one more if the worker was killed, for example for want of memory."""

_one_at_a_time = threading.Lock()
"""Figures are drawn, and output is captured, under settings that all threads of a process share."""


def _frozen(content: dict[str, object]) -> MappingProxyType[str, object]:
    return MappingProxyType(content)


# cases hold read-only mappings, which pickle refuses, and are sent to workers
copyreg.pickle(MappingProxyType, lambda mapping: (_frozen, (dict(mapping),)))


def work(case: Case, out: Path, settings: Mapping[str, Any]) -> CaseRun:
    """Run a case on a worker; ``settings`` are those of ``run_case``."""
    with _one_at_a_time:
        try:
            return run_case(case, out, force=True, **settings)
        except KeyboardInterrupt:
            # back in the pool it would wait for a lock that another ended worker may have taken along
            os._exit(1)


def _end(number: int, frame: FrameType | None) -> None:
    """Answer SIGTERM, once: unwind through the case, which removes its unfinished folder."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if not _one_at_a_time.locked():
        os._exit(1)
    # a finalizer throws the interrupt away and would print it; then _follow ends this process
    sys.unraisablehook = lambda lost: None
    raise KeyboardInterrupt


def _follow(parent: Connection) -> None:
    """End this process when the parent closes its end of the pipe, or is gone."""
    with suppress(EOFError, OSError):
        parent.recv()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_CLEARING_SECONDS)
    os._exit(1)


def _prepare_worker(parent: Connection) -> None:
    keep_from_terminal()
    collect_seldom()
    # Ctrl-C reaches every process of a terminal; the parent alone answers it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()


@contextmanager
def _beginning(share: int) -> Iterator[None]:
    """Return each process begun meanwhile a number of processors, and no ear for Ctrl-C.

    With a thread for each processor in each process, the cases would fight for all of them.
    """
    threads = dict.fromkeys(ALGEBRA, "1") | {"RSGEN_THREADS": str(share)}
    added = [name for name in threads if name not in os.environ]
    os.environ.update({name: threads[name] for name in added})
    mask = None
    if os.name == "posix":
        # Python begins this process at the first lock, and lets Ctrl-C in again when it has
        tracker: Any = importlib.import_module("multiprocessing.resource_tracker")
        tracker.ensure_running()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name in added:
            del os.environ[name]


@contextmanager
def local_workers(number: int) -> Iterator[Callable[..., Future[Any]]]:
    """Return what submits a call to processes of this machine, each in a pool of its own.

    A call whose process dies is tried once more, then its future has the exception; others go on. When the
    block is left by a fault or Ctrl-C, the processes end within seconds.

    Parameters
    ----------
    number
        Processes at a time; fewer where no more can be begun.
    """
    # copies of a server that has loaded everything would begin sooner; its socket lies in a temporary folder,
    # which a killed run leaves for good and which may be missing or have too long a name
    context = multiprocessing.get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    share = max(1, (os.cpu_count() or 1) // number)
    ended = threading.Event()
    idle: deque[ProcessPoolExecutor | None] = deque()

    def begin() -> ProcessPoolExecutor:
        with _beginning(share):
            pool = ProcessPoolExecutor(1, mp_context=context, initializer=_prepare_worker, initargs=(theirs,))
            # the first call begins the process
            pool.submit(os.getpid)
        return pool

    def run(call: Callable[..., Any], *args: Any) -> Any:
        pool, attempts = idle.pop(), 0
        try:
            while True:
                pool = pool or begin()
                try:
                    return pool.submit(call, *args).result()
                except BrokenExecutor:
                    # until the process is reaped its number looks alive, and its folder in use
                    pool.shutdown()
                    pool, attempts = None, attempts + 1
                    if ended.is_set() or attempts == _ATTEMPTS:
                        raise
        finally:
            idle.append(pool)

    with suppress(OSError, RuntimeError):
        while len(idle) < number:
            idle.append(begin())
    idle.extend([] if idle else [None])
    try:
        # a thread for each process waits for its answer
        with ThreadPoolExecutor(len(idle)) as threads:
            try:
                yield lambda call, *args: threads.submit(run, call, *args)
            except BaseException:
                ended.set()
                threads.shutdown(wait=False, cancel_futures=True)
                ours.close()
                raise
    finally:
        for pool in filter(None, idle):
            pool.shutdown()
        ours.close()


def _sort(
    paths: Iterable[Path], out: Path, force: bool, data: Path | None, figures: str | None
) -> tuple[dict[Path, Case], dict[Path, CaseRun]]:
    """Return the cases that must be run, by path, and what became of others: faulty or finished before."""
    cases: dict[Path, Case] = {}
    done: dict[Path, CaseRun] = {}
    for path in paths:
        try:
            case = load_case(path, data and data.absolute())
            check_place(case, out)
            cases[path] = case
        except RsgenError as fault:
            done[path] = CaseRun(path, path.stem, faults=faults_of(fault, shown_path(path)))
    clashes = name_clashes(cases.values())
    todo: dict[Path, Case] = {}
    # laws with many parameters take longest; begun first, they do not keep one worker busy at the end
    for path, case in sorted(cases.items(), key=lambda item: -len(item[1].model.parameters)):
        earlier = None if force else current_result(case, out, figures)
        if case.path in clashes:
            done[path] = CaseRun(path, case.name, faults=(clashes[case.path],))
        elif earlier is not None:
            done[path] = earlier
        else:
            todo[path] = case
    return todo, done


def _outcome(future: Future[CaseRun], case: Case) -> CaseRun:
    """Return what became of a case; a worker that was lost is a fault."""
    lost = future.exception()
    if lost is None:
        return future.result()
    if not isinstance(lost, Exception):
        raise lost
    text = one_line(f"{type(lost).__name__}: {lost}")[:300]
    fault = (
        f"{shown_path(case.path)}: its worker was lost or could not be begun, and a second one too, perhaps "
        f"for want of memory; try it alone with --jobs 1 ({text})"
    )
    return CaseRun(case.path, case.path.stem, faults=(fault,))


def _spread(
    todo: Mapping[Path, Case],
    out: Path,
    settings: Mapping[str, Any],
    workers: int,
    note: Callable[[Path, CaseRun], None],
) -> None:
    """Have all cases worked on; note each when it is finished."""
    try:
        with local_workers(workers) as submit:
            futures = {submit(work, case, out.absolute(), settings): path for path, case in todo.items()}
            for future in as_completed(futures):
                note(futures[future], _outcome(future, todo[futures[future]]))
    except BaseException:
        # what a worker of this machine had no time to remove
        recover(out)
        raise


def run_cases(
    paths: Iterable[str | Path],
    out: str | Path,
    *,
    force: bool = False,
    data: str | Path | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
    workers: int | None = None,
    finished: Callable[[CaseRun], None] = lambda run: None,
    progress: Progress | None = None,
) -> tuple[CaseRun, ...]:
    """Run cases, each in a process of its own, then write the index over all results in ``out``.

    Parameters
    ----------
    paths
        Case files and folders of them.
    out, force, data, command, figures
        As for ``run_case``.
    workers
        Processes at a time; default is the number of processors. 1 runs in this process.
    finished
        Called after each case, in this process.
    progress
        Called now and then, in this process, with how far a case has come that runs in it.

    Returns
    -------
    tuple of CaseRun
        In the order of the paths.

    Raises
    ------
    RsgenError
        A path does not exist or holds no case; the index cannot be written, or a file
        of its name was not written by rsgen.
    """
    files, place, runs = find_cases(paths), Path(out), dict[Path, CaseRun]()
    check_index(place)
    settings: dict[str, Any] = {"command": tuple(command), "figures": figures}

    def note(path: Path, run: CaseRun) -> None:
        runs[path] = replace(run, path=path, folder=run.folder and place / run.folder.name)
        finished(runs[path])

    folder = None if data is None else Path(data)
    todo, done = _sort(files, place, force, folder, figures)
    for path, run in done.items():
        note(path, run)
    number = min(workers or os.cpu_count() or 1, max(1, len(todo)))
    if number > 1:
        _spread(todo, place, settings, number, note)
    else:
        for path, case in todo.items():
            note(path, run_case(case, place, force=True, progress=progress, **settings))
    _renew_index(place, runs.values())
    return tuple(runs[path] for path in files)


def _renew_index(place: Path, runs: Collection[CaseRun]) -> None:
    """Write the index over all results if one is new, or if the index is missing."""
    changed = any(run.folder and not run.skipped for run in runs)
    missing = not (place / "index.html").is_file()
    if changed or (missing and any(run.folder for run in runs)):
        rsgen.report.write_index(place)
