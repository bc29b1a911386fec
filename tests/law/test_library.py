"""`rsgen laws`: the list, one law, its picture."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from rsgen.describing import derive
from rsgen.law import Law, laws
from rsgen.report.figures.equivalent import draw_derivation
from tests.conftest import Answer

Run = Callable[..., Answer]


def test_list_has_every_law_with_its_formula(run_cli: Run) -> None:
    lines = run_cli("laws").out.splitlines()
    assert [line.split(maxsplit=1) for line in lines[: len(laws)]] == [[law.name, law.text] for law in laws]
    assert [entry["name"] for entry in json.loads(run_cli("laws", "--json").out)] == [
        law.name for law in laws
    ]


def test_one_law_shows_parameters_describing_function_and_source(run_cli: Run) -> None:
    text = run_cli("laws", "coulomb").out
    for said in ("Ff: friction force [N]", "c(X, omega) = 4 Ff/(pi omega X)", "Eqs. (17), (18)"):
        assert said in text
    assert "own derivation" in run_cli("laws", "stribeck").out


def test_one_law_as_json(run_cli: Run) -> None:
    found = json.loads(run_cli("laws", "cubic-spring", "--json").out)
    assert found["parameters"][1] == {"name": "k3", "meaning": "cubic stiffness", "unit": "N/m^3"}
    assert found["describing"]["stiffness"] == "k + 3/4*k3*X**2"
    assert found["describing"]["closed_form"] is True


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    [
        pytest.param(law, marks=[pytest.mark.thorough] if number % 6 else [])
        for number, law in enumerate(laws)
    ],
    ids=lambda law: law.name,
)
def test_every_law_has_a_picture(law: Law) -> None:
    drawing = draw_derivation(derive(law), law.example)
    assert "not known" not in drawing.alternative or law.name == "quadratic-spring"
    drawing.figure.clear()
