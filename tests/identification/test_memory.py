"""Laws with memory identified from time stepping that knows nothing of loops, kernels or balances."""

import numpy as np
import pytest

from rsgen.data.oscillator import Model
from rsgen.identification.identify import identify
from rsgen.law.element import make_element
from tests.oracles.memory import DAMPING, MASS, SPRING, sliding
from tests.surfaces import errors

BOUC_WEN = {"alpha": 2e4, "bg": 800.0, "bd": -500.0, "c": DAMPING, "k": SPRING, "m": MASS}


@pytest.fixture(scope="module")
def hysteretic():
    alpha, bg, bd = (BOUC_WEN[name] for name in ("alpha", "bg", "bd"))
    return sliding(
        lambda v, z: alpha * v - bg * np.abs(v) * z - bd * v * np.abs(z),
        np.inf, (20.0, 60.0, 180.0), (25.0, 31.0),
    )  # fmt: skip


@pytest.mark.slow
def test_bouc_wen_is_identified(hysteretic):
    """From first guess to interval; a hundredth of the stiffness moves with the level."""
    memory = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
    found = identify(hysteretic, Model((make_element("law", "k*x + c*v + z", memory),)))
    assert max(errors(found, BOUC_WEN).values()) < 1e-3
    assert found.residual / np.sqrt(2) < 1e-5


@pytest.mark.slow
def test_a_jenkins_element_is_identified():
    """A slider that sticks at the lowest level and slips at the others."""
    kt, Fs = 1e4, 8.0
    surface = sliding(lambda v, z: kt * v, Fs, (15.0, 60.0, 180.0), (25.0, 29.0))
    found = identify(surface, Model((make_element("law", "k*x + c*v + masing(Min(kt*x, Fs))"),)))
    truth = {"Fs": Fs, "c": DAMPING, "k": SPRING, "kt": kt, "m": MASS}
    assert max(errors(found, truth).values()) < 5e-3
    assert found.residual < 1e-3
