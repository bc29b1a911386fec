"""What `run` refuses, `check` refuses before it, for the same reason."""

import json

import pytest

from rsgen.app.study import run_case
from tests.case_files import law, write_small

LINEAR = {**law("k*x", "c*v", k=5920.0, c=3.8), "test.level.values": [1, 3], "test.frequency.count": 15}
SPRING, DAMPER = "element.1.force", "element.2.force"


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "reason"), [
    ({"identify.band": ["20 Hz", "30 Hz"]}, "0 of 30 points can be used"),
    ({"identify.band": ["8 Hz", "8.05 Hz"]}, "2 of 30 points can be used"),
    ({"identify.hold_out": [2]}, "hold_out"),
    ({"test.level.values": [1], "test.frequency.count": 3}, "3 of 3 points can be used"),
    ({"test.control": "phase", "test.sweep": "up"}, "finds its frequency"),
    ({DAMPER: "-c*v"}, "no damping"), ({DAMPER: "c*x"}, "no damping"),
    ({DAMPER: "c*v*x**2 - 2*c*v*x**2"}, "no damping"), ({SPRING: "-k*x"}, "negative stiffness"),
    ({DAMPER: "c*v + 2*sign(v)", "test.level.values": [0.5, 1]}, "dry friction of 2 N"),
    *(
        ({SPRING: law}, f"element.1.force: ... {reason}")
        for law, reason in (
            ("k*gamma(x)", "gamma has no place in a force law"),
            ("k*besselj(0, x)", "besselj has no place in a force law"),
            ("k*log(x)", "k*log(x) is infinite at rest"), ("k*log(abs(x))", "is infinite at rest"),
            ("k/x", "k/x is infinite at rest"), ("k*v**(-1)", "is infinite at rest"),
            ("k*sqrt(x - 1)", "is not a number at x = 1e-12 m"),
            ("k*x**(-3)", "so singular at zero that the force has no fundamental"),
        )
    ),
    # what may settle is not refused
    ({}, ""),
    ({"test.method": "harmonic-balance", DAMPER: "-c*v"}, ""),
    ({DAMPER: "c*v*Max(abs(x) - 0.5, 0)"}, ""),  # damps large amplitudes only
    ({SPRING: "-k*x + 1e6*x**3"}, ""),  # two wells
    ({DAMPER: "c*v + 2*sign(v)"}, ""),  # holds the lower level only
    ({DAMPER: "1e-6*c*v"}, ""),
    *(({SPRING: law}, "") for law in ("k*x*log(1 + abs(x))", "k*tan(x)", "k*x*abs(x)**0.5")),
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


def test_a_doubt_is_no_note(tmp_path, run_cli):
    size = {"test.control": "response", "test.level.values": ["10 m", "30 m"]}
    path = write_small(tmp_path, "huge", LINEAR | size)
    _, *said = run_cli("check", path).out.splitlines()
    assert [line.split(":")[0] for line in said] == ["  doubt"]
    (warning,) = json.loads(run_cli("check", path, "--json").out)["cases"][0]["warnings"]
    assert said == [f"  doubt: {warning}"]


def test_other_commands_refuse_the_law_that_check_refuses(tmp_path, run_cli):
    # z moves on from cycle to cycle
    path = write_small(
        tmp_path,
        "bad",
        LINEAR | {"element.1.force": "k*x + z", "element.1.memory": {"z": "a*x**2"}, "truth.a": 1.0},
    )
    for command in ("check", "identify", "rank", "modal"):
        refused = run_cli(command, path)
        assert (refused.code, refused.out) == (2, "")
        assert refused.err.startswith(f"{path}: element.1.memory.z: the loop does not close")


def test_commands_refuse_a_free_power_of_a_state_with_the_law_to_write(tmp_path, run_cli):
    state = {"z": "a*v - b*abs(v)*z*abs(z)**(n - 1)"}
    truth = {"truth.a": 4000.0, "truth.b": 800.0, "truth.n": 1.0}
    changes = LINEAR | {"element.1.force": "k*x + z", "element.1.memory": state} | truth
    path = write_small(tmp_path, "loop", changes)
    for command in ("check", "identify", "rank"):
        refused = run_cli(command, path)
        assert (refused.code, refused.out) == (2, "")
        assert "z: a force to a power that is to be identified; write it as a share of one" in refused.err
    held = run_cli("check", write_small(tmp_path, "held", changes | {"identify.fixed": {"n": 1.0}}))
    assert held.code == 0
