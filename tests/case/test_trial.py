"""Laws with memory tried before a run: what their values do to virgin curves and loops."""

import tomllib
from pathlib import Path

import pytest

from rsgen.cases.case import law_faults
from rsgen.cases.loading import load_case
from tests.case_files import law, write_small

LUGRE = "v - s*abs(v)*z/(Fc + (Fs - Fc)*exp(-(v/vs)**2))"


def faults(folder: Path, force: str, memory: str, truth: str) -> list[str]:
    changes = law("k*x + c*v", force, k=6000, c=4) | {"test.frequency": {"values": [8, 12]}}
    changes |= {f"truth.{key}": value for key, value in tomllib.loads(truth.replace(", ", "\n")).items()}
    if memory:
        changes["element.2.memory"] = {"z": memory}
    return law_faults(load_case(write_small(folder, "joint", changes)))


@pytest.mark.slow
@pytest.mark.parametrize(("force", "memory", "truth"), [
    ("z", "a*v - b*abs(v)*z", "a = 2000, b = 100"), ("z", "a*v", "a = 2000"),
    ("z", "a*v - b*z", 'a = 2000, b = "1e-3 1/s"'), ("masing(Min(kt*x, Fs))", "", "kt = 2000, Fs = 3"),
    ("s*z", LUGRE, "s = 10000, Fc = 1, Fs = 1.5, vs = 0.01"),
])  # fmt: skip
def test_a_loop_that_closes_is_no_fault(tmp_path, force, memory, truth):
    assert faults(tmp_path, force, memory, truth) == []


@pytest.mark.parametrize(("force", "memory", "truth", "expected"), [
    ("z", "a*v + b*z", "a = 2000, b = 1", "element.2.memory.z: the loop does not close"),
    ("z", "a*v - b*z", "a = 2000, b = -1", "element.2.memory.z: the loop does not close"),
    ("z", "a*abs(v)", "a = 2000", "element.2.memory.z: the loop does not close"),
    ("masing(Min(kt*x, Fs))", "", "kt = -2000, Fs = 3", "element.2.force: masing(Min(Fs, kt*x)) is -2e-09 N"),
    ("masing(Min(kt*x, Fs))", "", "kt = 2000, Fs = -3", "a virgin curve must be zero at x = 0"),
])  # fmt: skip
def test_an_open_loop_and_a_wrong_virgin_curve_are_one_sentence(tmp_path, force, memory, truth, expected):
    (fault,) = faults(tmp_path, force, memory, truth)
    assert fault.startswith(f"{tmp_path / 'joint.toml'}: element.2.")
    assert expected in fault
