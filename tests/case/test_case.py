"""Case files: what is right loads, what is wrong is named by path with its remedy, all at once."""

import functools
import json
import re
import time
import tomllib
from contextlib import suppress
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import rsgen
from rsgen import Law, make_element
from rsgen.cases.case import case_schema, law_faults
from rsgen.cases.loading import find_cases, load_case
from rsgen.cases.tables import path_fault
from rsgen.common.errors import CaseError, RsgenError
from rsgen.formula.names import check_name
from rsgen.formula.printing import write as write_formula
from tests.case.faults import FAULTS, SENTENCES
from tests.case_files import GONE, MEASURED, SMALL, changed, corpus, write_small
from tests.surfaces import codes

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "cases").glob("*.toml"), key=lambda path: path.stem)
FORMATS = sorted((ROOT / "cases" / "formats").glob("*.toml"), key=lambda path: path.stem)


def good(force: str = "k*x", truth: str = "k = 5920") -> str:
    element = [{"name": "spring", "force": force}]
    return changed(SMALL, {"element": element, "truth": GONE}) + f"[truth]\n{truth}\n"


def write(folder: Path, text: str, name: str = "case.toml") -> Path:
    path = folder / name
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return path


SAID = json.loads(SENTENCES.read_text(encoding="utf-8"))


def refused(path: Path) -> tuple[str, ...]:
    started = time.perf_counter()
    with pytest.raises(CaseError) as caught:
        load_case(path)
    # of the corpus: 2 s for a file; a case file is far smaller
    assert time.perf_counter() - started < 2.0
    for fault in caught.value.faults:
        assert fault.isprintable()
        assert len(fault) < 1000
    return caught.value.faults


def test_misprints_stay_as_printed():
    # Liu et al., Eqs. (20) and (22): wrong by a factor 2 in one term, and blind to the mean
    case = load_case(ROOT / "cases" / "piecewise.toml")
    values = {**case.truth, "X": 0.04}
    k4, k5, b, X = values["k4"], values["k5"], values["b"], values["X"]
    expected = k5 - (k5 - k4) / np.pi * (2 * np.arcsin(b / X) + b / X**2 * np.sqrt(X**2 - b**2))
    formula = case.printed["stiffness"]
    numbers = {symbol: values[symbol.name] for symbol in formula.free_symbols}
    assert float(formula.subs(numbers)) == pytest.approx(expected, rel=1e-12)
    bilinear = load_case(ROOT / "cases" / "bilinear.toml").printed["stiffness"]
    assert float(bilinear.subs({s: {"k6": 4000, "k7": 8000}[s.name] for s in bilinear.free_symbols})) == 6000


def test_published_schema_is_current():
    published = json.loads((ROOT / "cases" / "case.schema.json").read_text(encoding="utf-8"))
    assert published == case_schema(), "write it anew, with an indent of 2"
    for path in CASES:
        assert path.read_text(encoding="utf-8").startswith("#:schema case.schema.json\n")


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_fault_has_its_sentences_and_names_the_file_as_typed(fault, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("laboratory").mkdir()
    found = refused(fault.write(Path("laboratory")))
    typed = str(Path("laboratory", "faulty.toml"))
    assert [f"{typed}: {sentence}" for sentence in SAID[fault.name]] == list(found)


def test_every_sentence_has_a_place_and_what_is_known():
    assert all(SAID[fault.name] for fault in FAULTS)
    for sentence in (sentence for said in SAID.values() for sentence in said):
        # a line or a key; of two faults of the text the parser says no place
        assert re.match(r"line \d+|[a-z]+[\w.]*: |nested|a number", sentence), sentence
        assert not re.search(r"known: *($|;)", sentence), sentence
        # that of [identify] is like no key of [test]
        if "is not a key here" in sentence and not sentence.startswith("test.calibrated"):
            assert "did you mean" in sentence, sentence


def test_no_file_no_regular_file_too_large(tmp_path):
    assert "cannot be read" in refused(tmp_path / "absent.toml")[0]
    assert "no regular file" in refused(tmp_path)[0]
    assert "at most 262144" in refused(write(tmp_path, "#" * 300_000))[0]
    assert "in a line" in refused(write(tmp_path, "#" * 30_000))[0]


def test_byte_order_mark_and_windows_line_ends_are_read(tmp_path):
    assert load_case(write(tmp_path, "\ufeff" + good().replace("\n", "\r\n"))).name == "small"


def test_memory_is_declared_beside_the_force_or_comes_with_a_law(tmp_path, monkeypatch):
    formula = "a*v - b*abs(v)*z - d*v*abs(z)"
    library = Law("c*v + z", "joint-law", memory={"z": formula})
    monkeypatch.setattr("rsgen.cases.loading.laws", {"joint-law": library})
    elements = [
        {"name": "spring", "force": "k1*x + z", "memory": {"z": formula}},
        {"name": "joint", "law": "joint-law", "parameters": {"a": "a2", "z": "w"}},
    ]
    truth = dict.fromkeys(("k1", "a", "a2", "b", "c", "d"), 1)
    spring, joint = load_case(write_small(tmp_path, element=elements, truth=truth)).model.elements
    assert spring == make_element("spring", "k1*x + z", {"z": formula})
    assert joint == make_element("joint", "c*v + w", {"w": formula.replace("a*", "a2*").replace("z", "w")})
    for element in (spring, joint):
        assert make_element(element.name, write_formula(element.force), element.memory) == element


def test_folders_are_searched_for_cases(tmp_path):
    write(tmp_path, good(), "b.toml")
    write(tmp_path, good(), "a.toml")
    assert [path.name for path in find_cases([tmp_path])] == ["a.toml", "b.toml"]
    (tmp_path / "empty").mkdir()
    for name, said in (("empty", "has no case file"), ("none.toml", "does not exist")):
        with pytest.raises(CaseError, match=said):
            find_cases([tmp_path / name])


@pytest.mark.parametrize("entry", corpus("parameters.json"), ids=lambda e: e["id"])
def test_hostile_parameter_tables(tmp_path, entry):
    text = entry["input"]
    refused(write(tmp_path, text))
    # about keys of a case, not about names of parameters
    if entry["id"] in {"param-034", "param-035", "param-036", "param-045"}:
        return
    names = []
    for name in dict.fromkeys(re.findall(r"^\ufeff?\s*([A-Za-z]\w*)\s*=", text[:2000], re.MULTILINE)):
        with suppress(Exception):
            names.append(check_name(name))
    force = " + ".join(f"{name}*x" for name in names[:20]) or "k*x"
    path = write(tmp_path, good(force, text.removeprefix("\ufeff")))
    if entry["expected"].startswith("accept"):
        assert set(names) < set(load_case(path).truth or ())
    elif entry["id"] == "param-023":
        assert "lambda" in "".join(refused(path))
        rest = "\n".join(line for line in text.split("\n") if not line.startswith("lambda"))
        assert load_case(write(tmp_path, good("E*x + I*v", rest))).truth
    else:
        refused(path)


# entries that describe a situation on the disk; they are tests of output, measurement and study
_SITUATIONS = {f"path-{number:03d}" for number in (22, 23, 29, 31, 32, 33, 34, 35, 36)}


@pytest.mark.parametrize(
    "entry", [e for e in corpus("paths.json") if e["id"] not in _SITUATIONS], ids=lambda e: e["id"]
)
def test_hostile_paths(tmp_path, entry):
    text = entry.get("input", "")
    assert path_fault(text)
    faults = refused(write(tmp_path, good().replace('"small"', json.dumps(text))))
    assert "name: " in faults[0] or "TOML" in faults[0]


def test_a_surface_is_read_from_a_test_a_case_and_a_file(tmp_path):
    path = ROOT / "cases" / "formats" / "csv-table.toml"
    case = load_case(path)
    surface = rsgen.read(case.test)
    rsgen.save_surface(tmp_path / "surface.h5", surface)
    for source in (case, path, str(path), tmp_path / "surface.h5"):
        np.testing.assert_array_equal(rsgen.read(source).harmonics, surface.harmonics)
    with pytest.raises(RsgenError, match="simulate"):
        rsgen.read(ROOT / "cases" / "cubic.toml")


def test_a_test_that_was_read_has_the_mass_of_its_case(tmp_path):
    data, law = ROOT / "cases" / "formats", "k*x + kn*x**3 + c*v"
    plain = (data / "csv-table.toml").read_text(encoding="utf-8")

    def read(mass: str) -> rsgen.ResponseSurface:
        write(tmp_path, plain.replace("[[element]]", f"[system]\n{mass}\n[[element]]", 1))
        return rsgen.read(tmp_path / "case.toml", data)

    surface = read('mass = "1.5 kg"')
    found = rsgen.identify(surface, law)
    assert found.mass == found.model.mass == 1.5
    assert "mass-of-case" in codes(found)
    other = rsgen.identify(surface, law, mass=1.51)
    assert (other.mass, "mass-of-case" in codes(other)) == (1.51, False)
    assert rsgen.identify(rsgen.read(data / "csv-table.toml"), law).model.mass is None
    found = rsgen.identify(read('mass = "1.51 kg"\nmass_error = "10 g"'), law)
    assert found.model.weighed == load_case(tmp_path / "case.toml", data).model.weighed == (1.51, 0.01)
    assert found["m"].value != 1.51


_validator = functools.cache(lambda: jsonschema.validators.validator_for(case_schema())(case_schema()))


@pytest.mark.parametrize("path", [*CASES, *FORMATS], ids=lambda path: path.stem)
def test_the_schema_takes_what_is_loaded(path):
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    validator = _validator()
    validator.validate(document)
    document["test"]["titel"] = "?"
    assert not validator.is_valid(document)


CASE = {
    **MEASURED, "test.file": "d.csv", "test.frequency": {"column": 1}, "test.force": {"amplitude": 2},
    "test.response": {"quantity": "displacement", "real": 3, "imaginary": 4, "phase_sense": "lead"},
}  # fmt: skip


def test_without_a_scale_any_unit_will_do(tmp_path):
    changes = CASE | {"test.force.unit": "V"}
    with pytest.raises(CaseError, match=r"test\.force"):
        load_case(write_small(tmp_path, "case", changes))
    relative = load_case(write_small(tmp_path, "case", changes | {"identify": {"calibrated": False}}))
    assert relative.test.scale_of(relative.test.made["force"]) == 1.0
    assert not relative.model.observation.calibrated


def test_predictions_are_of_forces_where_levels_are_amplitudes_that_were_held(tmp_path):
    values = {"values": ["1 mm", "2 mm"]}
    changes = {"test.control": "response", "test.level": values, "identify": {"predict": ["5 N"]}}
    changes["identify"]["hold_out"] = ["2 mm"]
    seen = load_case(write_small(tmp_path, "case", changes)).model.observation
    assert (seen.hold_out, seen.predict) == ((2e-3,), (5.0,))
    changes["identify"]["predict"] = ["5 mm"]
    (fault,) = refused(write_small(tmp_path, "case", changes))
    assert "identify.predict.1: '5 mm' is a length" in fault


def test_data_folders(tmp_path, monkeypatch):
    monkeypatch.delenv("RSGEN_DATA", raising=False)
    elsewhere, case = tmp_path / "laboratory", write_small(tmp_path, "case", CASE)
    elsewhere.mkdir()
    assert load_case(case).test.file == tmp_path / "d.csv"
    monkeypatch.setenv("RSGEN_DATA", str(elsewhere))
    (tmp_path / "d.csv").write_text("")
    assert load_case(case).test.file == tmp_path / "d.csv"
    (elsewhere / "d.csv").write_text("")
    assert load_case(case).test.file == elsewhere / "d.csv"
    assert load_case(case, data=tmp_path).test.file == tmp_path / "d.csv"


@pytest.mark.parametrize("test", [
    {"kind": "simulated-decay", "level": {"values": ["20 mm", "40 mm"]}, "duration": "20 s"},
    {"kind": "simulated-sweep", "level": {"values": ["1 N"]}, "band": ["7 Hz", "13 Hz"], "duration": "60 s"},
])  # fmt: skip
def test_a_law_is_tried_before_a_virtual_record_in_time(tmp_path, test):
    case = load_case(write_small(tmp_path, test=test | {"rate": "400 Hz"}))
    assert case.test.in_time
    assert law_faults(case) == []
