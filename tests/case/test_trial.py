"""Laws with memory tried before a run: what their values do to virgin curves and loops."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsgen.cases import load_case
from rsgen.cases.case import law_faults

CASE = """\
schema = 1
name = "joint"
title = "A joint"
system = {{ mass = "1.5 kg" }}
element = [
    {{ name = "base", force = "k*x + c*v" }},
    {{ name = "joint", force = "{force}"{memory} }},
]
truth = {{ k = 6000, c = 4, {truth} }}
test = {{ kind = "simulated", level = {{ values = [1, 2] }}, frequency = {{ values = [8, 12] }} }}
"""
LUGRE = "v - s*abs(v)*z/(Fc + (Fs - Fc)*exp(-(v/vs)**2))"


def faults(folder: Path, force: str, memory: str, truth: str) -> list[str]:
    path = folder / "joint.toml"
    declared = f', memory = {{ z = "{memory}" }}' if memory else ""
    path.write_text(CASE.format(force=force, memory=declared, truth=truth), encoding="utf-8")
    return law_faults(load_case(path))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "memory", "truth"),
    [
        ("z", "a*v - b*abs(v)*z", "a = 2000, b = 100"),
        ("z", "a*v", "a = 2000"),
        ("z", "a*v - b*z", 'a = 2000, b = "1e-3 1/s"'),
        ("masing(Min(kt*x, Fs))", "", "kt = 2000, Fs = 3"),
        ("s*z", LUGRE, "s = 10000, Fc = 1, Fs = 1.5, vs = 0.01"),
    ],
)
def test_a_loop_that_closes_is_no_fault(tmp_path: Path, force: str, memory: str, truth: str) -> None:
    assert faults(tmp_path, force, memory, truth) == []


@pytest.mark.parametrize(
    ("force", "memory", "truth", "expected"),
    [
        ("z", "a*v + b*z", "a = 2000, b = 1", "element.2.memory.z: the loop does not close"),
        ("z", "a*v - b*z", "a = 2000, b = -1", "element.2.memory.z: the loop does not close"),
        ("z", "a*abs(v)", "a = 2000", "element.2.memory.z: the loop does not close"),
        (
            "masing(Min(kt*x, Fs))",
            "",
            "kt = -2000, Fs = 3",
            "element.2.force: masing(Min(Fs, kt*x)) is -2e-09 N",
        ),
        ("masing(Min(kt*x, Fs))", "", "kt = 2000, Fs = -3", "a virgin curve must be zero at x = 0"),
    ],
)
def test_a_loop_that_stays_open_and_a_wrong_virgin_curve_are_one_sentence(
    tmp_path: Path, force: str, memory: str, truth: str, expected: str
) -> None:
    (fault,) = faults(tmp_path, force, memory, truth)
    assert fault.startswith("joint.toml: element.2.")
    assert expected in fault
