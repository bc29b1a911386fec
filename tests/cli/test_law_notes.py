"""What the commands say of laws that cannot mean what they say, before a run and after a simulation."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsgen.app.cli import main
from rsgen.cases import load_case

CASE = """\
schema = 1
name   = "small"
title  = "Small"

[system]
mass = "1.5 kg"

[[element]]
name  = "law"
force = "{force}"

[truth]
{truth}

[test]
kind = "simulated"
level = {{ values = [1, 2] }}
frequency = {{ start = 8, stop = 12, count = 3 }}
"""
MEASURED = """\
schema = 1
name   = "table"
title  = "A table"

[[element]]
name  = "law"
force = "k*x + c*v + z"

[test]
kind = "measured"
file = "table.csv"
[test.frequency]
column = "f"
[test.force]
amplitude = "F"
[test.response]
quantity = "displacement"
amplitude = "x"
phase = "phi"
phase_unit = "rad"
phase_sense = "lead"
"""


def call(*words: str | Path) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(word) for word in words])
    assert isinstance(caught.value.code, int)
    return caught.value.code


def written(folder: Path, force: str, truth: str) -> Path:
    path = folder / "small.toml"
    path.write_text(CASE.format(force=force, truth=truth), encoding="utf-8")
    return path


def test_a_simulation_refuses_values_that_make_no_law(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, "k*x + c*v + masing(Min(kt*x, Fs))", "k = 5000\nc = 4\nkt = 3000\nFs = -6")
    assert call("simulate", path, "--out", tmp_path / "s.h5") == 2
    assert "a virgin curve must be zero at x = 0" in capsys.readouterr().err
    assert not (tmp_path / "s.h5").exists()


@pytest.mark.slow
def test_a_simulation_without_a_settled_point_is_no_success(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # it settles where the cubic damper wins, 6 m away
    path = written(tmp_path, "k*x + c*v + c3*v**3", "k = 5000\nc = -40\nc3 = 1e-3")
    assert call("simulate", path, "--out", tmp_path / "s.h5") == 1
    assert "0 settled" in (said := capsys.readouterr().out)
    assert "check the values of [truth], their signs first" in said


def test_a_state_without_its_equation_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table.toml"
    path.write_text(MEASURED, encoding="utf-8")
    rows = "\n".join(f"{8 + i / 4:g},1,{1e-4 * (1 + i):g},{-0.1 * (1 + i):g}" for i in range(12))
    (tmp_path / "table.csv").write_text(f"f,F,x,phi\n{rows}\n", encoding="utf-8")
    assert call("check", path) == 0
    assert "note: z stands alone in the law" in capsys.readouterr().out
    assert call("derive", "k*x + z") == 0
    assert "its equation is missing" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_case_begins_with_a_law_with_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "joint.toml"
    equations = ("y = q*v - r*y*abs(v)", "z = a*v - b*abs(v)*z")
    options = [word for equation in equations for word in ("--memory", equation)]
    assert call("init", path, "--law", "k*x + c*v + y + z", *options) == 0
    case = load_case(path)
    assert case.model.elements[-1].memory == {"y": "q*v - r*y*abs(v)", "z": "a*v - b*z*abs(v)"}
    assert call("check", path) == 0
    assert "identifies m, a, b, c, k, q, r" in capsys.readouterr().out
    assert call("init", tmp_path / "no.toml", "--law", "k*x + c*v", "--memory", "z = a*v") == 2
    assert "z stands neither in the force" in capsys.readouterr().err
