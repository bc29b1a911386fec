"""Files of the user where a command writes are left alone."""

import json

import pytest

from tests.case_files import write_small
from tests.try_wheel import ROOT, files_of


@pytest.fixture
def simulated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return write_small(tmp_path)


def test_a_wildcard_says_that_files_are_listed(simulated, run_cli):
    answer = run_cli("init", "clamp", "--from", "*.csv")
    assert answer.code == 2
    assert "one file, without a wildcard, is read at a time; a case lists several: file = [...]" in answer.err


def test_examples_are_the_cases_of_the_repository(run_cli, tmp_path):
    told = run_cli("examples", tmp_path / "new", "--json")
    assert told.code == 0
    written = sorted(path for path in (tmp_path / "new").rglob("*") if path.is_file())
    assert sorted(json.loads(told.out)["files"]) == [str(path) for path in written]
    assert {path.relative_to(tmp_path / "new").as_posix() for path in written} == files_of("cases")
    for path in written:
        assert path.read_bytes() == (ROOT / path.relative_to(tmp_path / "new")).read_bytes()


def test_what_is_there_and_differs_is_named_and_stays(run_cli, tmp_path):
    assert run_cli("examples", tmp_path).code == 0
    changed, missing = tmp_path / "cases" / "cubic.toml", tmp_path / "cases" / "bilinear.toml"
    changed.write_text("mine")
    missing.unlink()
    told = run_cli("examples", tmp_path)
    assert (told.code, told.err.startswith(f"{changed}: is there and differs")) == (2, True)
    assert (changed.read_text(), missing.exists()) == ("mine", False)
    changed.unlink()
    assert run_cli("examples", tmp_path).code == 0
    assert missing.exists()
