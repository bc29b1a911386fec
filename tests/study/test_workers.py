"""Processes that cannot be begun, or end while they have nothing to do."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool

import pytest

from rsgen.app.study.many_cases import _outcome, local_workers
from rsgen.cases.loading import load_case
from tests.study.test_study import write_case


class Pool:
    """A pool of one process: each answer is a value, or a fault of the process, which then is gone."""

    def __init__(self, answers: Sequence[object]) -> None:
        self.answers = list(answers)

    def submit(self, call: Callable, *args: object) -> Future:
        future: Future = Future()
        if call is os.getpid:
            return future
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            future.set_exception(answer)
        else:
            future.set_result(answer)
        return future

    def shutdown(self, **how: bool) -> None:
        pass


KILLED = BrokenProcessPool("killed")


@pytest.fixture
def answers(monkeypatch):
    """Let pools be given ones: answers, or why it cannot be begun; give what three calls came to."""

    def run(number: int, *pools: Sequence[object] | Exception) -> list[object]:
        given = iter(pools)

        def begin(*args: object, **keys: object) -> Pool:
            pool = next(given)
            if isinstance(pool, Exception):
                raise pool
            return Pool(pool)

        monkeypatch.setattr("rsgen.app.study.many_cases.ProcessPoolExecutor", begin)
        with local_workers(number) as submit:
            futures = [submit(str, call) for call in range(3)]
            return [future.exception(5) or future.result(5) for future in futures]

    return run


def test_a_process_that_cannot_be_begun_leaves_its_calls_to_the_others(answers):
    assert answers(2, ["a", "b", "c"], OSError("too many open files")) == ["a", "b", "c"]


def test_where_no_process_can_be_begun_every_call_says_so(answers, tmp_path):
    found = answers(2, RuntimeError("can't start new thread"), *[OSError("no semaphores")] * 3)
    assert [str(fault) for fault in found] == ["no semaphores"] * 3
    path, future = write_case(tmp_path), Future()
    future.set_exception(found[0])
    (fault,) = _outcome(future, load_case(path)).faults
    assert fault.startswith(f"{path}: its worker was lost or could not be begun")
    assert fault.endswith("try it alone with --jobs 1 (OSError: no semaphores)")


def test_a_call_whose_process_is_lost_gets_a_second_one_and_no_third(answers):
    assert answers(1, ["a", KILLED], ["b", "c"]) == ["a", "b", "c"]
    assert answers(1, [KILLED], [KILLED], ["b", "c"]) == [KILLED, "b", "c"]
