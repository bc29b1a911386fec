"""The command `rsgen examples`: the cases and data of the documentation, in any folder."""

import json

from tests.try_wheel import ROOT, files_of


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
