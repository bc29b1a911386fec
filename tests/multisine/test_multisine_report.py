"""A multisine from records in a file to check, run and page; prediction of a level that was held out."""

import json

import numpy as np
import pytest

import rsgen
from rsgen.common.errors import MeasurementError
from rsgen.identification.ranking.library_sums import library_terms
from rsgen.identification.results.result import held_out_lines
from rsgen.law.motion import waveform
from tests.case_files import MEASURED, write_small
from tests.virtual import multisine

pytestmark = pytest.mark.slow

TRUE = {"c": 4.0, "k": 5000.0, "k2": 6e4, "k3": 4e6}
MASS, RATE, PERIOD, PERIODS = 1.5, 256.0, 512, 6
LAW = "k*x + k2*x**2 + k3*x**3 + c*v"
LEVELS = (1.0, 4.0, 8.0)

CASE = {
    **MEASURED, "title": "A <b>multisine</b>", "element": [{"name": "all", "force": LAW}],
    "test.file": ["level1.csv", "level4.csv", "level8.csv"], "test.excitation": "multisine",
    "test.time": {"column": "t"}, "test.force": {"samples": "f", "unit": "N"},
    "test.response": {"quantity": "displacement", "samples": "x", "unit": "m"},
    "test.level": {"values": ["1 N", "4 N", "8 N"]}, "identify": {"hold_out": ["4 N"]},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("multisine")
    exact, generator = multisine(LAW, TRUE, LEVELS, MASS, periods=1, seed=3), np.random.default_rng(3)
    for level, *spectra in zip(LEVELS, exact.mean_force, exact.mean_response, strict=True):
        signals = [np.tile(waveform(one, PERIOD), PERIODS) for one in spectra]
        signals = [s + 1e-4 * s.std() * generator.standard_normal(len(s)) for s in signals]
        table = np.column_stack([np.arange(PERIOD * PERIODS) / RATE, *signals])
        np.savetxt(place / f"level{level:g}.csv", table, delimiter=",", header="t,f,x", comments="")
    write_small(place, "lines", CASE)
    return place


def test_a_case_of_a_multisine_runs_from_file_to_page(folder, run_cli):
    checked = run_cli("check", folder / "lines.toml")
    assert checked.code == 0, checked
    assert "54 excited lines of 3 records of 6 periods at 3 levels" in " ".join(checked.out.split())
    out = folder / "reports"
    run = run_cli("run", folder / "lines.toml", "--out", out)
    assert run.code == 0, run
    result = json.loads((out / "lines" / "result.json").read_text(encoding="utf-8"))
    values = {row["name"]: row["refined"]["value"] for row in result["parameters"]}
    for name, true in {**TRUE, "m": MASS}.items():
        assert values[name] == pytest.approx(true, rel=2e-3), name
    assert [one["level"] for one in result["best_linear"]] == [1.0, 8.0]
    (held,) = result["held_out"]
    assert (held["level"], held["error"] < 1e-3) == (4.0, True)
    # in the words of rsgen identify and print(found), also where the result is unchanged
    case = rsgen.load_case(folder / "lines.toml")
    (said,) = held_out_lines(rsgen.identify(rsgen.read(case), case.model).held_out)
    for answer in (run, run_cli("run", folder / "lines.toml", "--out", out)):
        assert f"  {said}" in answer.out.splitlines()
    page = (out / "lines" / "report.html").read_text(encoding="utf-8")
    assert "A &lt;b&gt;multisine" in page
    assert page.count("<figure>") == 4
    stored = np.load(out / "lines" / "spectra.npz")
    np.testing.assert_array_equal(stored["response"], rsgen.read(folder / "lines.toml").response)
    notebook = json.loads((out / "lines" / "notebook.ipynb").read_text(encoding="utf-8"))
    shown = {cell["id"]: "".join(map(str, cell.get("outputs", ()))) for cell in notebook["cells"]}
    assert "3 records of 6 periods" in shown["spectra"]
    assert "image/png" in shown["figure-predicted-record"]


def test_what_a_multisine_cannot_have_is_said_before_the_run(folder, run_cli):
    for changes, reason in (
        ({"test.demodulation": {"band": ["1 Hz", "9 Hz"]}}, "belongs to sines"),
        ({"identify.hold_out": ["5 N"]}, "no level 5 N in the test; it has 1, 4, 8 N"),
    ):
        checked = run_cli("check", write_small(folder, "odd", CASE | changes))
        assert checked.code == 2, checked
        assert reason in " ".join((checked.out + checked.err).split())
    with pytest.raises(MeasurementError, match="a level a record"):
        rsgen.MultisineSpectra([1.0], 1.0, np.ones((2, 5), complex), np.ones((2, 5), complex))


def test_a_case_ranks_laws_by_the_lines(folder, tmp_path, run_cli, monkeypatch):
    names = ("cubic-spring", "quadratic-spring", "coulomb")
    few = tuple(term for term in library_terms() if term.name in names)
    monkeypatch.setattr("rsgen.identification.ranking.selection.library_terms", lambda: few)
    case = write_small(tmp_path, "ranked", CASE | {"model": "rank", "element.1.force": "k*x + c*v"})
    listed = run_cli("rank", case, "--data", folder)
    best = "cubic-spring + quadratic-spring"
    assert f"{best} + linear-damper fits best: what it leaves unexplained at" in listed.out
    written = run_cli("run", case, "--data", folder, "--out", tmp_path / "out")
    assert written.code == 0, written
    (path,) = tmp_path.glob("out/*/notebook.ipynb")
    assert best in path.with_name("report.html").read_text(encoding="utf-8")
    result = json.loads(path.with_name("result.json").read_text(encoding="utf-8"))
    assert result["ranking"]["candidates"][0]["name"] == best
    assert "rsgen.rank(spectra" in path.read_text(encoding="utf-8")
