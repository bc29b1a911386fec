"""Many cases at once; a case that fails does not stop the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import replace
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Any

from rsgen.app.study.folder import check_index, recover
from rsgen.app.study.progress import Progress, Step
from rsgen.app.study.run_case import CaseRun, check_place, current_result, run_case
from rsgen.app.study.workers import cluster_workers, local_workers, work
from rsgen.cases import Case, find_cases, load_case, name_clashes
from rsgen.common.errors import CaseError, RsgenError

__all__ = ["run_cases"]

_LISTEN_SECONDS = 0.2
"""Between two looks at how far the cases have come."""


def _sort(
    paths: Iterable[Path], out: Path, force: bool, data: Path | None, figures: str | None, away: bool
) -> tuple[dict[Path, Case], dict[Path, CaseRun]]:
    """Give the cases that must be run, by path, and what became of the others: faulty or finished before.

    ``away`` is True where workers have another working folder, so that paths must be absolute.
    """
    cases: dict[Path, Case] = {}
    done: dict[Path, CaseRun] = {}
    for path in paths:
        try:
            case = load_case(path.absolute() if away else path, data and data.absolute())
            check_place(case, out)
            cases[path] = case
        except CaseError as fault:
            done[path] = CaseRun(path, path.stem, faults=fault.faults)
        except RsgenError as fault:
            done[path] = CaseRun(path, path.stem, faults=(str(fault),))
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
    """Give what became of a case; a worker that was lost is a fault."""
    lost = future.exception()
    if lost is None:
        return future.result()
    if not isinstance(lost, Exception):
        raise lost
    text = " ".join(f"{type(lost).__name__}: {lost}".split())[:300]
    if isinstance(lost, OSError | RuntimeError) and not isinstance(lost, BrokenExecutor):
        fault = f"{case.path.name}: no process could be begun for it; try it with --jobs 1 ({text})"
    else:
        fault = (
            f"{case.path.name}: its worker was lost, and a second one, perhaps for want of memory; try it "
            f"alone with --jobs 1 ({text})"
        )
    return CaseRun(case.path, case.path.stem, faults=(fault,))


def _spread(
    todo: Mapping[Path, Case],
    out: Path,
    settings: Mapping[str, Any],
    workers: int,
    cluster: str | None,
    progress: Progress | None,
    note: Callable[[Path, CaseRun], None],
) -> None:
    """Have all cases worked on, wherever the executor is; note each when it is finished."""
    steps: list[SimpleQueue[Step]] | None = [] if progress is not None and cluster is None else None
    try:
        with cluster_workers(cluster) if cluster else local_workers(workers, steps) as executor:
            futures = {
                executor.submit(work, case, out.absolute(), settings): path for path, case in todo.items()
            }
            waiting = set(futures)
            while waiting:
                done, waiting = wait(waiting, None if steps is None else _LISTEN_SECONDS, FIRST_COMPLETED)
                for queue in steps or ():
                    while progress is not None and not queue.empty():
                        progress(queue.get())
                for future in done:
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
    reuse_surface: bool = False,
    workers: int | None = None,
    cluster: str | None = None,
    finished: Callable[[CaseRun], None] = lambda run: None,
    progress: Progress | None = None,
) -> tuple[CaseRun, ...]:
    """Run cases, each in a process of its own, then write the index over all results in ``out``.

    Parameters
    ----------
    paths
        Case files and folders of them.
    out, force, data, command, figures, reuse_surface
        As for ``run_case``.
    workers
        Processes at a time; default is the number of processors. 1 runs in this process.
    cluster
        Address of a Dask scheduler whose workers see the same folders; ``workers`` is theirs then.
    finished
        Called after each case, in this process.
    progress
        Called now and then, in this process, with how far each case has come; not from a cluster.

    Returns
    -------
    tuple of CaseRun
        In the order of the paths.

    Raises
    ------
    RsgenError
        A path does not exist or holds no case; no scheduler answers; the index cannot be written, or a file
        of its name was not written by rsgen.
    """
    files, place, runs = find_cases(paths), Path(out), dict[Path, CaseRun]()
    check_index(place)
    settings: dict[str, Any] = {"command": tuple(command), "figures": figures, "reuse_surface": reuse_surface}

    def note(path: Path, run: CaseRun) -> None:
        runs[path] = replace(run, path=path, folder=run.folder and place / run.folder.name)
        finished(runs[path])

    folder = None if data is None else Path(data)
    todo, done = _sort(files, place, force or reuse_surface, folder, figures, away=cluster is not None)
    for path, run in done.items():
        note(path, run)
    number = min(workers or os.cpu_count() or 1, max(1, len(todo)))
    if todo and (cluster or number > 1):
        _spread(todo, place, settings, number, cluster, progress, note)
    else:
        for path, case in todo.items():
            note(path, run_case(case, place, force=True, progress=progress, **settings))
    changed = any(run.folder and not run.skipped for run in runs.values())
    missing = any(not (place / name).is_file() for name in ("index.html", "table1.md"))
    if changed or (missing and any(run.folder for run in runs.values())):
        from rsgen.report import write_index

        write_index(place)
    return tuple(runs[path] for path in files)
