"""`rsgen laws`: the list, one law, its picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rsgen.app.cli import main
from rsgen.describing import derive
from rsgen.law import Law, laws
from rsgen.report.figures.equivalent import draw_derivation


def call(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as caught:
        main(["laws", *(str(word) for word in words)])
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_list_has_every_law_with_its_formula(capsys: pytest.CaptureFixture[str]) -> None:
    assert call() == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(maxsplit=1) for line in lines[: len(laws)]] == [[law.name, law.text] for law in laws]
    assert call("--json") == 0
    assert [entry["name"] for entry in json.loads(capsys.readouterr().out)] == [law.name for law in laws]


def test_one_law_shows_parameters_describing_function_and_source(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("coulomb") == 0
    text = capsys.readouterr().out
    assert "Ff: friction force [N]" in text
    assert "c(X, omega) = 4 Ff/(pi omega X)" in text
    assert "Eqs. (17), (18)" in text
    assert call("stribeck") == 0
    assert "own derivation" in capsys.readouterr().out


def test_one_law_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("cubic-spring", "--json") == 0
    found = json.loads(capsys.readouterr().out)
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
