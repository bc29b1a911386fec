"""Laws with memory and no spring: nothing determines the mean displacement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.cases import load_case
from rsgen.cases.case import law_faults
from rsgen.common.errors import RsgenError
from rsgen.dynamics.virtual_test import add_noise
from rsgen.law.numeric import compile_law

CASES = Path(__file__).parents[2] / "cases"
DAHL = rsgen.Law("c*v + z", memory={"z": "sigma*v*(1 - z*sign(v)/Fc)"})
VALUES = {"c": 3.8, "sigma": 5920.0, "Fc": 6.0}


def grid(method: str) -> rsgen.SimulatedTest:
    return rsgen.SimulatedTest(np.geomspace(0.5, 12, 4), np.linspace(6, 14, 7), method=method)


@pytest.mark.parametrize(
    ("law", "free"),
    [
        ("c*v + masing(Min(kt*x, Fs))", True),
        (DAHL, True),
        ("k*x + c*v + masing(Min(kt*x, Fs))", False),
        (rsgen.Law("k3*x**3 + z", memory=DAHL.memory), False),
        # a state that is a spring
        (rsgen.Law("z", memory={"z": "k*v + a*x - b*z"}), False),
        # without memory nothing is refused that was not before
        ("c*v + Ff*sign(v)", False),
    ],
)
def test_which_laws_leave_the_mean_free(law: rsgen.Law | str, free: bool) -> None:
    whole = law if isinstance(law, rsgen.Law) else rsgen.Law(law)
    assert compile_law(whole.force).mean_free is free


def test_a_simulation_in_time_is_refused_with_what_helps() -> None:
    with pytest.raises(RsgenError, match=r"no spring holds the mean displacement.*harmonic-balance"):
        rsgen.simulate(rsgen.Oscillator(1.5, DAHL, VALUES), grid("time"))


@pytest.mark.slow
def test_a_check_says_it_before_a_run(tmp_path: Path) -> None:
    text = (CASES / "jenkins.toml").read_text(encoding="utf-8")
    path = tmp_path / "loose.toml"
    path.write_text(text.replace('"k*x"', '"k*v"').replace("5.92 kN/m", "5.92 N*s/m"), encoding="utf-8")
    (fault,) = law_faults(load_case(path))
    assert "no spring holds the mean displacement" in fault


@pytest.mark.thorough
def test_loops_without_a_spring_are_identified_about_zero() -> None:
    """By the balance alone: the simulator would follow motions that drift for thousands of periods."""
    surface = rsgen.simulate(rsgen.Oscillator(1.5, DAHL, VALUES), grid("harmonic-balance"))
    assert np.all(surface.harmonics[:, 0] == 0)
    found = rsgen.identify(add_noise(surface, 0.003, 1), DAHL)
    assert found.verdict.state == "identified"
    for name, true in (VALUES | {"m": 1.5}).items():
        estimate = found[name]
        assert abs(estimate.value - true) < 4 * estimate.standard_error < 0.04 * true
