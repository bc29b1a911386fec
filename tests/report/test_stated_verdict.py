"""The verdict on a result: one place reaches it, and everything that a user reads says the same of it."""

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.common.finding import Finding, Quantity, reach_verdict, reasons_of, steps_once
from rsgen.report import sentences
from rsgen.report.page import write_index
from rsgen.report.provenance import coded
from rsgen.report.result_json import read_results
from rsgen.report.sentences import NEXT_STEPS, full_sentence, next_step, state_verdict
from tests.report.test_report import IDENTIFICATION, PREDICTION, Outline, page
from tests.samples import cubic_comparison, cubic_result, write_result
from tests.surfaces import MASS, changed, model, surface, truth

ERROR = Finding("structure-feeds-exciter", "error")
DOUBT = Finding("law-does-not-fit", "doubt", numbers={"misfit": 0.05})
WARNING = Finding("points-excluded", "warning", numbers={"excluded": 3, "points": 90})


def found_with(*findings: Finding):
    return replace(IDENTIFICATION, findings=findings)


def test_what_a_unit_that_was_misread_may_explain_is_counted_behind_it():
    read = {"file": "a.csv", "column": "phase", "unit": "rad", "beyond": "yes"}
    degrees = Finding("unit-contradicts-title", "doubt", names=read)
    fed = Finding("damping-feeds-energy", "doubt", "c", {"value": Quantity(-1.0), "share": Quantity(1.0)})
    stated = state_verdict(found_with(fed, ERROR, degrees).verdict)
    cause, rest = reasons_of(stated)
    assert cause == full_sentence(degrees)
    assert rest.endswith(": 2 findings.")
    assert steps_once(stated) == [next_step(degrees)]


@pytest.mark.parametrize(("tolerance", "findings", "held_out", "state", "decided"), [
    (None, (WARNING,), (), "identified", ()), (1.0, (WARNING,), (), "accepted", ()),
    (0.0, (), (), "missed", ()), (1.0, (), (DOUBT,), "doubtful", (DOUBT,)),
    (0.0, (DOUBT,), (), "doubtful", (DOUBT,)),
    (1.0, (DOUBT, WARNING, ERROR), (), "rejected", (ERROR, DOUBT)),
])  # fmt: skip
def test_the_gravest_of_test_fit_and_held_out_levels_decides(tolerance, findings, held_out, state, decided):
    found = found_with(*findings)
    prediction = replace(PREDICTION, findings=held_out)
    verdict = rsgen.verdict_of(found, cubic_comparison(found, tolerance), prediction)
    assert (verdict.state, verdict.decided_by) == (state, decided)
    stated = cubic_result(tolerance, *findings, held_out=held_out)["verdict"]
    assert stated == json.loads(json.dumps(state_verdict(verdict)))
    assert stated["headline"].startswith(f"{state.capitalize()}: ")
    assert stated["sentences"] == [full_sentence(finding) for finding in decided]
    assert stated["next_steps"] == [next_step(finding) for finding in decided]
    assert all(step.endswith(".") for step in stated["next_steps"])
    assert verdict.usable == (state in ("accepted", "identified"))


@pytest.mark.parametrize(("decided", "shown"), [
    ((replace(DOUBT, severity="error"), replace(ERROR, severity="doubt")), 2),
    ((ERROR, DOUBT, Finding("another-quantity", "doubt", numbers={"then": 0.01}, names={"is": "+2"})), 1),
])  # fmt: skip
def test_what_is_printed_and_what_is_explained_have_one_order_and_one_first_step(decided, shown):
    found = found_with(WARNING, *decided)
    stated = state_verdict(found.verdict)
    codes = [one["code"] for one in stated["decided_by"]]
    assert codes[0] == decided[-1].code
    lines = str(found).splitlines()
    assert lines[0] == f"{found.verdict.state} ({', '.join(codes)})"
    begin = next(at for at, line in enumerate(lines) if line.startswith(f"{decided[-1].severity}: "))
    first, more = stated["next_steps"][0], len(decided) - shown
    assert lines[begin + shown + bool(more)] == f"next: {first}"
    assert f"follow from that: {more} findings." in lines[begin + 1] or not more
    assert lines[-1] == str(WARNING)
    assert rsgen.explain(found).splitlines()[1] == f"  because: {stated['sentences'][0]}"


@pytest.mark.parametrize(("origin", "given", "said"), [
    ("measured", {}, True), ("simulated", {}, False), ("measured", {"m": MASS}, False),
    ("measured", {"k": 5920.0}, False),
])  # fmt: skip
def test_a_verdict_says_that_nothing_checks_the_units(origin, given, said):
    table = changed(surface("cubic", levels=np.array([2.0, 4.0, 8.0])), origin=origin)
    found = rsgen.identify(table, model("cubic").elements, fixed=given)
    assert found.verdict.state == "identified"
    assert ("nothing checks the units" in rsgen.explain(found)) is said
    assert ("all values scale with the units" in str(found)) is said


@pytest.mark.parametrize(("labels", "given", "said"), [
    (True, {"m": MASS, "k": 5920.0}, True), (True, {"m": MASS, "kn": truth("cubic")["kn"]}, False),
    (False, {}, False), (None, {}, True),
])  # fmt: skip
def test_a_verdict_says_that_levels_are_labels_and_no_check_of_accelerations(labels, given, said):
    table = surface("cubic", levels=np.array([2.0, 4.0, 8.0]))
    names = table.level / 2 if labels else None
    shaken = changed(
        table, force=table.force / MASS, level=table.level / MASS, label=names, base="acceleration",
        per_mass=True, origin="measured",
    )  # fmt: skip
    if labels is None:
        # as reading says it where a case has no levels
        shaken = changed(shaken, findings=(Finding("not-recorded", "info", names={"signal": "levels"}),))
    found = rsgen.identify(shaken, model("cubic").elements, fixed=given)
    assert found.verdict.state == "identified", rsgen.explain(found)
    assert ("nothing checks the unit of base and response" in rsgen.explain(found)) is said


def test_the_first_step_is_the_one_that_matters_most():
    numbers = {"misfit": 0.1, "z": 9.0, "size": 0.1, "alternatives": 1, "left": 0.05}
    parts = Finding("parts-disagree", "error", "", numbers, {"parts": "levels"})
    misfit = Finding("law-does-not-fit", "doubt", "", numbers, {"term": "v*abs(v)"})
    ambiguous = Finding("levels-predicted-worse", "doubt", numbers={"predicted": 0.5, "fitted": 0.01})
    sign = Finding("not-passive", "doubt", names={"reversed": "channel", "against": "power"})

    def order(*decided):
        return [one.code for one in reach_verdict(decided).decided_by]

    assert order(ambiguous, parts, misfit) == ["law-does-not-fit", "parts-disagree", "levels-predicted-worse"]
    assert order(parts, misfit, sign)[0] == "not-passive"
    # a term that the law lacks makes parts of a test differ, and comes before the rig
    assert next_step(parts).startswith("Suspect the law first")
    lacks = Finding("law-ambiguous", "doubt", "c", {"errors": 9.0, "moved": 0.3}, {"term": "v**3"})
    assert order(parts, lacks) == ["law-ambiguous", "parts-disagree"]
    assert next_step(replace(misfit, names={"ranked": "none fits"})) == ""


@pytest.mark.slow
def test_a_rejected_page_marks_its_numbers():
    text = page(found_with(DOUBT, ERROR)).replace("\u00a0", " ")
    begin = text.index('class="verdict rejected">Rejected: these numbers are not to be used')
    for finding in (ERROR, DOUBT):
        assert begin < text.index(full_sentence(finding)) < text.index("<table")
        # one list of steps, below the numbers
        assert text.count(str(coded(next_step(finding)))) == 1
        steps = text.index("What to do next")
        assert text.index("<table") < steps < text.index(str(coded(next_step(finding))))
    marked = '<strong class="no">Not to be used: </strong>'
    assert f"<caption>{marked}True against identified values" in text
    assert text.count(f"<caption>{marked}") == text.count("<caption>") >= 4
    assert text.count(f"<figcaption>{marked}") >= 3
    assert "This is the estimate to use" not in text
    assert "the result is rejected" in text


@pytest.mark.slow
def test_index_and_table_show_the_verdict_of_every_case_that_can_be_read(tmp_path):
    remark = Finding("note", "info", names={"text": "text"})
    fine = (1.0, WARNING, remark, remark)
    made = {"doubted": (1.0, DOUBT), "fine": fine, "odd #1": (None,), "wrong": (None, ERROR)}
    for name, found in made.items():
        write_result(tmp_path, cubic_result(*found) | {"title": "A <b>{{7*7}}</b> spring"}, name)
    faulty = {"broken": "{", "other": "[]", "future": '{"schema": 99}', "null": "null"}
    for name, content in faulty.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(content, encoding="utf-8")
    write_index(tmp_path)
    assert [entry.folder.name for entry in read_results(tmp_path)] == [*made]
    text = (tmp_path / "index.html").read_text()
    outline = Outline(text)
    links = {str(link["href"]) for link in outline.all("a")}
    assert {"fine/report.html", "odd%20%231/report.html"} <= links
    assert "A <b>{{7*7}}</b> spring" in "".join(outline.texts)
    assert len(outline.ids) == len(set(outline.ids))
    assert [len(outline.all("svg")), len(outline.all("script"))] == [0, 0]
    assert "4 cases: 1 accepted, 1 identified, 1 doubtful, 1 rejected." in text
    assert "Rejected: these numbers are not to be used</strong>: structure feeds exciter" in text
    assert "Accepted: " in text
    assert "; 1 warning and 2 notes" in text
    assert text.count('data-status="rejected"') == 2
    assert ['id="show-doubtful"' in text, 'id="show-missed"' in text] == [True, False]
    # all four have one title
    assert all(f" ({name})</h3>" in text for name in made)


TEXTS = tomllib.loads(Path(sentences.__file__).with_name("findings.toml").read_text(encoding="utf-8"))


def test_what_a_case_is_to_change_is_said_to_python_users_too():
    """Keys of a case have the argument, or what is to be done to the array, in brackets."""
    # columns of a file have titles, and come from a case
    said = [TEXTS[code].get("next", "") for code in NEXT_STEPS if code != "unit-contradicts-title"]
    for text in (text for one in said for text in ([one] if isinstance(one, str) else one.values())):
        if re.search(r"\[identify\]|\[system\]|test\.response|\(rsgen |in the case", text):
            assert "in Python" in text, text


def test_a_test_of_one_level_says_what_it_shows():
    outcome = replace(IDENTIFICATION.outcome, numbers={**IDENTIFICATION.outcome.numbers, "levels": 1})
    for found, said in ((IDENTIFICATION, False), (replace(IDENTIFICATION, outcome=outcome), True)):
        for shown in (str(found), rsgen.explain(found)):
            assert ("one level shows the law at its own" in shown) is said
