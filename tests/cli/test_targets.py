"""Files of the user where a command writes: refused in a sentence before it computes, and left alone."""

import pytest

from rsgen.app.cli.options import MODAL, SURFACE, is_foreign
from rsgen.data.surface import save_surface
from rsgen.identification.modal_table import modal_table
from tests.case_files import write_small
from tests.samples import cubic_model, cubic_surface

MINE = b"three years of work"


@pytest.fixture
def simulated(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return write_small(tmp_path)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("simulate", "small.toml"), "small.h5"),
        (("simulate", "small.toml", "--out", "thesis.tex"), "thesis.tex"),
        (("modal", "small.toml", "--csv", "logbook.csv"), "logbook.csv"),
    ],
)
def test_a_file_of_the_user_is_not_written_over(words, name, simulated, run_cli):
    mine = simulated.parent / name
    mine.write_bytes(MINE)
    answer = run_cli(*words)
    assert answer.code == 2
    assert f"{name}: is there and not as rsgen wrote it" in answer.err
    assert mine.read_bytes() == MINE


def test_a_wildcard_says_that_files_are_listed(simulated, run_cli):
    answer = run_cli("init", "clamp", "--from", "*.csv")
    assert answer.code == 2
    assert "one file, without a wildcard, is read at a time; a case lists several: file = [...]" in answer.err


def test_the_case_is_not_written_over(simulated, run_cli):
    before = simulated.read_bytes()
    answer = run_cli("simulate", "small.toml", "--out", "small.toml")
    assert (answer.code, "is read by this command" in answer.err) == (2, True)
    assert simulated.read_bytes() == before


def test_a_file_that_a_command_wrote_is_replaced(tmp_path):
    surface, model = cubic_surface(), cubic_model()
    save_surface(tmp_path / "a.h5", surface)
    (tmp_path / "a.csv").write_text(modal_table(surface, model).to_csv(), encoding="utf-8")
    for name, mark in (("a.h5", SURFACE), ("a.csv", MODAL)):
        assert not is_foreign(tmp_path / name, mark)
        assert not is_foreign(tmp_path / "missing", mark)
    assert is_foreign(tmp_path, SURFACE)
