"""`rsgen derive` with laws that remember: their states in text, JSON and pictures; one sentence a fault."""

import pytest

BOUC_WEN = ("k*x + z", "--memory", "z' = alpha*v - bg*abs(v)*z - bd*v*abs(z)")


@pytest.mark.slow
def test_equations_of_states_are_shown(run_cli):
    said = run_cli("derive", *BOUC_WEN)
    assert said.code == 0
    assert "n(x, v, z)  = k x + z" in said.out
    assert "memory     z'          = alpha v - bd v |z| - bg z |v|" in said.out
    assert "energy     D(X)        = integral_0^2pi X cos(phi) z(phi) dphi" in said.out
