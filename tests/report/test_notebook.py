"""The notebook: what comes from files is literal or prose, calls are public, failures are saved."""

import ast
import json
from ast import literal_eval
from dataclasses import replace

import nbformat
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nbclient import NotebookClient

import rsgen
from rsgen.identification.prediction.resonance_curves import predict_shown
from rsgen.report.notebook import build_notebook, literal, prose, write_notebook
from tests.case_files import CUBIC, write_small
from tests.report.test_report import HOSTILE_TITLES
from tests.samples import cubic_case
from tests.surfaces import MASS, changed, model, surface

SPRING = {
    "title": "Hardening spring <b>, $x$, [c](javascript:alert(1))", **CUBIC, "truth.c": 3.8,
    "test.level": {"start": 1, "stop": 8, "count": 3},
    "test.frequency": {"start": 9, "stop": 11, "count": 25}, "accept.k": 1e-3,
}  # fmt: skip


def code_cells(notebook: nbformat.NotebookNode) -> list[str]:
    return [cell.source for cell in notebook.cells if cell.cell_type == "code"]


@pytest.mark.slow
@given(st.text() | st.text("\"'\\\n\t\r{}%!?$\ud800\u202e\x00"))
def test_literal_is_the_text_on_one_line(text):
    written = literal(text)
    assert literal_eval(written) == text
    assert written.isprintable()


@given(st.text("ab[](){}<>`*_\\$!|#:@~&.http\n"))
def test_prose_has_no_markup(text):
    written = prose(text)
    # what is left of a special character is its number, between & and ;
    plain = written.replace("&#", "").replace(";", "")
    assert not set(plain) & set("[]{}<>`*_\\$|!@~&:\n")


@pytest.mark.parametrize("title", HOSTILE_TITLES, ids=lambda title: ascii(title[:24]))
def test_texts_of_a_case_are_never_code(title):
    tame = build_notebook(cubic_case())
    hostile = build_notebook(cubic_case(title=title, source=title, text=f"{title}\n"))
    nbformat.validate(hostile)
    json.dumps(hostile, ensure_ascii=True)

    texts: list[str] = []

    def shape(source: str) -> str:
        tree = ast.parse(source)
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "CASE":
                texts.append(literal_eval(node.value))
                node.value = ast.Constant("")
        return ast.dump(tree)

    assert list(map(shape, code_cells(hostile))) == list(map(shape, code_cells(tame)))
    assert texts[0] == f"{title}\n".replace("\r\n", "\n")
    for cell in hostile.cells:
        if cell.cell_type == "markdown":
            assert "<" not in cell.source
            assert "](" not in cell.source
    # magics and shell lines of IPython begin a line; nothing of a case does
    for source in code_cells(hostile):
        assert not any(line.lstrip().startswith(("!", "%", "?")) for line in source.splitlines())


def test_a_notebook_predicts_the_levels_of_the_page():
    driven = surface("cubic", levels=np.array([1.9, 3.8, 7.6]))
    table = changed(driven, level=np.array([2.0, 4.0, 8.0])[np.searchsorted(driven.levels, driven.level)])
    asked = model("cubic", MASS, hold_out=(4.0,))
    asked = replace(asked, observation=replace(asked.observation, predict=(3.81, 6.0)))
    found = rsgen.identify(table, asked)
    cells = {cell.id: cell.source for cell in build_notebook(cubic_case()).cells}
    space = {"rsgen": rsgen, "figures": rsgen.figures, "surface": table, "identification": found}
    exec(cells["prediction"], space | {"case": cubic_case(model=asked)}, space)
    levels = [curve.level for curve in space["prediction"]]
    assert levels == [curve.level for curve in predict_shown(table, found)] == [1.9, 3.8, 6.0, 7.6]
    assert "balance of all harmonics for $\\omega$; its first order is $F^2" in cells["about-prediction"]


def test_only_the_public_interface_is_called():
    books = [build_notebook(cubic_case(), loops=more, held_out=more) for more in (False, True)]
    source = "\n".join(cell for book in books for cell in code_cells(book))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            assert {alias.name for alias in node.names} <= {"pathlib", "tempfile", "rsgen"}
        elif isinstance(node, ast.ImportFrom):
            assert (node.module, [alias.name for alias in node.names]) == ("rsgen", ["figures"])
        elif isinstance(node, ast.Attribute) and getattr(node.value, "id", "") in ("rsgen", "figures"):
            module = rsgen if node.value.id == "rsgen" else rsgen.figures
            assert node.attr in module.__all__


def outputs(notebook: nbformat.NotebookNode) -> dict[str, list[nbformat.NotebookNode]]:
    return {cell.id: cell.outputs for cell in notebook.cells if cell.cell_type == "code"}


@pytest.mark.thorough
def test_the_run_and_a_kernel_of_its_own_give_the_same_notebook(tmp_path, monkeypatch):
    """A kernel in an empty folder has the public interface alone; the run gives its cells what it has."""
    source = write_small(tmp_path, "once", SPRING)
    case = rsgen.load_case(source)
    source.unlink()
    surface = rsgen.simulate(case.oscillator, case.test)
    identification = rsgen.identify(surface, case.model)
    comparison = rsgen.compare(identification, case.truth, case.accept)
    rsgen.write_report(tmp_path / "out", surface, identification, case=case, comparison=comparison)
    run = nbformat.read(tmp_path / "out" / "notebook.ipynb", as_version=4)
    nbformat.validate(run)
    assert str(tmp_path) not in str(run)
    alone = build_notebook(case)
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("MPLBACKEND", "agg")
    client = NotebookClient(alone, timeout=300, coalesce_streams=True, record_timing=False)
    client.execute(cwd=str(tmp_path / "empty"))
    assert outputs(run) == outputs(alone)
    assert [cell.source for cell in run.cells] == [cell.source for cell in alone.cells]
    assert str(comparison) == outputs(run)["comparison"][-1]["data"]["text/plain"]
    kinds = {output.get("name", output.output_type) for cell in outputs(run).values() for output in cell}
    assert kinds == {"stdout", "execute_result"}


def test_failed_notebook_is_saved_and_says_which_cell(tmp_path):
    target = tmp_path / "notebook.ipynb"
    with pytest.raises(rsgen.RsgenError, match=r"notebook\.ipynb: cell case: CaseError"):
        write_notebook(target, cubic_case(text="not a case"))
    assert outputs(nbformat.read(target, as_version=4))["case"][-1].output_type == "error"
