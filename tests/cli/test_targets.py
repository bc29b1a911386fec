"""Files of the user where a command writes: refused in a sentence before it computes, and left alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import pytest

from rsgen.analysis.export import save_frf
from rsgen.app.cli.options import FRF, MODAL, SURFACE, is_foreign
from rsgen.data.surface import save_surface
from rsgen.identification.modal_table import modal_table
from rsgen.report.notebook import build_notebook
from rsgen.report.provenance import is_unchanged_notebook
from tests.samples import cubic_case, cubic_model, cubic_surface

MINE = b"three years of work"
SMALL = """
schema = 1
name = "small"
title = "A small case"
system = { mass = "1.5 kg" }
element = [{ name = "spring", force = "k*x + c*v" }]
truth = { k = 5920.0, c = 8.0 }

[test]
kind = "simulated"
level = { start = 2, stop = 10, count = 3 }
frequency = { start = 8, stop = 12, count = 21 }
"""


@pytest.fixture
def simulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.toml"
    path.write_text(SMALL, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("simulate", "small.toml"), "small.h5"),
        (("simulate", "small.toml", "--out", "thesis.tex"), "thesis.tex"),
        (("identify", "small.toml", "--frf", "impact.uff"), "impact.uff"),
        (("modal", "small.toml", "--csv", "logbook.csv"), "logbook.csv"),
    ],
)
def test_a_file_of_the_user_is_not_written_over(
    words: tuple[str, ...], name: str, simulated: Path, run_cli: Callable[..., Any]
) -> None:
    mine = simulated.parent / name
    mine.write_bytes(MINE)
    answer = run_cli(*words)
    assert answer.code == 2
    assert f"{name}: is there and not as rsgen wrote it" in answer.err
    assert mine.read_bytes() == MINE


def test_the_case_is_not_written_over(simulated: Path, run_cli: Callable[..., Any]) -> None:
    answer = run_cli("simulate", "small.toml", "--out", "small.toml")
    assert (answer.code, "is read by this command" in answer.err) == (2, True)
    assert simulated.read_text(encoding="utf-8") == SMALL


def test_an_empty_file_is_filled(simulated: Path, run_cli: Callable[..., Any]) -> None:
    (simulated.parent / "new.h5").touch()
    assert run_cli("simulate", "small.toml", "--out", "new.h5").code == 0


def test_a_file_that_a_command_wrote_is_replaced(tmp_path: Path) -> None:
    surface, model = cubic_surface(), cubic_model()
    save_surface(tmp_path / "a.h5", surface)
    save_frf(tmp_path / "a.uff", surface)
    (tmp_path / "a.csv").write_text(modal_table(surface, model).to_csv(), encoding="utf-8")
    for name, mark in (("a.h5", SURFACE), ("a.uff", FRF), ("a.csv", MODAL)):
        assert not is_foreign(tmp_path / name, mark)
        assert not is_foreign(tmp_path / "missing", mark)
    assert is_foreign(tmp_path, SURFACE)


def test_a_notebook_is_replaced_until_a_user_changes_a_cell(tmp_path: Path) -> None:
    path, notebook = tmp_path / "made.ipynb", build_notebook(cubic_case())
    nbformat.write(notebook, path)
    assert is_unchanged_notebook(path)
    notebook.cells[-1].outputs = [nbformat.v4.new_output("stream", text="executed again")]
    nbformat.write(notebook, path)
    assert is_unchanged_notebook(path)
    notebook.cells[-1].source += "\n# my remark"
    nbformat.write(notebook, path)
    assert not is_unchanged_notebook(path)
