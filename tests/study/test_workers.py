"""Processes that cannot be begun, or end while they have nothing to do."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool

import pytest

from rsgen.app.study.many_cases import _outcome, _Processes, local_workers
from rsgen.cases import load_case
from tests.study.test_study import write_case


class Pool:
    """A pool of one process that answers when it is told to, or whose process is gone."""

    def __init__(self) -> None:
        self.gone = False
        self.waiting: list[tuple[Future, Callable]] = []

    def submit(self, call: Callable) -> Future:
        if self.gone:
            raise BrokenProcessPool("its process was ended")
        self.waiting.append((Future(), call))
        return self.waiting[-1][0]

    def answer(self) -> None:
        future, call = self.waiting.pop(0)
        future.set_result(call())

    def shutdown(self, **how: bool) -> None:
        pass


def _beginning(*pools: Pool | Exception) -> Callable[[], Pool]:
    given: Iterator[Pool | Exception] = iter(pools)

    def begin() -> Pool:
        pool = next(given)
        if isinstance(pool, Exception):
            raise pool
        return pool

    return begin


def test_a_process_that_cannot_be_begun_leaves_its_calls_to_the_others():
    pool = Pool()
    workers = _Processes(2, _beginning(pool, OSError("too many open files")))
    futures = [workers.submit(str, number) for number in range(3)]
    for _ in futures:
        pool.answer()
    assert [future.result(timeout=0) for future in futures] == ["0", "1", "2"]


def test_where_no_process_can_be_begun_every_call_says_so(tmp_path):
    workers = _Processes(2, _beginning(*[RuntimeError("can't start new thread"), OSError("no semaphores")]))
    futures = [workers.submit(str, number) for number in range(2)]
    assert [type(future.exception(timeout=0)) for future in futures] == [RuntimeError, OSError]
    path = write_case(tmp_path)
    (fault,) = _outcome(futures[1], load_case(path)).faults
    assert fault == f"{path}: no process could be begun for it; try it with --jobs 1 (OSError: no semaphores)"


def test_a_process_that_ended_while_idle_is_replaced():
    pools = [Pool(), Pool()]
    workers = _Processes(1, _beginning(*pools))
    first = workers.submit(str, 1)
    pools[0].answer()
    pools[0].gone = True
    second = workers.submit(str, 2)
    pools[1].answer()
    assert [future.result(timeout=0) for future in (first, second)] == ["1", "2"]


def test_the_last_of_two_processes_keeps_its_place():
    """A call waits for the process that works, and gets a new one when that is lost."""
    pools = [Pool(), Pool()]
    workers = _Processes(2, _beginning(pools[0], OSError("no"), pools[1]))
    futures = [workers.submit(str, number) for number in range(2)]
    pools[0].waiting.pop()[0].set_exception(BrokenProcessPool("killed"))
    for _ in futures:
        pools[1].answer()
    assert [future.result(timeout=0) for future in futures] == ["0", "1"]


@pytest.mark.slow
def test_processes_lay_nothing_into_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with local_workers(1, None) as executor:
        assert executor.submit(len, "one").result(60) == 3
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [OSError, BrokenProcessPool])
def test_a_lost_worker_and_one_never_begun_are_told_apart(tmp_path, kind):
    future: Future = Future()
    future.set_exception(kind("why"))
    (fault,) = _outcome(future, load_case(write_case(tmp_path))).faults
    assert ("was lost" in fault) == (kind is BrokenProcessPool)
