"""Many cases on a Dask cluster; the scheduler and its workers see the same folders as this machine."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from rsgen.errors import RsgenError
from rsgen.study.run_case import CaseRun, run_case

__all__ = ["run_on_cluster"]

_CONNECT_SECONDS = 20

_one_at_a_time = threading.Lock()
"""Figures are drawn under settings that all threads of a worker share."""


def _work(path: Path, out: Path, data: Path | None, command: tuple[str, ...], figures: str | None) -> CaseRun:
    with _one_at_a_time:
        return run_case(path, out, force=True, data=data, command=command, figures=figures)


def _distributed() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError:
        raise RsgenError(
            "--cluster: dask.distributed is not installed; get it by: pip install 'rsgen[cluster]'"
        ) from None


def run_on_cluster(
    address: str,
    paths: Iterable[Path],
    out: Path,
    data: Path | None,
    command: tuple[str, ...],
    finished: Callable[[CaseRun], None],
    figures: str | None,
) -> None:
    """Run cases on the workers of a scheduler, in the order in which they come free.

    Parameters
    ----------
    address
        Of the scheduler, such as "tcp://node1:8786".
    paths, out, data
        Case files, the folder of results, the folder of measured files; the workers read and write them
        under the same absolute paths.
    command, figures
        As for ``run_case``.
    finished
        Called after each case, in this process. A case whose worker was lost has a fault.

    Raises
    ------
    RsgenError
        dask.distributed is not installed, or no scheduler answers.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as fault:
        reason = " ".join(str(fault).split())[:200]
        raise RsgenError(
            f"--cluster {address}: no scheduler answers: {reason}; start one with `dask scheduler`"
        ) from fault
    with client:
        folders = (out.resolve(), None if data is None else data.resolve())
        open_paths = {
            client.submit(_work, path.resolve(), *folders, command, figures, pure=False): path
            for path in paths
        }
        try:
            for future in distributed.as_completed(list(open_paths), loop=client.loop):
                path = open_paths[future]
                lost = future.exception()
                if lost is None:
                    done: CaseRun = future.result()
                    # as this machine was called, not as the worker was
                    run = replace(done, path=path, folder=done.folder and out / done.folder.name)
                else:
                    text = " ".join(f"{type(lost).__name__}: {lost}".split())[:300]
                    run = CaseRun(path, path.stem, faults=(f"{path.name}: its worker was lost: {text}",))
                finished(run)
        except BaseException:
            # what has begun ends by itself; a result takes its place whole or not at all
            client.cancel(list(open_paths))
            raise
