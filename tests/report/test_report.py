"""The report as a whole, its page, result.json and the index: text stays text, numbers stay numbers."""

import json
import re
import shutil
import unicodedata
from ast import literal_eval
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jinja2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import rsgen
from rsgen import Comparison, Finding
from rsgen.data.oscillator import Model
from rsgen.formula.printing import write
from rsgen.formula.reading import parse
from rsgen.identification.results import Estimate, Identification, changed
from rsgen.law.element import Element, make_element
from rsgen.report import draw_all, write_index
from rsgen.report import page as report_page
from rsgen.report import page_tables as tables
from rsgen.report.files import check_printed
from rsgen.report.page import (
    describe_elements,
    element_finding,
    page_context,
    render_page,
    resonance_at_ends,
    resonance_course,
)
from rsgen.report.provenance import Subject, page_environment, plain_text
from rsgen.report.result_json import Parts, build_result, finite_or_none, read_results, result_text
from rsgen.report.sentences import error_text, sentence
from tests.case_files import CUBIC, GONE, SMALL
from tests.case_files import changed as changed_case
from tests.samples import (
    C1,
    K1,
    MASS,
    cubic_case,
    cubic_comparison,
    cubic_identification,
    cubic_model,
    cubic_prediction,
    cubic_surface,
    empty_drawings,
)

SURFACE = cubic_surface()
IDENTIFICATION = cubic_identification(SURFACE)
PREDICTION = cubic_prediction(SURFACE, held_out=(1.0,))
COMPARISON = cubic_comparison(IDENTIFICATION)
CORPUS = Path(__file__).parents[1] / "corpus" / "titles.json"
MOST_BYTES = 2_000_000  # a mail still takes it


def cubic_subject(**changes: Any) -> Subject:
    return Subject.of_case(cubic_case(**changes), IDENTIFICATION)


def hostile_titles() -> list[str]:
    titles = []
    for entry in json.loads(CORPUS.read_text(encoding="utf-8")):
        text = entry["input"]
        # long texts are written as Python literals of a repetition
        repeated = re.fullmatch(r'@@PY:("(?:[^"\\]|\\.)*")\s*\*\s*(\d+)', text)
        titles.append(literal_eval(repeated[1]) * int(repeated[2]) if repeated else text)
    return titles


@pytest.fixture(scope="module")
def drawings():
    return draw_all(cubic_subject(), SURFACE, IDENTIFICATION, PREDICTION)


def page(drawings: Sequence[Any], found: Identification = IDENTIFICATION, **changes: Any) -> str:
    subject = cubic_subject(**changes)
    parts = Parts(subject, SURFACE, found, COMPARISON, PREDICTION, check_printed(subject, found))
    return render_page(page_context(parts, drawings, {"Versions": "rsgen"}))


def test_the_resonance_is_solved_once_for_all_elements(monkeypatch):
    solve, calls = report_page.smooth_backbone, list[Any]()
    monkeypatch.setattr(report_page, "smooth_backbone", lambda *given: calls.append(given) or solve(*given))
    page_context(Parts(cubic_subject(), SURFACE, IDENTIFICATION, COMPARISON, PREDICTION), [], {})
    assert len(calls) == 1


def described(element: Element, identification: Identification) -> str:
    return describe_elements([element], identification)[element.name]


class Outline(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def count(self) -> Counter[str]:
        return Counter(tag for tag, _ in self.elements)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.mark.slow
def test_page_needs_no_network_and_runs_nothing(drawings):
    text = page(drawings)
    outline = Outline(text)
    assert len(text.encode()) < MOST_BYTES
    policy = outline.all("meta")[1]
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert str(policy["content"]).startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'")
    assert not {"script", "iframe", "object", "embed", "form", "base"} & set(outline.count())
    for tag, attributes in outline.elements:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:")), (tag, value)
    assert not re.search(r"@import|url\((?!#|data:)", text)


def test_page_can_be_found_through(drawings):
    outline = Outline(page(drawings))
    counts = outline.count()
    assert all(counts[landmark] == 1 for landmark in ("main", "header", "nav", "footer", "h1", "title"))
    names = [attributes["id"] for _, attributes in outline.elements if "id" in attributes]
    assert len(names) == len(set(names))
    for link in outline.all("a"):
        assert str(link["href"]).removeprefix("#") in names
    levels = [int(tag[1]) for tag, _ in outline.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
    assert counts["table"] == counts["caption"]
    assert all(cell.get("scope") in ("row", "col") for cell in outline.all("th"))
    for figure in outline.all("svg"):
        assert figure["role"] == "img"
        assert re.search(r"\d", str(figure["aria-label"]))
    assert all("lang" in element for element in outline.all("html"))


@pytest.mark.parametrize(("share", "said"), [(0.9, False), (-1.1, True), (np.nan, False)])
def test_a_page_says_where_higher_harmonics_part_the_points_from_the_formulas(share, said):
    low, high = IDENTIFICATION.refined[0].interval
    bias = (share * (high - low) / 2, *[0.0] * (len(IDENTIFICATION.first_order) - 1))
    found = replace(IDENTIFICATION, first_order_bias=bias)
    assert IDENTIFICATION.first_order[0].name == found.refined[0].name
    parts = Parts(cubic_subject(), SURFACE, found, COMPARISON, PREDICTION)
    assert (
        "Higher harmonics matter in this test" in render_page(page_context(parts, empty_drawings(), {}))
    ) is said


@pytest.mark.slow
@pytest.mark.parametrize("title", hostile_titles(), ids=lambda title: ascii(title[:24]))
def test_titles_are_text(title):
    tame = Outline(page(empty_drawings()))
    found = replace(IDENTIFICATION, findings=(Finding.note(title),))
    text = page(empty_drawings(), found, title=title, source=title, text=title, name="cubic")
    text.encode("utf-8")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202a-\u202e\u2066-\u2069]", text)
    outline = Outline(text)
    added = outline.count() - tame.count()
    assert set(added) <= {"li", "ul", "p", "a", "div", "section", "h2"}, added  # the list of warnings
    assert plain_text(title or "cubic") in "".join(outline.texts)


@given(st.text(max_size=60))
def test_plain_text_is_printable_and_keeps_what_is(text):
    shown = plain_text(text)
    shown.encode("utf-8")
    assert not {unicodedata.category(c) for c in shown} & {"Cc", "Cf", "Cs", "Zl", "Zp"}
    if text.isprintable():
        assert shown == text


def test_a_missing_value_is_an_error():
    with pytest.raises(jinja2.UndefinedError):
        page_environment().get_template("report/report.html").render({"title": "x"})


def result(comparison: Comparison = COMPARISON, identification: Identification = IDENTIFICATION):
    subject = Subject.of_case(cubic_case(), identification)
    printed = check_printed(subject, identification)
    parts = Parts(subject, SURFACE, identification, comparison, PREDICTION, printed)
    return build_result(parts, {"surface": 0.5})


def strict(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_result_keeps_the_contract():
    content = result()
    text = result_text(content)
    read = strict(text)
    assert read == content
    assert max(len(line) for line in text.splitlines()) > 1000, "arrays stand on one line"
    assert list(read)[:2] == ["schema", "case"]
    assert {"passed", "parameters", "elements", "printed", "surface", "equivalent", "residual"} <= set(read)
    assert set(read["parameters"][0]) >= {
        *("name", "unit", "true", "paper", "first_order", "refined", "relative_error", "tolerance", "passed")
    }
    assert np.sqrt(np.diag(read["covariance"])) == pytest.approx(
        [row["refined"]["standard_error"] for row in read["parameters"]], rel=1e-6
    )
    assert read["surface"] == {"points": 488, "settled": 488, "origin": "simulated", "seconds": 0.5}
    assert all(len(read["equivalent"][name]) == len(SURFACE) for name in read["equivalent"])
    assert [entry["level"] for entry in read["predicted"]] == [curve.level for curve in PREDICTION]
    for entry, curve in zip(read["predicted"], PREDICTION, strict=True):
        assert entry["lower"] < entry["amplitude"] < entry["upper"]
        assert [tuple(jump.values()) for jump in entry["jumps"]] == [
            (jump.frequency, list(jump.interval), jump.amplitude, jump.sweep, finite_or_none(jump.landing))
            for jump in curve.jumps
        ]
    element = read["elements"][0]
    assert parse(element["stiffness"]) == parse("k1 + 3/4*kn1*X**2")
    assert write(parse(element["force"])) == element["force"]
    assert [formula["agrees"] for formula in read["printed"]] == [True, True]
    weighed = replace(IDENTIFICATION, model=replace(IDENTIFICATION.model, mass=MASS, mass_error=0.01))
    assert result(identification=weighed)["mass_given"] == {"value": MASS, "standard_error": 0.01}
    assert "mass_given" not in content


LOST = Finding("not-determined", "warning", "c1")


def test_what_is_not_known_is_null():
    refined = (
        Estimate("c1", C1, float("inf"), (-float("inf"), float("inf")), "N*s/m", LOST),
        *IDENTIFICATION.refined[1:],
    )
    row = replace(COMPARISON.rows[0], true=float("nan"), refined=refined[0], relative_error=float("nan"))
    unknown = replace(COMPARISON, rows=(row, *COMPARISON.rows[1:]))
    read = strict(result_text(result(unknown)))["parameters"][0]
    assert read["true"] is None
    assert read["refined"] == {
        "value": C1, "standard_error": None, "interval": [None, None], "interval_by": "standard error",
        "remark": sentence(LOST), "finding": LOST.to_dict(),
    }  # fmt: skip


def identified(force: str, values: dict[str, float]) -> tuple[Model, Identification]:
    model = Model((make_element("law", force),), mass=MASS)
    refined = tuple(Estimate(name, value, 0.0, (value, value)) for name, value in sorted(values.items()))
    exact = {"covariance": np.zeros((0, 0)), "solution": np.zeros(0)}
    return model, replace(IDENTIFICATION, model=model, refined=refined, **exact)


@pytest.fixture
def results(tmp_path):
    for name, title in (("cubic", "A <b>cubic</b> spring"), ("odd #1", "{{7*7}}")):
        folder = tmp_path / name
        folder.mkdir()
        content = {**result(), "case": name, "title": title}
        (folder / "result.json").write_text(result_text(content), encoding="utf-8")
    faulty = {"broken": "{", "other": "[]", "future": '{"schema": 99}', "null": "null"}
    for name, text in faulty.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_index_lists_what_can_be_read(results):
    write_index(results)
    text = (results / "index.html").read_text(encoding="utf-8")
    outline = Outline(text)
    links = {str(link["href"]) for link in outline.all("a")}
    assert {"cubic/report.html", "odd%20%231/report.html"} <= links
    assert "A <b>cubic</b> spring" in "".join(outline.texts)
    assert "{{7*7}}" in "".join(outline.texts)
    names = [attributes["id"] for _, attributes in outline.elements if "id" in attributes]
    assert len(names) == len(set(names))
    assert [len(outline.all("svg")), len(outline.all("script"))] == [0, 0]
    assert [entry.folder.name for entry in read_results(results)] == ["cubic", "odd #1"]


def test_the_index_counts_findings_and_has_no_errors_without_a_truth(results):
    entries = read_results(results)
    for row in entries[0].rows:
        row["true"] = row["relative_error"] = None
    content = json.loads((results / "cubic" / "result.json").read_text())
    content["parameters"], content["forces"] = entries[0].result["parameters"], entries[0].result["forces"]
    findings = [Finding("note", one, names={"text": "text"}) for one in ("info", "info", "warning")]
    content["findings"] = [finding.to_dict() for finding in findings]
    (results / "cubic" / "result.json").write_text(result_text(content), encoding="utf-8")
    shutil.rmtree(results / "odd #1")
    write_index(results)
    text = (results / "index.html").read_text(encoding="utf-8")
    assert "; 1 warning and 2 notes" in text
    assert "Table 1: identified values" in text
    assert 'data-label="Error' not in text


@pytest.mark.slow
def test_the_equations_of_states_stand_in_page_and_result_and_a_loop_that_stays_open_is_said():
    joint = make_element("joint <b>", "k1*x + c1*v + z", {"z": "kn1*v - 20*abs(v)*z"})
    found = replace(
        IDENTIFICATION, model=Model([joint], mass=MASS), solution=np.array([C1, K1, 1e6]),
        refined=tuple(replace(e, value=1e6) if e.name == "kn1" else e for e in IDENTIFICATION.refined),
    )  # fmt: skip
    subject = Subject.of_result(found, "joint", "", "")
    parts = Parts(subject, SURFACE, found, rsgen.compare(found), PREDICTION)
    result = build_result(parts, {})
    (entry,) = result["elements"]
    assert make_element("joint", entry["force"], entry["memory"]).force == joint.force
    assert result["dissipation"]["identified"]["energy"][1] > 0
    text = render_page(page_context(parts, empty_drawings(), {}))
    assert "<dt>Memory <i>z</i>′</dt>" in text
    assert "joint &lt;b&gt;" in text
    assert "stiffness 1.01 MN/m" in described(joint, found)
    growing = make_element("joint", "k1*x + c1*v + z", {"z": "k1*v - kn1*abs(v)*z"})
    open_loop = replace(found, model=Model([growing], mass=MASS), solution=np.array([C1, K1, -1e6]))
    assert described(growing, open_loop) == "the loop of z does not close with the identified values"


@pytest.fixture(scope="module")
def found():
    return rsgen.identify(SURFACE, cubic_model())


def read_back(*places: Path) -> list[Any]:
    return [json.loads((place / "result.json").read_text()) for place in places]


@pytest.mark.slow
def test_a_report_needs_a_surface_and_a_result_only_and_shows_a_title_as_text(tmp_path, found):
    by_place, by_name = tmp_path / "new" / "joint", tmp_path / "named" / "joint"
    rsgen.write_report(by_place, SURFACE, found)
    rsgen.write_report(by_name, surface=SURFACE, identification=found, title="<b>Joint</b>", source="our lab")
    names = sorted(path.name for path in by_place.iterdir())
    assert names == ["kernel.py", "modal.csv", "report.html", "result.json", "surface.h5"]
    plain, named = read_back(by_place, by_name)
    assert named | {"title": plain["title"], "source": plain["source"]} == plain
    assert (plain["case"], plain["title"]) == ("joint", "n(x, v) = c1*v + k1*x + kn1*x**3")
    values = {row["name"]: row["refined"]["value"] for row in plain["parameters"]}
    assert values == {estimate.name: estimate.value for estimate in found}
    assert all(row["true"] is None for row in plain["parameters"])
    page = (by_place / "report.html").read_text()
    assert "Case file" not in page
    assert "notebook" not in page
    page = (by_name / "report.html").read_text()
    assert "<h1>&lt;b&gt;Joint&lt;/b&gt;</h1>" in page
    assert "our lab" in page


def free_frequency(rate: Callable[[float], float], amplitude: float) -> float:
    """Return the frequency [Hz] of x'' + rate(x) = 0 whose fundamental has an amplitude [m], integrated."""

    def swing(peak: float) -> tuple[float, float]:
        def at_rest(_: float, y: Sequence[float]) -> float:
            return y[0]

        at_rest.terminal = True  # type: ignore[attr-defined]
        quarter = solve_ivp(
            lambda _, y: [y[1], -rate(y[0])], [0, 10], [peak, 0.0], events=at_rest, dense_output=True,
            rtol=1e-10, atol=1e-15,
        )  # fmt: skip
        end = float(quarter.t_events[0][0])
        time = (np.arange(2000) + 0.5) * end / 2000
        return 2 * float(np.mean(quarter.sol(time)[0] * np.cos(np.pi / 2 / end * time))), 1 / (4 * end)

    peak = brentq(lambda peak: swing(peak)[0] - amplitude, 0.8 * amplitude, 1.2 * amplitude, xtol=1e-12)
    return swing(peak)[1]


def test_the_page_says_the_resonance_at_both_ends_of_the_amplitudes():
    text = page(empty_drawings()).replace("\u202f", " ").replace("\u00a0", " ")
    values, ends = IDENTIFICATION.values, IDENTIFICATION.amplitude_range
    k, kn = (values[name] / IDENTIFICATION.mass for name in ("k1", "kn1"))
    said = [f"{free_frequency(lambda x: k * x + kn * x**3, end):.4g} Hz" for end in ends]
    assert re.search(rf"resonance:</strong> {said[0]} at .*, {said[1]} at .*; damping ratio .* and ", text)


def quintic() -> tuple[rsgen.ResponseSurface, Identification]:
    """A test of the fundamental alone; one harmonic states its last resonance 1.4 % low."""
    law = {"k": 31000.0, "c": 7.0, "k5": 9e14, "cq": 55.0}
    plan = rsgen.SimulatedTest(level=[1, 3, 6, 10], frequency=np.arange(16.5, 27.1, 0.25), sweep="up")
    elements = ("k*x + k5*x**5", "c*v + cq*v*abs(v)")
    test = rsgen.simulate(rsgen.Oscillator(1.9, elements, law), plan)
    seen = rsgen.ResponseSurface(test.level, test.frequency, test.force, test.harmonics[:, 1])
    return seen, rsgen.identify(seen, elements, mass=1.9)


def test_what_is_stated_and_drawn_has_all_harmonics_as_the_points_have_them():
    _, found = quintic()
    (course,), largest = resonance_course(found), found.amplitude_range[1]
    frequency = free_frequency(lambda x: (31000 * x + 9e14 * x**5) / 1.9, largest)
    assert course["frequency_last"] == pytest.approx(frequency, rel=2e-4)
    spring, damper = (element_finding(element, found) for element in found.model.elements)
    assert spring["stiffness_last"] == pytest.approx(1.9 * (2 * np.pi * frequency) ** 2, rel=1e-3)
    damping = damper["damping_last"] / (4 * np.pi * 1.9 * frequency)
    assert damping == pytest.approx(course["ratio_last"], rel=0.01)
    assert "damping_last" not in spring.numbers
    drawing = rsgen.figures.draw_collapse(found)
    lines = {line.get_label(): line.get_xydata() for line in drawing.figure.axes[0].lines}
    at, height = np.array(lines["refined model, 95 % band"]).T
    place, stiffness = np.array(lines["levels at resonance"]).T
    assert stiffness == pytest.approx(np.interp(place, at, height), rel=0.005)
    # the printed formula with the refined values was not in the figure
    at, height = np.array(lines["describing function"]).T
    assert height == pytest.approx((found["k"].value + 5 / 8 * found["k5"].value * (at / 1e3) ** 4) / 1e3)
    assert drawing.caption.endswith(" The describing function, with the refined values, has no harmonics.")
    same = rsgen.figures.draw_collapse(IDENTIFICATION).figure.axes[0]
    assert "describing function, 95 % band" in same.get_legend_handles_labels()[1]


def test_what_fundamentals_do_not_show_is_one_note_for_all_values():
    _, found = quintic()
    (said,) = (finding for finding in found.findings if finding.code == "even-terms-not-seen")
    moved = {name.removeprefix("moved ") for name in said.numbers if name.startswith("moved ")}
    assert {said.parameter, *moved} == {"c", "cq", "k5"}
    assert all(f"{name} " in said.names["others"] for name in moved)
    assert f" ({said.names['others']}), one twice" in sentence(said)


def test_warnings_stand_before_notes_under_the_headline():
    notes = [Finding("note", "info", names={"text": f"note {i}"}) for i in range(4)]
    warned = Finding("points-excluded", "warning", numbers={"excluded": 3, "points": 9, "all": 9})
    text = page(empty_drawings(), changed(IDENTIFICATION, findings=(*notes, warned)))
    box = text.partition('<div class="note">')[2].partition("</div>")[0]
    assert re.findall(r"3 of 9 points|[Nn]ote \d", unicodedata.normalize("NFKC", box))[0] == "3 of 9 points"


@pytest.mark.parametrize(("law", "truth", "said"), [
    ("Piecewise((k6*x, x > 0), (k7*x, True)) + c*v", {"k6": 4e3, "k7": 8e3, "c": 4.0}, True),
    # values that differ by noise alone
    ("Piecewise((k6*x, x > 0), (k7*x, True)) + c*v", {"k6": 6e3, "k7": 6e3, "c": 4.0}, False),
])  # fmt: skip
def test_a_spring_that_is_not_symmetric_is_said_to_be(law, truth, said):
    plan = rsgen.SimulatedTest(level=[2, 10], frequency=np.linspace(8, 12, 25), noise_relative=0.003)
    found = rsgen.identify(rsgen.simulate(rsgen.Oscillator(1.5, law, truth), plan), law)
    assert ("not symmetric" in described(found.model.elements[0], found)) is said
    if said:
        largest = found.amplitude_range[1]
        text = f"{found['k6'].value * largest:.3g} N at {1e3 * largest:.2g} mm"
        assert text in described(found.model.elements[0], found).replace("\u202f", " ")


def test_both_errors_of_a_held_out_level_are_relative_to_one_size():
    (level,) = PREDICTION.held_out
    table = tables.held_out_table([level])
    assert "root mean square of the measured response" in table.caption
    of_mean = np.abs(level.predicted - level.measured) / np.sqrt(np.mean(np.abs(level.measured) ** 2))
    largest = dict(zip(table.columns, table.rows[0], strict=True))["Largest error"]
    assert largest.text == error_text(float(of_mean.max()))
    assert largest.note == f"at {level.frequency[np.argmax(of_mean)]:.5g}\u202fHz".replace("\u202f", " ")
    assert level.largest_error == pytest.approx(float(of_mean.max()))


def test_a_law_is_compared_with_the_modal_table_at_the_points_of_the_table():
    (level,) = PREDICTION.held_out
    within = np.abs(level.measured) < 0.7 * np.abs(level.measured).max()
    of_table = replace(level, predicted=np.where(within, level.predicted, np.nan))
    off = replace(level, predicted=level.predicted + 0.01 * np.abs(level.measured) * within)
    table = tables.held_out_table([of_table], "from the table", [off])
    said = dict(zip(table.columns, table.rows[0], strict=True))["Error of the law at the points predicted"]
    miss = np.linalg.norm((off.predicted - off.measured)[within])
    assert said == error_text(float(miss / np.linalg.norm(off.measured[within])))


def test_findings_of_a_prediction_stand_in_the_one_list(tmp_path, run_cli):
    path, out = tmp_path / "small.toml", tmp_path / "out"
    band = {"test.frequency.start": 9.6, "test.frequency.stop": 9.9}
    hard = {"truth.kn": 3e6, "truth.c": 3.8, "accept": GONE}
    path.write_text(changed_case(SMALL, CUBIC | band | hard))
    assert run_cli("run", path, "--out", out).code == 0
    result = json.loads((out / "small" / "result.json").read_text())
    (said,) = [
        text
        for text, finding in zip(result["warnings"], result["findings"], strict=True)
        if finding["code"] == "prediction-extrapolated"
    ]
    assert "did not reach the resonance" in said
    warnings = (out / "small" / "report.html").read_text().partition('id="warnings"')[2]
    shown = re.sub(r"\s", " ", unicodedata.normalize("NFKC", warnings))
    for text in (shown, run_cli("identify", path).out):
        assert "did not reach the resonance" in text


def test_one_resonance_is_stated_of_a_cubic_spring_with_dry_friction_by_law_and_table():
    law = rsgen.Oscillator(
        3.4, "k*x + k3*x**3 + c*v + Ff*sign(v)", {"k": 105e3, "k3": 6e9, "c": 14, "Ff": 1.2}
    )
    plan = rsgen.SimulatedTest(
        level=[4, 15, 40], frequency=np.arange(25, 47, 0.25), sweep="up", method="harmonic-balance"
    )
    test = rsgen.simulate(law, plan)
    found = rsgen.identify(test, ["k*x + k3*x**3", "c*v + Ff*sign(v)"], mass=3.4)
    modal = tables.tabulate_mode(test, found)
    assert modal.table is not None
    ends = resonance_at_ends(found, modal)
    (course,) = resonance_course(found, ends)
    # the law was stated to first order, 0.4 % low, and its damper at motions where friction is all but all
    assert course["frequency_last"] == pytest.approx(modal.table.frequency[-1], rel=5e-4)
    damper = element_finding(found.model.elements[1], found, ends)
    assert damper is not None
    assert damper["amplitude_first"] == modal.table.amplitude[0]
    assert damper["damping_first"] == pytest.approx(modal.table.damping[0], rel=0.01)


def test_the_resonance_is_stated_at_the_amplitudes_of_the_modal_table_and_marked_beyond_the_band():
    """It was stated at motions far off resonance, below those of the table, and beyond the band unmarked."""
    _, found = quintic()
    assert "beyond" not in resonance_course(found)[0].names
    table: Any = SimpleNamespace(amplitude=np.array([4e-4, 6e-4]))
    (course,) = resonance_course(found, resonance_at_ends(found, tables.Modal(table)))
    assert (course["amplitude_first"], course["amplitude_last"]) == (4e-4, 6e-4)
    (cut,) = resonance_course(replace(found, frequency_range=(16.5, 21.0)))
    assert cut.names["beyond"] == f"{cut['frequency_last']:.4g} Hz"
    assert f"(beyond the tested band: {cut['frequency_last']:.4g} Hz)" in sentence(cut)


@pytest.mark.parametrize(("name", "sure"), [("mat-sweep", True), ("csv-table", False)])
def test_samples_are_no_root_mean_squares(name: str, sure: bool):
    """What changes where both are rms was said of sampled sweeps, too, of which a case refuses "rms"."""
    case = rsgen.load_case(Path(__file__).parents[2] / "cases" / "formats" / f"{name}.toml")
    assert Subject("", "", "", (), case=case).scale_is_sure is sure
