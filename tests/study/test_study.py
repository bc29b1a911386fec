"""Running cases: a result is whole and verified, or it is no result."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from rsgen.app.study import MANIFEST, CaseRun, Step, read_manifest, run_case, run_cases
from rsgen.app.study.folder import UNFINISHED, recover, replaced_folder, write_manifest
from rsgen.app.study.many_cases import local_workers
from rsgen.app.study.run_case import _failed_notebook, _temporary_in, current_result
from rsgen.cases import load_case
from rsgen.common.errors import RsgenError
from rsgen.files import read_measurement

ROOT = Path(__file__).parents[2]
NO_PROCESS = 4_194_303
"""A number that no process has."""
posix = pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")

CASE = """\
schema = 1
name = "{name}"
title = "A small case"
system = {{ mass = "1.5 kg" }}

[[element]]
name = "spring"
force = "k*x + kn*x**3"

[[element]]
name = "damper"
force = "c*v"

[truth]
k = 5920.0
kn = 2.2e5
c = 8.0

[test]
kind = "simulated"
level = {{ start = 2, stop = 10, count = 3 }}
frequency = {{ start = 8, stop = 12, count = 21 }}
harmonics = 5
accuracy = 1e-5

[accept]
k = {accept}
"""


def write_case(folder: Path, name: str = "small", accept: str = "1e-2") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(CASE.format(name=name, accept=accept), encoding="utf-8")
    return path


def fill(folder: Path, text: str) -> None:
    (folder / "result.json").write_text(text)
    (folder / "report.html").write_text(text * 2)
    write_manifest(folder, {"case": "0"}, None, ["rsgen"])


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# ---------------------------------------------------------------- manifest


def test_manifest_vouches_for_every_byte(tmp_path: Path) -> None:
    fill(tmp_path, "text")
    manifest = read_manifest(tmp_path)
    assert manifest is not None
    assert set(manifest["files"]) == {"result.json", "report.html"}
    assert manifest["command"] == ["rsgen"]
    (tmp_path / "report.html").write_text("texttexT")
    assert read_manifest(tmp_path) is None
    (tmp_path / "report.html").unlink()
    assert read_manifest(tmp_path) is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        "[" * 100_000,
        '{"schema": 1}',
        '{"schema": 1, "files": {}}',
        '{"schema": 2, "files": {"a": "b"}}',
        '{"schema": 1, "files": {"../result.json": "b"}}',
        '{"schema": 1, "files": {"/etc/hostname": "b"}}',
        '{"schema": 1, "files": {"a\\u0000": "b"}}',
    ],
)
def test_a_corrupted_manifest_is_none(tmp_path: Path, text: str) -> None:
    fill(tmp_path, "text")
    (tmp_path / MANIFEST).write_text(text)
    assert read_manifest(tmp_path) is None


# ---------------------------------------------------------------- the folder of a result


def test_a_folder_takes_its_place_whole(tmp_path: Path) -> None:
    for text in ("first", "second"):
        with replaced_folder(tmp_path / "out", "case") as folder:
            fill(folder, text)
            assert folder.parent == tmp_path / "out"
        assert (tmp_path / "out" / "case" / "result.json").read_text() == text
        assert [path.name for path in (tmp_path / "out").iterdir()] == ["case"]
    assert read_manifest(tmp_path / "out" / "case") is not None


def test_a_fault_leaves_the_earlier_result(tmp_path: Path) -> None:
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "earlier")
    before = content(tmp_path / "case")

    def fail() -> None:
        with replaced_folder(tmp_path, "case") as folder:
            fill(folder, "half")
            raise RsgenError("in the middle")

    with pytest.raises(RsgenError, match="in the middle"):
        fail()
    assert content(tmp_path / "case") == before
    assert [path.name for path in tmp_path.iterdir()] == ["case"]


def _hang_in_the_middle(out: str) -> None:
    with replaced_folder(Path(out), "case") as folder:
        fill(folder, "half")
        (folder / "ready").touch()
        time.sleep(60)


@pytest.mark.slow
@posix
def test_a_killed_run_leaves_the_earlier_result(tmp_path: Path) -> None:
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "earlier")
    before = content(tmp_path / "case")
    process = multiprocessing.get_context("spawn").Process(target=_hang_in_the_middle, args=(str(tmp_path),))
    process.start()
    while not list(tmp_path.glob(".case.*.part/ready")):
        assert process.is_alive()
        time.sleep(0.01)
    # while it runs, others leave its folder alone
    recover(tmp_path)
    assert list(tmp_path.glob(".case.*.part"))
    process.kill()
    process.join()
    assert content(tmp_path / "case") == before
    recover(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["case"]


def _dead_process() -> int:
    process = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True
    )
    return int(process.stdout)


@posix
def test_a_kill_between_the_two_renames_loses_nothing(tmp_path: Path) -> None:
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "earlier")
    dead = _dead_process()
    (tmp_path / "case").rename(tmp_path / f".case.{dead}.old")
    (tmp_path / f".case.{dead}.part").mkdir()
    recover(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["case"]
    assert read_manifest(tmp_path / "case") is not None


@posix
def test_a_killed_run_of_another_case_is_cleared_up(tmp_path: Path) -> None:
    dead = _dead_process()
    (tmp_path / f".v1.5.{dead}.part").mkdir()
    (tmp_path / f".other.{os.getppid()}.part").mkdir()
    (tmp_path / ".notes.part").mkdir()
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "text")
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == sorted(["case", f".other.{os.getppid()}.part", ".notes.part"])


@posix
@pytest.mark.parametrize("kind", ["part", "old"])
def test_a_hidden_folder_of_the_user_is_not_taken_for_an_unfinished_one(tmp_path: Path, kind: str) -> None:
    thesis = tmp_path / f".notes.{_dead_process()}.{kind}" / "thesis.tex"
    thesis.parent.mkdir()
    thesis.write_text("mine")
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "text")
    assert thesis.read_text() == "mine"


def test_temporary_files_of_a_run_lie_in_its_folder(tmp_path: Path) -> None:
    before = tempfile.gettempdir()
    with replaced_folder(tmp_path, "case") as folder, _temporary_in(folder):
        fill(folder, "text")
        with tempfile.TemporaryDirectory() as inside:
            assert Path(inside).parent == folder
    assert tempfile.gettempdir() == before


FOREIGN: dict[str, tuple[Callable[[Path], object], str]] = {
    "a folder of the user": (lambda place: (place / MANIFEST).unlink(), "that no run made"),
    "a manifest of something else": (lambda place: (place / MANIFEST).write_text("{}"), "that no run made"),
    "a file": (lambda place: (place / "thesis.tex").write_text("mine"), "thesis.tex"),
    "a hidden file": (lambda place: (place / ".env").write_text("mine"), ".env"),
    "a file in a folder": (
        lambda place: ((place / "more").mkdir(), (place / "more" / "thesis.tex").write_text("mine")),
        "more, more/thesis.tex",
    ),
    "an empty folder": (lambda place: (place / "more").mkdir(), "more"),
    "a link": (lambda place: (place / "data").symlink_to("/dev/null"), "data"),
    "a link to what a run wrote": (
        lambda place: (
            (place / "result.json").rename(place.parent / "mine"),
            (place / "result.json").symlink_to(place.parent / "mine"),
        ),
        "result.json",
    ),
    "a changed file": (lambda place: (place / "report.html").write_text("my remarks"), "report.html"),
    "a pipe": (lambda place: os.mkfifo(place / "pipe"), "pipe"),
}


def _contents(place: Path) -> dict[str, object]:
    return {
        path.relative_to(place).as_posix(): path.readlink() if path.is_symlink()
        else path.read_bytes() if path.is_file() else path.stat().st_mode
        for path in place.rglob("*")
    }  # fmt: skip


@posix
@pytest.mark.parametrize("what", FOREIGN)
def test_what_no_run_wrote_is_never_replaced(tmp_path: Path, what: str) -> None:
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "earlier")
    make, named = FOREIGN[what]
    make(tmp_path / "case")
    before = _contents(tmp_path)
    # before anything is computed
    with pytest.raises(RsgenError, match=named), replaced_folder(tmp_path, "case"):
        pytest.fail("the block began")
    assert _contents(tmp_path) == before


def test_what_came_during_a_run_is_not_replaced_either(tmp_path: Path) -> None:
    with replaced_folder(tmp_path, "case") as folder:
        fill(folder, "earlier")

    def late() -> None:
        with replaced_folder(tmp_path, "case") as folder:
            fill(folder, "later")
            (tmp_path / "case" / "thesis.tex").write_text("mine")

    with pytest.raises(RsgenError, match=r"thesis\.tex"):
        late()
    assert (tmp_path / "case" / "thesis.tex").read_text() == "mine"
    assert (tmp_path / "case" / "report.html").read_text() == "earlierearlier"
    assert [path.name for path in tmp_path.iterdir()] == ["case"]


def test_a_result_with_missing_files_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "case").mkdir()
    for text in ("first", "second"):
        with replaced_folder(tmp_path, "case") as folder:
            fill(folder, text)
        (tmp_path / "case" / "report.html").unlink()
    assert (tmp_path / "case" / "result.json").read_text() == "second"


def test_a_file_in_the_way_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "case").write_text("precious")

    def fail() -> None:
        with replaced_folder(tmp_path, "case"):
            pass

    with pytest.raises(RsgenError, match="is no folder"):
        fail()
    assert (tmp_path / "case").read_text() == "precious"


# ---------------------------------------------------------------- whole runs


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, CaseRun]:
    """A small case that was run once, its results' folder, and what became of it."""
    folder = tmp_path_factory.mktemp("run")
    path = write_case(folder)
    return path, folder / "out", run_case(path, folder / "out")


@pytest.mark.slow
def test_a_run_leaves_what_it_promises(finished: tuple[Path, Path, CaseRun]) -> None:
    path, out, run = finished
    assert run.faults == ()
    assert run.passed
    assert not run.skipped
    wanted = {"surface.h5", "kernel.py", "result.json", "notebook.ipynb", "report.html", MANIFEST}
    assert wanted <= set(content(out / "small"))
    manifest = read_manifest(out / "small")
    assert manifest is not None
    assert manifest["inputs"] == {"case": load_case(path).sha256}
    assert manifest["seed"] is None
    result = json.loads((out / "small" / "result.json").read_text())
    assert result["case"] == "small"
    assert result["passed"] is True


@pytest.mark.slow
def test_unchanged_is_skipped_and_changed_is_not(
    finished: tuple[Path, Path, CaseRun], tmp_path: Path
) -> None:
    path, out, _ = finished
    case = load_case(path)
    again = current_result(case, out)
    assert again is not None
    assert again.skipped
    assert again.passed
    changed = load_case(write_case(tmp_path, accept="2e-2"))
    assert current_result(changed, out) is None
    copied = tmp_path / "out"
    for damage in ("result.json", "surface.h5", MANIFEST):
        shutil.copytree(out, copied)
        assert current_result(case, copied) is not None
        (copied / "small" / damage).write_bytes(b"{}")
        assert current_result(case, copied) is None
        shutil.rmtree(copied)


@pytest.mark.slow
def test_a_faulty_case_stops_no_other(finished: tuple[Path, Path, CaseRun], tmp_path: Path) -> None:
    path, out, _ = finished
    bad = write_case(tmp_path, "bad", accept="'much'")
    twin = write_case(tmp_path, "SMALL")
    seen: list[str] = []
    runs = run_cases([bad, path, twin], out, finished=lambda run: seen.append(run.name))
    assert [run.passed for run in runs] == [None, True, None]
    assert "accept.k" in runs[0].faults[0]
    assert "is also the name of small.toml" in runs[2].faults[0]
    assert sorted(seen) == ["SMALL", "bad", "small"]
    assert runs[1].skipped
    assert (out / "index.html").is_file()
    assert "small" in (out / "table1.md").read_text()


@pytest.mark.slow
def test_a_report_is_written_anew_from_its_surface(
    finished: tuple[Path, Path, CaseRun], tmp_path: Path
) -> None:
    path, out, _ = finished
    shutil.copytree(out, tmp_path / "out")
    surface = (tmp_path / "out" / "small" / "surface.h5").read_bytes()
    run = run_case(path, tmp_path / "out", reuse_surface=True)
    assert run.faults == ()
    assert run.passed
    assert (tmp_path / "out" / "small" / "surface.h5").read_bytes() == surface
    assert read_manifest(tmp_path / "out" / "small") is not None
    # a surface of another case is not taken
    other = write_case(tmp_path, accept="3e-2")
    assert (
        "holds no surface of this very case"
        in run_case(other, tmp_path / "out", reuse_surface=True).faults[0]
    )


def test_results_never_go_where_the_case_lies(tmp_path: Path) -> None:
    path = write_case(tmp_path)
    assert "choose another --out" in run_case(path, tmp_path).faults[0]
    inside = tmp_path / "small"
    inside.mkdir()
    assert "choose another --out" in run_case(write_case(inside), tmp_path).faults[0]
    assert [file.name for file in inside.iterdir()] == ["small.toml"]


@pytest.mark.parametrize("name", ["index.html", "table1.md"])
def test_a_file_with_the_name_of_the_index_stays(tmp_path: Path, name: str) -> None:
    path, out = write_case(tmp_path), tmp_path / "out"
    out.mkdir()
    (out / name).write_text("<html>my homepage</html>")
    with pytest.raises(RsgenError, match="was not written by rsgen"):
        run_cases([path], out)
    assert [file.name for file in out.iterdir()] == [name]
    assert (out / name).read_text() == "<html>my homepage</html>"


@pytest.mark.skipif(os.name != "posix", reason="there are no such locks")
@pytest.mark.parametrize("process", [os.getpid(), NO_PROCESS], ids=["own", "foreign"])
def test_a_folder_that_another_run_fills_is_not_cleared(tmp_path: Path, process: int) -> None:
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


@pytest.mark.skipif(os.name != "posix", reason="there are no such locks")
def test_a_finished_folder_is_not_cleared_before_it_is_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its mark is gone then, and the disk may take its time."""
    others: list[threading.Thread] = []

    def sync(folder: Path) -> None:
        others.append(threading.Thread(target=recover, args=(tmp_path,)))
        others[-1].start()
        others[-1].join(0.1)
        assert folder.exists()

    monkeypatch.setattr("rsgen.app.study.folder.sync_folder", sync)
    with replaced_folder(tmp_path, "case") as part:
        (part / "report.html").write_text("done")
        write_manifest(part, {}, None, [])
    for other in others:
        other.join()
    assert read_manifest(tmp_path / "case") is not None


@pytest.mark.skipif(os.name != "posix", reason="there are no such locks")
def test_threads_that_begin_and_end_together_leave_each_other_alone(tmp_path: Path) -> None:
    def write(case: int) -> None:
        for _ in range(20):
            with replaced_folder(tmp_path, f"case{case}") as part:
                (part / "report.html").write_text("done")
                write_manifest(part, {}, None, [])

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(write, range(6)))
    assert len(list(tmp_path.iterdir())) == 6


def test_a_notebook_of_the_user_is_not_taken_for_a_failed_one(
    tmp_path: Path, finished: tuple[Path, Path, CaseRun]
) -> None:
    mine, changed, theirs = (tmp_path / f"{name}-failed.ipynb" for name in ("small", "changed", "other"))
    lesson = (finished[1] / "small" / "notebook.ipynb").read_text(encoding="utf-8")
    mine.write_text('{"metadata": {}, "cells": []}')
    # somebody looks for what went wrong in the notebook that was left
    changed.write_text(lesson.replace("import rsgen", "import rsgen, pdb", 1), encoding="utf-8")
    theirs.write_text(lesson, encoding="utf-8")
    for place in (mine, changed, theirs):
        with _failed_notebook(tmp_path, place):
            pass
    assert mine.exists()
    assert changed.exists()
    assert not theirs.exists()


def test_a_fault_of_the_case_is_a_value(tmp_path: Path) -> None:
    run = run_case(write_case(tmp_path, accept="-1"), tmp_path / "out")
    assert run.passed is None
    (fault,) = run.faults
    assert fault.startswith("small.toml: accept.k: is -1; a number above 0 ")
    assert not (tmp_path / "out").exists()


def _kill_workers(out: Path, times: dict[str, int]) -> tuple[Callable[[Step], None], dict[str, list[int]]]:
    """Give what kills the workers of some cases, as for want of memory, when the case has begun."""
    killed: dict[str, list[int]] = {name: [] for name in times}

    def kill(step: Step) -> None:
        for name, processes in killed.items():
            for folder in out.glob(f".{name}.*.part"):
                process = int(folder.name.split(".")[2])
                if len(processes) < times[name] and process not in processes:
                    processes.append(process)
                    os.kill(process, signal.SIGKILL)

    return kill, killed


@posix
@pytest.mark.thorough
def test_a_lost_worker_costs_its_own_case_only(tmp_path: Path) -> None:
    names = ("one", "two", "three")
    paths = [write_case(tmp_path, name) for name in names]
    times = {"one": 1, "two": 2}
    kill, killed = _kill_workers(tmp_path / "out", times)
    runs = {run.name: run for run in run_cases(paths, tmp_path / "out", workers=2, progress=kill)}
    assert {name: len(processes) for name, processes in killed.items()} == times
    # tried once more, and then reported
    assert [name for name in names if runs[name].passed is None] == ["two"]
    assert "its worker was lost, and a second one" in runs["two"].faults[0]
    assert all(read_manifest(tmp_path / "out" / name) for name in ("one", "three"))
    recover(tmp_path / "out")
    assert not list((tmp_path / "out").glob(".*"))


# ---------------------------------------------------------------- a real structure


@pytest.mark.thorough
def test_the_vibrating_wire_from_file_to_report(tmp_path: Path, measured_data: Callable[[str], Path]) -> None:
    data = measured_data("wire").parent
    path = Path(__file__).parents[1] / "cases" / "wire.toml"
    case = load_case(path, data=data)
    surface = read_measurement(case.test)
    # the head of the file: 12 drives, each up and down but the last, which was stopped after going up
    assert len(surface.levels) == 12
    runs = {(level, str(sweep)) for level, sweep in zip(surface.level, surface.sweep, strict=True)}
    assert len(runs) == 23
    # the resonance of the wire falls with the drive
    peaks = [
        surface.frequency[mask][np.argmax(surface.amplitude[mask])]
        for mask in (surface.level == surface.levels[0], surface.level == surface.levels[-2])
    ]
    assert peaks[0] > peaks[1] > 1600
    run = run_case(path, tmp_path / "out", data=data)
    assert run.faults == ()
    assert run.passed
    result = json.loads((run.folder / "result.json").read_text())
    assert result["surface"]["origin"] == "measured"
    assert len(result["equivalent"]["stiffness"]) == len(result["equivalent"]["amplitude"]) > 1000
    assert all(row["true"] is None for row in result["parameters"])
    found = {row["name"]: row["refined"]["value"] for row in result["parameters"]}
    assert np.sqrt(found["k"] / found["m"]) / (2 * np.pi) == pytest.approx(1633.3, abs=2.0)
    assert found["kn"] < 0 < found["cn"]


@pytest.mark.slow
@pytest.mark.parametrize("value", ["first", "second"])
def test_a_worker_has_the_settings_of_its_own_time(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RSGEN_PROBE", value)
    with local_workers(1, None) as executor:
        assert executor.submit(os.getenv, "RSGEN_PROBE").result(60) == value
