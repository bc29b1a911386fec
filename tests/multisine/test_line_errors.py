"""Errors of a law that leaves distortion: blocks of the band left out, against refits without each block."""

import numpy as np
import pytest

import rsgen

MASS = 1.5


def test_a_given_mass_that_a_multisine_contradicts_is_named():
    oscillator = rsgen.Oscillator(MASS, "k*x + k3*x**3 + c*v", {"k": 6000.0, "k3": 4e6, "c": 4.0})
    test = rsgen.MultisineTest(np.array([3.0, 8.0]), (2.5, 20.0), 2.0, periods=8, noise_relative=0.01)
    spectra = rsgen.simulate(oscillator, test)
    found = rsgen.identify(spectra, "k*x + k3*x**3 + c*v", mass=1.03 * MASS)
    (said,) = (finding for finding in found.verdict.decided_by if finding.code == "fixed-contradicted")
    assert said["fitted"] == pytest.approx(MASS, rel=0.005)
    assert rsgen.identify(spectra, "k*x + k3*x**3 + c*v", mass=MASS).verdict.state == "identified"
