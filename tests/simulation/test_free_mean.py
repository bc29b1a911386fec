"""Laws with memory and no spring: nothing determines the mean displacement."""

from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.common.errors import RsgenError
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
def test_which_laws_leave_the_mean_free(law, free):
    whole = law if isinstance(law, rsgen.Law) else rsgen.Law(law)
    assert compile_law(whole.force).mean_free is free


def test_a_simulation_in_time_is_refused_with_what_helps():
    with pytest.raises(RsgenError, match=r"no spring holds the mean displacement.*harmonic-balance"):
        rsgen.simulate(rsgen.Oscillator(1.5, DAHL, VALUES), grid("time"))
