"""The report as a whole, its page, result.json and the index: text stays text, numbers stay numbers."""

import json
import re
import unicodedata
from collections import Counter
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import jinja2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import rsgen
from rsgen.common.finding import Finding
from rsgen.data.oscillator import Model
from rsgen.formula.printing import write
from rsgen.formula.reading import parse
from rsgen.identification.results import Estimate, Identification, changed
from rsgen.law.element import Element, make_element
from rsgen.report import draw_all
from rsgen.report import page as report_page
from rsgen.report import page_tables as tables
from rsgen.report.files import check_printed
from rsgen.report.page import page_context, render_page
from rsgen.report.provenance import Subject, page_environment, plain_text
from rsgen.report.result_json import Parts, build_result, result_text
from rsgen.report.sentences import error_text, sentence
from tests import samples
from tests.case_files import CUBIC, GONE, SMALL, corpus
from tests.case_files import changed as changed_case
from tests.samples import C1, K1, MASS, cubic_case, empty_drawings

SURFACE = samples.cubic_surface()
IDENTIFICATION = samples.cubic_identification(SURFACE)
PREDICTION = samples.cubic_prediction(SURFACE, held_out=(1.0,))
COMPARISON = samples.cubic_comparison(IDENTIFICATION)
HOSTILE_TITLES = [entry["input"] for entry in corpus("titles.json")]
MOST_BYTES = 2_000_000  # a mail still takes it


def parts_of(found: Identification = IDENTIFICATION, comparison: rsgen.Comparison = COMPARISON, **changes):
    subject = Subject.of_case(cubic_case(**changes), found)
    return Parts(subject, SURFACE, found, comparison, PREDICTION, check_printed(subject, found))


def page(found: Identification = IDENTIFICATION, drawings=None, **changes) -> str:
    drawings = empty_drawings() if drawings is None else drawings
    return render_page(page_context(parts_of(found, **changes), drawings, {"Versions": "rsgen"}))


@cache
def whole_page() -> str:
    subject = Subject.of_case(cubic_case(), IDENTIFICATION)
    return page(drawings=draw_all(subject, SURFACE, IDENTIFICATION, PREDICTION))


def described(element: Element, found: Identification) -> str:
    return report_page.describe_elements([element], found, report_page.resonance_at_ends(found))[element.name]


def course_of(found: Identification) -> list[Finding]:
    return report_page.resonance_course(found, report_page.resonance_at_ends(found))


class Outline(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.handle_data = self.texts.append  # type: ignore[method-assign]
        self.feed(text)
        self.close()
        self.ids = [attributes["id"] for _, attributes in self.elements if "id" in attributes]
        self.count = Counter(tag for tag, _ in self.elements)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.mark.slow
def test_page_needs_no_network_and_runs_nothing():
    text = whole_page()
    outline = Outline(text)
    assert len(text.encode()) < MOST_BYTES
    policy = outline.all("meta")[1]
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert str(policy["content"]).startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'")
    assert not {"script", "iframe", "object", "embed", "form", "base"} & set(outline.count)
    for tag, attributes in outline.elements:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:")), (tag, value)
    assert not re.search(r"@import|url\((?!#|data:)", text)


def test_page_can_be_found_through():
    outline = Outline(whole_page())
    counts = outline.count
    assert all(counts[landmark] == 1 for landmark in ("main", "header", "nav", "footer", "h1", "title"))
    assert len(outline.ids) == len(set(outline.ids))
    assert {str(link["href"]).removeprefix("#") for link in outline.all("a")} <= set(outline.ids)
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
    assert ("Higher harmonics matter in this test" in page(found)) is said


@pytest.mark.slow
@pytest.mark.parametrize("title", HOSTILE_TITLES, ids=lambda title: ascii(title[:24]))
def test_titles_are_text(title):
    tame = Outline(page())
    found = replace(IDENTIFICATION, findings=(rsgen.Finding.note(title),))
    text = page(found, title=title, source=title, text=title, name="cubic")
    text.encode("utf-8")
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202a-\u202e\u2066-\u2069]", text)
    outline = Outline(text)
    added = outline.count - tame.count
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


def strict(text: str):
    """Read JSON without NaN and infinity, which are none."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def test_result_keeps_the_contract():
    content = build_result(parts_of(), {"surface": 0.5})
    text = result_text(content)
    read = strict(text)
    assert read == content
    assert max(len(line) for line in text.splitlines()) > 1000, "arrays stand on one line"
    assert read["passed"] is COMPARISON.passed
    errors = [row["refined"]["standard_error"] for row in read["parameters"]]
    assert np.sqrt(np.diag(read["covariance"])) == pytest.approx(errors, rel=1e-6)
    assert [(one["name"], one["unit"]) for one in read["small_motion"]] == [
        ("natural-frequency", "Hz"), ("damping-ratio", ""),
    ]  # fmt: skip
    for one, stated in zip(read["small_motion"], IDENTIFICATION.small_motion, strict=True):
        assert (one["value"], one["interval"]) == (stated.value, [*stated.interval])
        assert str(stated.value)[:7] in str(IDENTIFICATION)
        assert f"{one['name'].replace('-', ' ')}, small motion" in page()
    assert read["surface"] == {"points": 488, "settled": 488, "origin": "simulated", "seconds": 0.5}
    assert all(len(read["equivalent"][name]) == len(SURFACE) for name in read["equivalent"])
    assert [entry["level"] for entry in read["predicted"]] == [curve.level for curve in PREDICTION]
    for entry, curve in zip(read["predicted"], PREDICTION, strict=True):
        assert entry["lower"] < entry["amplitude"] < entry["upper"]
        assert [jump["frequency"] for jump in entry["jumps"]] == [jump.frequency for jump in curve.jumps]
    element = read["elements"][0]
    assert parse(element["stiffness"]) == parse("k1 + 3/4*kn1*X**2")
    assert write(parse(element["force"])) == element["force"]
    assert [formula["agrees"] for formula in read["printed"]] == [True, True]
    weighed = replace(IDENTIFICATION, model=replace(IDENTIFICATION.model, mass=MASS, mass_error=0.01))
    assert build_result(parts_of(weighed), {})["mass_given"] == {"value": MASS, "standard_error": 0.01}
    assert "mass_given" not in content


def test_what_is_not_known_is_null():
    lost = rsgen.Finding("not-determined", "warning", "c1")
    refined = Estimate("c1", C1, np.inf, (-np.inf, np.inf), "N*s/m", lost)
    row = replace(COMPARISON.rows[0], true=np.nan, refined=refined, relative_error=np.nan)
    unknown = replace(COMPARISON, rows=(row, *COMPARISON.rows[1:]))
    read = strict(result_text(build_result(parts_of(comparison=unknown), {})))["parameters"][0]
    assert read["true"] is None
    assert read["refined"] == {
        "value": C1, "standard_error": None, "interval": [None, None], "interval_by": "standard error",
        "remark": sentence(lost), "finding": lost.to_dict(),
    }  # fmt: skip


@pytest.mark.slow
def test_the_equations_of_states_stand_in_page_and_result_and_a_loop_that_stays_open_is_said():
    joint = make_element("joint <b>", "k1*x + c1*v + z", {"z": "kn1*v - 20*abs(v)*z"})
    found = replace(
        IDENTIFICATION, model=Model([joint], mass=MASS), solution=np.array([C1, K1, 1e6]),
        refined=tuple(replace(e, value=1e6) if e.name == "kn1" else e for e in IDENTIFICATION.refined),
    )  # fmt: skip
    parts = Parts(Subject.of_result(found, "joint", "", ""), SURFACE, found, rsgen.compare(found), PREDICTION)
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


@pytest.mark.slow
def test_a_report_needs_a_surface_and_a_result_only_and_shows_a_title_as_text(tmp_path):
    found = rsgen.identify(SURFACE, samples.cubic_model())
    by_place, by_name = tmp_path / "new" / "joint", tmp_path / "named" / "joint"
    rsgen.write_report(by_place, SURFACE, found)
    rsgen.write_report(by_name, surface=SURFACE, identification=found, title="<b>Joint</b>", source="our lab")
    names = sorted(path.name for path in by_place.iterdir())
    assert names == ["kernel.py", "modal.csv", "report.html", "result.json", "surface.h5"]
    plain, named = (json.loads((place / "result.json").read_text()) for place in (by_place, by_name))
    assert named | {"title": plain["title"], "source": plain["source"]} == plain
    assert (plain["case"], plain["title"]) == ("joint", "n(x, v) = c1*v + k1*x + kn1*x**3")
    values = {row["name"]: row["refined"]["value"] for row in plain["parameters"]}
    assert values == {estimate.name: estimate.value for estimate in found}
    assert all(row["true"] is None for row in plain["parameters"])
    first, second = ((place / "report.html").read_text() for place in (by_place, by_name))
    assert not re.search("Case file|notebook", first)
    assert "<h1>&lt;b&gt;Joint&lt;/b&gt;</h1>" in second
    assert "our lab" in second


def free_frequency(rate, amplitude: float) -> float:
    """Return the frequency [Hz] of x'' + rate(x) = 0 whose fundamental has an amplitude [m], integrated."""

    def swing(peak: float) -> tuple[float, float]:
        def at_rest(_: float, y) -> float:
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
    text = page().replace("\u202f", " ").replace("\u00a0", " ")
    values, ends = IDENTIFICATION.values, IDENTIFICATION.amplitude_range
    k, kn = (values[name] / IDENTIFICATION.mass for name in ("k1", "kn1"))
    said = [f"{free_frequency(lambda x: k * x + kn * x**3, end):.4g} Hz" for end in ends]
    assert re.search(rf"resonance:</strong> {said[0]} at .*, {said[1]} at .*; damping ratio .* and ", text)


@cache
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
    (course,), largest = course_of(found), found.amplitude_range[1]
    frequency = free_frequency(lambda x: (31000 * x + 9e14 * x**5) / 1.9, largest)
    assert course["frequency_last"] == pytest.approx(frequency, rel=2e-4)
    ends = report_page.resonance_at_ends(found)
    spring, damper = (report_page.element_finding(element, found, ends) for element in found.model.elements)
    assert spring["stiffness_last"] == pytest.approx(1.9 * (2 * np.pi * frequency) ** 2, rel=1e-3)
    damping = damper["damping_last"] / (4 * np.pi * 1.9 * frequency)
    assert damping == pytest.approx(course["ratio_last"], rel=0.01)
    assert "damping_last" not in spring.numbers
    panel = rsgen.figures.draw_collapse(found).figure.axes[0]
    lines = {line.get_label(): line.get_xydata() for line in panel.lines}
    at, height = np.array(lines["refined model, 95 % band"]).T
    place, stiffness = np.array(lines["levels at resonance"]).T
    assert stiffness == pytest.approx(np.interp(place, at, height), rel=0.005)
    at, height = np.array(lines["describing function"]).T
    assert height == pytest.approx((found["k"].value + 5 / 8 * found["k5"].value * (at / 1e3) ** 4) / 1e3)


def test_warnings_stand_before_notes_under_the_headline():
    notes = [rsgen.Finding("note", "info", names={"text": f"note {i}"}) for i in range(4)]
    warned = rsgen.Finding("points-excluded", "warning", numbers={"excluded": 3, "points": 9, "all": 9})
    text = page(changed(IDENTIFICATION, findings=(*notes, warned)))
    box = text.partition('<div class="note">')[2].partition("</div>")[0]
    assert re.findall(r"3 of 9 points|[Nn]ote \d", unicodedata.normalize("NFKC", box))[0] == "3 of 9 points"


def test_both_errors_of_a_held_out_level_are_relative_to_one_size():
    (level,) = PREDICTION.held_out
    table = tables.held_out_table([level])
    assert "root mean square of the measured response" in table.caption
    of_mean = np.abs(level.predicted - level.measured) / np.sqrt(np.mean(np.abs(level.measured) ** 2))
    said = dict(zip(table.columns, table.rows[0], strict=True))
    assert said["Error, root mean square"].text == error_text(level.error)
    largest = said["Largest error"]
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
    codes = [finding["code"] for finding in result["findings"]]
    assert codes.count("prediction-extrapolated") == 1
    assert "did not reach the resonance" in result["warnings"][codes.index("prediction-extrapolated")]
    warnings = (out / "small" / "report.html").read_text().partition('id="warnings"')[2]
    shown = re.sub(r"\s", " ", unicodedata.normalize("NFKC", warnings))
    for text in (shown, run_cli("identify", path).out):
        assert "did not reach the resonance" in text


def test_the_resonance_is_stated_at_the_amplitudes_of_the_modal_table_and_marked_beyond_the_band():
    _, found = quintic()
    assert "beyond" not in course_of(found)[0].names
    table = SimpleNamespace(amplitude=np.array([4e-4, 6e-4]))
    (course,) = report_page.resonance_course(found, report_page.resonance_at_ends(found, tables.Modal(table)))
    assert (course["amplitude_first"], course["amplitude_last"]) == (4e-4, 6e-4)
    (cut,) = course_of(replace(found, frequency_range=(16.5, 21.0)))
    assert cut.names["beyond"] == f"{cut['frequency_last']:.4g} Hz"
    assert f"(beyond the tested band: {cut['frequency_last']:.4g} Hz)" in sentence(cut)


@pytest.mark.parametrize(("name", "sure"), [("mat-sweep", True), ("csv-table", False)])
def test_samples_are_no_root_mean_squares(name: str, sure: bool):
    case = rsgen.load_case(Path(__file__).parents[2] / "cases" / "formats" / f"{name}.toml")
    assert Subject("", "", "", (), case=case).scale_is_sure is sure
