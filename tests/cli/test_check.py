"""What `run` refuses, `check` refuses before it; what commands say of a law, and tables without a law."""

import csv
import json
from pathlib import Path

import pytest

import rsgen
from rsgen.app.study.run_case import run_case
from rsgen.cases.loading import load_case
from tests.case_files import law, write_small

LINEAR = {**law("k*x", "c*v", k=5920.0, c=3.8), "test.level.values": [1, 3], "test.frequency.count": 15}
SPRING, DAMPER = "element.1.force", "element.2.force"


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "reason"), [
    ({"identify.band": ["20 Hz", "30 Hz"]}, "0 of 30 points can be used"),
    ({"identify.hold_out": [2]}, "hold_out"),
    ({"test.level.values": [1], "test.frequency.count": 3}, "3 of 3 points can be used"),
    ({SPRING: "k*besselj(0, x)"}, "element.1.force: ... besselj has no place in a force law"),
    ({SPRING: "k*x**(-3)"}, "element.1.force: ... so singular at zero that the force has no fundamental"),
    # what does not settle is seen as it is simulated
    ({DAMPER: "-c*v"}, ""), ({SPRING: "-k*x + 1e6*x**3"}, ""),
    ({SPRING: "k*x*log(1 + abs(x))"}, ""), ({SPRING: "k*x*abs(x)**0.5"}, ""),
])  # fmt: skip
def test_a_virtual_test_that_cannot_be_used_is_refused_before_it_is_run(tmp_path, run_cli, changes, reason):
    path = write_small(tmp_path, "bad", LINEAR | changes)
    checked = run_cli("check", path)
    assert checked.code == (2 if reason else 0)
    if reason:
        assert (checked.out, checked.err.count("\n")) == ("", 1)
        assert checked.err.startswith(f"{path}: ")
        ran = run_case(path, tmp_path / "out")
        assert ran.passed is None
        for part in reason.split(" ... "):
            assert part in checked.err
            assert part in " ".join(ran.faults)


def test_check_says_that_a_mass_has_another_unit_than_force_and_response(tmp_path, run_cli):
    path, table = tmp_path / "mass.toml", Path("cases/formats/table.csv").read_text()
    (tmp_path / "table.csv").write_text(table)
    text = Path("cases/formats/csv-table.toml").read_text(encoding="utf-8")
    for mass, said in (("1500 kg", True), ("1.5 kg", False)):
        path.write_text(text.replace("[[element]]", f'[system]\nmass = "{mass}"\n\n[[element]]', 1))
        assert ("doubt: with m = 1.5 kg in place of the given 1500 kg" in run_cli("check", path).out) == said
    # a unit that stands nowhere is a doubt
    (tmp_path / "table.csv").write_text(table.replace("acceleration_peak_g", "a"))
    path.write_text(path.read_text().replace('unit        = "g"\n', "").replace("acceleration_peak_g", "a"))
    said = run_cli("check", path).out
    assert "  doubt: no unit was found in the case or the file for a, read in m/s^2: all" in said
    assert "12.5 Hz, read as sweep up (rows ascend)" in said


def test_a_doubt_is_no_note(tmp_path, run_cli):
    size = {"test.control": "response", "test.level.values": ["10 m", "30 m"]}
    path = write_small(tmp_path, "huge", LINEAR | size)
    _, *said = run_cli("check", path).out.splitlines()
    assert [line.split(":")[0] for line in said] == ["  doubt"]
    (warning,) = json.loads(run_cli("check", path, "--json").out)["cases"][0]["warnings"]
    assert said == [f"  doubt: {warning}"]


@pytest.mark.parametrize(("state", "truth", "said"), [
    # z moves on from cycle to cycle
    ("a*x**2", {"a": 1.0}, "element.1.force: memory: the loop of z does not close"),
    (
        "a*v - b*abs(v)*z*abs(z)**(n - 1)", {"a": 4000.0, "b": 800.0, "n": 1.0},
        "z: a force to a power that is to be identified; write it as a share of one",
    ),
])  # fmt: skip
def test_other_commands_refuse_the_law_that_check_refuses(tmp_path, run_cli, state, truth, said):
    changes = LINEAR | {"element.1.force": "k*x + z", "element.1.memory": {"z": state}}
    changes |= {f"truth.{name}": value for name, value in truth.items()}
    path = write_small(tmp_path, "loop", changes)
    for command in ("check", "identify", "rank", *([] if "n" in truth else ["modal"])):
        refused = run_cli(command, path)
        assert (refused.code, refused.out, said in refused.err) == (2, "", True)
        assert "n" in truth or refused.err.startswith(f"{path}: ")
    if "n" in truth:
        fixed = changes | {"identify.fixed": {"n": 1.0}}
        assert run_cli("check", write_small(tmp_path, "held", fixed)).code == 0


@pytest.mark.slow
def test_a_case_begins_with_a_law_with_memory(tmp_path, run_cli):
    path = tmp_path / "joint.toml"
    equations = ("y = q*v - r*y*abs(v)", "z = a*v - b*abs(v)*z")
    options = [word for equation in equations for word in ("--memory", equation)]
    assert run_cli("init", path, "--law", "k*x + c*v + y + z", *options).code == 0
    case = load_case(path)
    assert case.model.elements[-1].memory == {"y": "q*v - r*y*abs(v)", "z": "a*v - b*z*abs(v)"}
    assert "identifies m, a, b, c, k, q, r" in run_cli("check", path).out
    refused = run_cli("init", tmp_path / "no.toml", "--law", "k*x + c*v", "--memory", "z = a*v")
    assert (refused.code, "z stands neither in the force" in refused.err) == (2, True)


@pytest.mark.slow
def test_equations_of_states_are_shown(run_cli):
    said = run_cli("derive", "k*x + z", "--memory", "z' = alpha*v - bg*abs(v)*z - bd*v*abs(z)")
    assert said.code == 0
    assert "n(x, v, z)  = k x + z" in said.out
    assert "memory     z'          = alpha v - bd v |z| - bg z |v|" in said.out
    assert "energy     D(X)        = integral_0^2pi X cos(phi) z(phi) dphi" in said.out


def test_the_table_is_printed_and_a_held_out_level_scored(tmp_path, run_cli):
    changes = law("k*x + k3*x**3 + c*v", k=5920, k3=3e5, c=3.8) | {"test.level.values": [1, 2, 4, 8]}
    changes |= {"test.frequency": {"start": 9.3, "stop": 10.9, "count": 17}, "identify.hold_out": [4]}
    case = write_small(tmp_path, changes=changes)
    answer = run_cli("modal", case)
    assert answer.code == 0
    lines = answer.out.splitlines()
    assert lines[0].startswith("Modal table without a law: ")
    assert "held out 4 N, rest: 17 of 17 points predicted, error" in answer.out
    assert "\nwarning: no point lies near resonance" in answer.out
    loaded = rsgen.load_case(case)
    table = rsgen.modal_table(rsgen.simulate(loaded.oscillator, loaded.test), loaded.model)
    rows = list(csv.DictReader(table.to_csv().splitlines()))
    assert float(rows[0]["damping [N*s/m]"]) == pytest.approx(3.8, rel=1e-3)
    assert [float(row["amplitude [m]"]) for row in rows] == pytest.approx(list(table.amplitude), rel=1e-9)
