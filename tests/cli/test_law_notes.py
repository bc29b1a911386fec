"""What the commands say of a law before any test, and of the equations of its states."""

import pytest

from rsgen.cases import load_case
from tests.case_files import law, write_small

pytestmark = pytest.mark.slow


def test_a_simulation_without_a_settled_point_is_no_success(tmp_path, run_cli):
    # it settles where the cubic damper wins, 6 m away
    changes = law("k*x + c*v + c3*v**3", k=5000, c=-40, c3=1e-3) | {"test.frequency.count": 3}
    simulated = run_cli("simulate", write_small(tmp_path, changes=changes), "--out", tmp_path / "s.h5")
    assert simulated.code == 1
    assert "0 settled" in simulated.out
    assert "check the values of [truth], their signs first" in simulated.out


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


BOUC_WEN = ("k*x + z", "--memory", "z' = alpha*v - bg*abs(v)*z - bd*v*abs(z)")


def test_equations_of_states_are_shown(run_cli):
    said = run_cli("derive", *BOUC_WEN)
    assert said.code == 0
    assert "n(x, v, z)  = k x + z" in said.out
    assert "memory     z'          = alpha v - bd v |z| - bg z |v|" in said.out
    assert "energy     D(X)        = integral_0^2pi X cos(phi) z(phi) dphi" in said.out
