"""Running cases: a result is whole and verified, or it is no result."""

import json
import os
import shutil
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from unittest.mock import Mock

import pytest

from rsgen import RsgenError, load_case
from rsgen.app.study.folder import (
    MANIFEST,
    UNFINISHED,
    read_manifest,
    recover,
    replaced_folder,
    write_manifest,
)
from rsgen.app.study.many_cases import _outcome, local_workers, run_cases
from rsgen.app.study.run_case import check_place, current_result, run_case
from tests.case_files import CUBIC, write_small

posix = pytest.mark.skipif(os.name != "posix", reason="signals and locks of files are POSIX")


def write_case(folder: Path, name: str = "small", accept: object = 1e-2) -> Path:
    return write_small(folder, name, CUBIC | {"test.harmonics": 5, "accept.k": accept})


@pytest.fixture
def earlier(tmp_path):
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "earlier")
    return tmp_path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def fill(folder: Path, text: str) -> None:
    (folder / "result.json").write_text(text)
    (folder / "report.html").write_text(text * 2)
    write_manifest(folder, {"case": "0"}, None, ["rsgen"])


def content(folder: Path) -> dict[str, object]:
    """Return what each path below holds: the aim of a link, the bytes of a file, or the mode."""
    return {
        path.relative_to(folder).as_posix(): path.readlink() if path.is_symlink()
        else path.read_bytes() if path.is_file() else path.stat().st_mode
        for path in folder.rglob("*")
    }  # fmt: skip


def test_a_manifest_vouches_for_every_byte(tmp_path):
    fill(tmp_path, "text")
    manifest = read_manifest(tmp_path)
    assert set(manifest["files"]) == {"result.json", "report.html"}
    assert manifest["command"] == ["rsgen"]
    (tmp_path / "report.html").write_text("texttexT")
    assert read_manifest(tmp_path) is None
    (tmp_path / "report.html").unlink()
    assert read_manifest(tmp_path) is None


@pytest.mark.parametrize("text", [
    *("", "[]", "[" * 100_000), '{"schema": 1, "files": {}}', '{"schema": 2, "files": {"a": "b"}}',
    '{"schema": 1, "files": {"../result.json": "b"}}', '{"schema": 1, "files": {"a\\u0000": "b"}}',
])  # fmt: skip
def test_a_corrupted_manifest_is_none(tmp_path, text):
    fill(tmp_path, "text")
    (tmp_path / MANIFEST).write_text(text)
    assert read_manifest(tmp_path) is None


def test_a_fault_leaves_the_earlier_result(earlier):
    before = content(earlier / "case")

    def fail() -> None:
        with replaced_folder(earlier, "case") as folder:
            fill(folder, "half")
            raise RsgenError("in the middle")

    with pytest.raises(RsgenError, match="in the middle"):
        fail()
    assert content(earlier / "case") == before
    assert names(earlier) == ["case"]


@posix
def test_a_kill_between_the_two_renames_loses_nothing(earlier, dead):
    (earlier / "case").rename(earlier / f".case.{dead}.old")
    (earlier / f".case.{dead}.part").mkdir()
    recover(earlier)
    assert names(earlier) == ["case"]
    assert read_manifest(earlier / "case") is not None


@posix
def test_a_killed_run_of_another_case_is_cleared_up_and_folders_of_others_stay(tmp_path, dead):
    runs = f".other.{os.getppid()}.part"
    for name in (f".v1.5.{dead}.part", runs, ".notes.part"):
        (tmp_path / name).mkdir()
    sequels = [tmp_path / f".{kind}.{dead}.{kind}" / "thesis.tex" for kind in ("part", "old")]
    for thesis in sequels:
        thesis.parent.mkdir()
        thesis.write_text("mine")
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "text")
    assert names(tmp_path) == sorted(["case", runs, ".notes.part", *(t.parent.name for t in sequels)])
    assert [thesis.read_text() for thesis in sequels] == ["mine"] * 2


FOREIGN: dict[str, tuple[Callable[[Path], object], str]] = {
    "a folder of the user": (lambda place: (place / MANIFEST).unlink(), "that no run made"),
    "a file": (lambda place: (place / "thesis.tex").write_text("mine"), "thesis.tex"),
    "an empty folder": (lambda place: (place / "more").mkdir(), "more"),
    "a link to what a run wrote": (
        lambda place: (
            (place / "result.json").rename(place.parent / "mine"),
            (place / "result.json").symlink_to(place.parent / "mine"),
        ),
        "result.json",
    ),
    "a changed file": (lambda place: (place / "report.html").write_text("my remarks"), "report.html"),
    "a file in its place": (lambda place: (shutil.rmtree(place), place.write_text("mine")), "is no folder"),
    "a link in its place": (
        lambda place: (place.rename(place.parent / "mine"), place.symlink_to(place.parent / "mine")),
        "is no folder",
    ),
}


@posix
@pytest.mark.parametrize("what", FOREIGN)
def test_what_no_run_wrote_is_never_replaced(earlier, what):
    make, named = FOREIGN[what]
    make(earlier / "case")
    before = content(earlier)
    # before anything is computed
    with pytest.raises(RsgenError, match=named), replaced_folder(earlier, "case"):
        pytest.fail("the block began")
    assert content(earlier) == before


def test_what_came_during_a_run_is_not_replaced_either(earlier):
    def late() -> None:
        with replaced_folder(earlier, "case") as folder:
            fill(folder, "later")
            (earlier / "case" / "thesis.tex").write_text("mine")

    with pytest.raises(RsgenError, match=r"thesis\.tex"):
        late()
    assert (earlier / "case" / "thesis.tex").read_text() == "mine"
    assert (earlier / "case" / "report.html").read_text() == "earlierearlier"
    assert names(earlier) == ["case"]


def test_a_result_with_missing_files_is_replaced(tmp_path):
    (tmp_path / "case").mkdir()
    for text in ("first", "second"):
        with replaced_folder(tmp_path, "case") as folder:
            fill(folder, text)
        (tmp_path / "case" / "report.html").unlink()
    assert (tmp_path / "case" / "result.json").read_text() == "second"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A small case that was run once, its results' folder, and what became of it."""
    folder = tmp_path_factory.mktemp("run")
    path = write_case(folder)
    return path, folder / "out", run_case(path, folder / "out")


@pytest.mark.slow
def test_a_run_leaves_what_it_promises(finished):
    path, out, run = finished
    assert (run.faults, run.passed, run.skipped) == ((), True, False)
    wanted = {"surface.h5", "kernel.py", "result.json", "notebook.ipynb", "report.html", MANIFEST}
    assert wanted <= set(content(out / "small"))
    manifest = read_manifest(out / "small")
    assert (manifest["inputs"], manifest["seed"]) == ({"case": load_case(path).sha256}, None)
    result = json.loads((out / "small" / "result.json").read_text())
    assert (result["case"], result["passed"]) == ("small", True)


@pytest.mark.slow
def test_unchanged_is_skipped_and_changed_is_not(finished, tmp_path):
    path, out, _ = finished
    case = load_case(path)
    again = current_result(case, out)
    assert (again.skipped, again.passed) == (True, True)
    changed = load_case(write_case(tmp_path, accept=2e-2))
    assert current_result(changed, out) is None
    copied = tmp_path / "out"
    for damage in ("result.json", "surface.h5", MANIFEST):
        shutil.copytree(out, copied)
        assert current_result(case, copied) is not None
        (copied / "small" / damage).write_bytes(b"{}")
        assert current_result(case, copied) is None
        shutil.rmtree(copied)


@pytest.mark.slow
def test_a_faulty_case_stops_no_other(finished, tmp_path):
    path, out, _ = finished
    bad = write_case(tmp_path, "bad", accept="much")
    twin = write_case(tmp_path, "SMALL")
    seen: list[str] = []
    runs = run_cases([bad, path, twin], out, finished=lambda run: seen.append(run.name))
    assert [run.passed for run in runs] == [None, True, None]
    assert "accept.k" in runs[0].faults[0]
    assert f"is also the name of {path}" in runs[2].faults[0]
    assert (sorted(seen), runs[1].skipped) == (["SMALL", "bad", "small"], True)
    assert (out / "index.html").is_file()


def test_results_never_go_where_the_case_lies(tmp_path):
    path = write_case(tmp_path)
    assert "choose another --out" in run_case(path, tmp_path).faults[0]
    inside = tmp_path / "small"
    inside.mkdir()
    assert "choose another --out" in run_case(write_case(inside), tmp_path).faults[0]
    assert [file.name for file in inside.iterdir()] == ["small.toml"]


def test_the_result_of_another_case_file_of_the_same_name_stays(tmp_path):
    for name in ("a", "b", "out/small"):
        (tmp_path / name).mkdir(parents=True)
    one, other, out = write_case(tmp_path / "a"), write_case(tmp_path / "b"), tmp_path / "out"
    (out / "small" / "result.json").write_text("{}")
    write_manifest(out / "small", {"case": "0"}, None, ["rsgen"], one)
    before = content(out / "small")
    (fault,) = run_case(other, out).faults
    assert f"name: 'small' is also the name of {one}, whose result is in {out / 'small'}" in fault
    assert content(out / "small") == before
    check_place(load_case(one), out)
    one.unlink()
    check_place(load_case(other), out)


@posix
@pytest.mark.parametrize("link", [False, True])
def test_a_file_with_the_name_of_the_index_stays(tmp_path, link):
    path, out, name = write_case(tmp_path), tmp_path / "out", "index.html"
    out.mkdir()
    # a link stays even if it leads to an index that rsgen wrote
    text = f"<html>my homepage</html>{'<title>rsgen: all cases</title>' * link}"
    (out / name).symlink_to(tmp_path / "home.html") if link else None
    (out / name).write_text(text)
    with pytest.raises(RsgenError, match="was not written by rsgen"):
        run_cases([path], out)
    assert [file.name for file in out.iterdir()] == [name]
    assert (out / name).read_text() == text


@posix
@pytest.mark.parametrize("process", [os.getpid(), 4_194_303], ids=["own", "none"])
def test_a_folder_that_another_run_fills_is_not_cleared(tmp_path, process):
    """That run may be another thread, or in another container or machine, with any number."""
    with replaced_folder(tmp_path, "other") as part:
        (part / "report.html").write_text("nearly done")
        there = part.rename(tmp_path / f".other.{process}.part")
        recover(tmp_path)
        assert (there / "report.html").is_file()
        there.rename(part)
    assert (tmp_path / "other" / "report.html").is_file()
    killed = tmp_path / f".killed.{process}.part"
    killed.mkdir()
    (killed / UNFINISHED).touch()
    recover(tmp_path)
    assert not killed.exists()


KILLED, FULL = BrokenProcessPool("killed"), OSError("no semaphores")


@pytest.mark.parametrize(("number", "pools", "found"), [
    # where one process cannot be begun others take its calls, without any every call says so
    (2, ("abc", OSError("too many open files")), [*"abc"]),
    (2, (RuntimeError("can't start new thread"), FULL, FULL, FULL), [FULL] * 3),
    # a call whose process is lost gets a second one and no third
    (1, (["a", KILLED], "bc"), [*"abc"]), (1, ([KILLED], [KILLED], "bc"), [KILLED, "b", "c"]),
])  # fmt: skip
def test_calls_of_processes_that_are_lost_or_cannot_be_begun(monkeypatch, number, pools, found):
    def pool(answers):
        # the first call begins the process
        return Mock(
            **{"submit.side_effect": [Mock(**{"result.side_effect": [one]}) for one in (0, *answers)]}
        )

    begun = Mock(side_effect=[one if isinstance(one, Exception) else pool(one) for one in pools])
    monkeypatch.setattr("rsgen.app.study.many_cases.ProcessPoolExecutor", begun)
    with local_workers(number) as submit:
        futures = [submit(str, call) for call in range(3)]
        assert [future.exception(5) or future.result(5) for future in futures] == found


def test_a_case_whose_worker_was_lost_says_what_to_try(tmp_path):
    path, lost = write_case(tmp_path), Mock(**{"exception.return_value": FULL})
    (fault,) = _outcome(lost, load_case(path)).faults
    assert fault.startswith(f"{path}: its worker was lost or could not be begun")
    assert fault.endswith("try it alone with --jobs 1 (OSError: no semaphores)")
