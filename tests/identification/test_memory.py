"""Laws with memory identified from time stepping that knows nothing of loops, kernels or balances."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from rsgen.identification import Identification, identify
from rsgen.law.element import make_element
from rsgen.law.library import laws
from rsgen.oscillator import Model
from rsgen.surface import ResponseSurface
from tests.stepping import DAMPING, MASS, SPRING, stepped


def _errors(found: Identification, truth: dict[str, float]) -> list[float]:
    assert {e.name for e in found.refined} == set(truth)
    return [abs(e.value / truth[e.name] - 1) for e in found.refined]


@pytest.mark.slow
def test_bouc_wen_is_identified() -> None:
    """From first guess to interval; a hundredth of the stiffness moves with the level."""
    alpha, bg, bd = 2e4, 800.0, -500.0
    surface = stepped(
        lambda v, z: alpha * v - bg * np.abs(v) * z - bd * v * np.abs(z),
        np.inf, (20.0, 60.0, 180.0), (25.0, 31.0),
    )  # fmt: skip
    memory = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
    found = identify(surface, Model((make_element("law", "k*x + c*v + z", memory),)))
    truth = {"alpha": alpha, "bg": bg, "bd": bd, "c": DAMPING, "k": SPRING, "m": MASS}
    assert max(_errors(found, truth)) < 1e-3
    assert found.residual < 1e-5


@pytest.mark.slow
def test_a_jenkins_element_is_identified() -> None:
    """A slider that sticks at the lowest level and slips at the others."""
    kt, Fs = 1e4, 8.0
    surface = stepped(lambda v, z: kt * v, Fs, (15.0, 60.0, 180.0), (25.0, 29.0))
    found = identify(surface, Model((make_element("law", "k*x + c*v + masing(Min(kt*x, Fs))"),)))
    truth = {"Fs": Fs, "c": DAMPING, "k": SPRING, "kt": kt, "m": MASS}
    assert max(_errors(found, truth)) < 5e-3
    assert found.residual < 1e-3


@pytest.mark.slow
def test_a_law_that_runs_away_beyond_the_test_is_not_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dahl's friction far below its limit has no softening in X, as every Iwan joint has."""
    size, omega = (p.ravel() for p in np.meshgrid(np.geomspace(1e-4, 3e-3, 6), np.linspace(63, 94, 7)))
    energy = 4 / 3 * 3000.0**2 / 60.0 * size**3
    ratio = 8920.0 - 1.5 * omega**2 + 1j * (3.8 * omega + energy / (np.pi * size**2))
    surface = ResponseSurface(
        level=size,
        frequency=omega / (2 * np.pi),
        force=ratio * size,
        response=np.stack([np.zeros(len(size)), size], axis=1).astype(complex),
    )

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("its motions would be followed for thousands of periods")

    monkeypatch.setattr(import_module("rsgen.identification.identify"), "fit_simulator", fail)
    law = (make_element("base", "k*x + c*v"), laws["iwan4"].element())
    found = identify(surface, Model(law))
    assert found.verdict.state in ("doubtful", "rejected")
    assert "law-does-not-fit" in {finding.code for finding in found.findings}
