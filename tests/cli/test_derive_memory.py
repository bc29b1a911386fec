"""`rsgen derive` with laws that remember: their states in text, JSON and pictures; one sentence a fault."""

import json

import pytest

from rsgen.formula import parse

BOUC_WEN = ("k*x + z", "--memory", "z' = alpha*v - bg*abs(v)*z - bd*v*abs(z)")


@pytest.mark.slow
def test_equations_of_states_are_shown(run_cli):
    said = run_cli("derive", *BOUC_WEN)
    assert said.code == 0
    assert "n(x, v, z)  = k x + z" in said.out
    assert "memory     z'          = alpha v - bd v |z| - bg z |v|" in said.out
    assert "energy     D(X)        = integral_0^2pi X cos(phi) z(phi) dphi" in said.out


def test_states_in_json(run_cli):
    found = json.loads(run_cli("derive", *BOUC_WEN, "--json").out)
    assert parse(found["memory"]["z"]) == parse("alpha*v - bg*abs(v)*z - bd*v*abs(z)")
    assert found["quadrature"] == "z"
    assert found["closed_part"]["stiffness"] == "k"
    two = json.loads(run_cli("derive", "z + w", "--memory", "z=v-z", "--memory", "w=z-w", "--json").out)
    assert sorted(two["memory"]) == ["w", "z"]
