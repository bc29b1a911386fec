"""What a terminal and a script see of a verdict: its lines, and the exit code."""

import json
import shutil
from pathlib import Path

import pytest

from rsgen.app.cli.run_command import exit_code
from rsgen.app.study.run_case import CaseRun
from rsgen.common.finding import Finding, Verdict, reasons_of
from rsgen.report.sentences import state_verdict

FORMATS = Path(__file__).parents[2] / "cases" / "formats"


def run_of(state: str | None) -> CaseRun:
    if state is None:
        return CaseRun(Path("a.toml"), "a", faults=("a.toml: is wrong",))
    doubt = Finding("law-does-not-fit", "doubt", numbers={"misfit": 0.05})
    verdict = Verdict(state, (doubt,) if state in ("doubtful", "rejected") else ())
    return CaseRun(Path("a.toml"), "a", Path("a"), state != "missed", verdict=state_verdict(verdict))


@pytest.mark.parametrize(("states", "code"), [
    ((), 0), (("accepted", "identified"), 0), (("accepted", "missed"), 1), (("doubtful", "accepted"), 1),
    (("rejected",), 1), (("rejected", None), 2), ((None,), 2),
])  # fmt: skip
def test_a_script_goes_on_with_accepted_and_identified_results_only(states, code):
    assert exit_code([run_of(state) for state in states]) == code


@pytest.mark.slow
@pytest.mark.parametrize(("old", "new", "state", "decided"), [
    pytest.param("", "", "identified", set(), marks=pytest.mark.thorough),
    ('phase_sense = "lag"', 'phase_sense = "lead"', "rejected", {"structure-feeds-exciter"}),
])  # fmt: skip
def test_every_command_says_the_same_of_a_measured_test(old, new, state, decided, tmp_path, run_cli):
    shutil.copy(FORMATS / "table.csv", tmp_path)
    path, out = tmp_path / "case.toml", tmp_path / "out"
    path.write_text((FORMATS / "csv-table.toml").read_text().replace(old, new))
    run = run_cli("run", path, "--out", out, "--json")
    (ran,) = json.loads(run.out)
    verdict = ran["verdict"]
    assert (verdict["state"], run.code) == (state, 0 if state == "identified" else 1)
    assert decided <= {finding["code"] for finding in verdict["decided_by"]}
    folder = out / "csv-table"
    written = json.loads((folder / "result.json").read_text())
    assert written["verdict"] == verdict
    for page in (folder / "report.html", out / "index.html"):
        assert verdict["headline"] in page.read_text().replace("\u00a0", " ")
    assert json.dumps(verdict["headline"])[1:-1] in (folder / "notebook.ipynb").read_text()
    # without a report, and of an unchanged result, the verdict is the same
    answer = run_cli("identify", path, "--json")
    identified = json.loads(answer.out)
    same = (run.code, verdict, written["parameters"], written["residual"]["relative"])
    assert (answer.code, *(identified[key] for key in ("verdict", "parameters", "residual"))) == same
    answer = run_cli("identify", path)
    assert (answer.code, answer.out.startswith(verdict["headline"])) == (run.code, True)
    begin = answer.out.index("parameter  ")
    values = answer.out[begin : answer.out.index("amplitude ", begin)]
    answer = run_cli("run", path, "--out", out)
    assert (answer.code, answer.out.count("  because: ")) == (run.code, len(reasons_of(verdict)))
    assert answer.out.startswith(f"csv-table: {verdict['headline']} (unchanged)")
    # its law with its values, and its warnings
    law = " + ".join(element["force"] for element in written["elements"])
    assert f"\n{law}\n{values}" in answer.out
    said = zip(written["findings"], written["warnings"], strict=True)
    warned = [text for finding, text in said if finding["severity"] == "warning"]
    assert all(f"  warning: {text}" in answer.out for text in warned[:5])
