"""`rsgen laws`: the list, one law, its picture."""

import json
from collections.abc import Callable

from rsgen.law import laws
from tests.conftest import Answer

Run = Callable[..., Answer]


def test_list_has_every_law_with_its_formula(run_cli):
    lines = run_cli("laws").out.splitlines()
    assert [line.split(maxsplit=1) for line in lines[: len(laws)]] == [[law.name, law.text] for law in laws]
    assert [entry["name"] for entry in json.loads(run_cli("laws", "--json").out)] == [
        law.name for law in laws
    ]


def test_one_law_shows_parameters_describing_function_and_source(run_cli):
    text = run_cli("laws", "coulomb").out
    for said in ("Ff: friction force [N]", "c(X, omega) = 4 Ff/(pi omega X)", "Eqs. (17), (18)"):
        assert said in text
    assert "own derivation" in run_cli("laws", "stribeck").out


def test_one_law_as_json(run_cli):
    found = json.loads(run_cli("laws", "cubic-spring", "--json").out)
    assert found["parameters"][1] == {"name": "k3", "meaning": "cubic stiffness", "unit": "N/m^3"}
    assert found["describing"]["stiffness"] == "k + 3/4*k3*X**2"
    assert found["describing"]["closed_form"] is True
