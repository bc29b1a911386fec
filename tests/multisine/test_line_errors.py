"""Errors of a law that leaves distortion: blocks of the band left out, against refits without each block."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

import rsgen
from rsgen.data.oscillator import join_model
from rsgen.identification.lines.line_balance import Balance, SpectralLines, select_lines
from rsgen.identification.lines.line_fit import (
    LineFit,
    band_jackknife,
    band_parts,
    fit_lines,
    parameter_covariance,
    start_values,
)
from rsgen.law.numeric import ForceLaw, compile_law

MASS = 1.5
TRUE = {"k": 5000.0, "k3": 4e6, "c": 4.0, "c2": 1.0}
TOLERANCE = 0.02


@cache
def records(noise: float) -> rsgen.MultisineSpectra:
    """Eight periods at two levels of a law with drag, which the laws below do not have."""
    oscillator = rsgen.Oscillator(MASS, "k*x + k3*x**3 + c*v + c2*v*abs(v)", TRUE)
    test = rsgen.MultisineTest(
        np.array([1.0, 3.0]), (2.5, 20.0), 2.0, periods=8, noise_relative=noise, seed=1
    )
    return rsgen.simulate(oscillator, test)


def refitted(lines: SpectralLines, fit: LineFit, law: ForceLaw) -> np.ndarray:
    """Values and mass by scipy's least squares of the balance, with the weights of the whole."""
    base = fit.parameters
    weight = np.sqrt(2 / fit.variance)

    def residual(relative: np.ndarray) -> np.ndarray:
        values = base * relative
        balance = Balance.of(lines, law, values[:-1], values[-1], fit.noise)
        right = (balance.residual * weight)[lines.used]
        return np.concatenate([right.real, right.imag])

    return base * least_squares(residual, np.ones(len(base)), xtol=1e-12, ftol=1e-12).x


@pytest.mark.slow
@pytest.mark.parametrize(
    "formula", ["k*x + k3*x**3 + c*v", pytest.param("k*x + c*v + c3*v**3", marks=pytest.mark.thorough)]
)
@pytest.mark.parametrize("noise", [1e-3, pytest.param(5e-3, marks=pytest.mark.thorough)])
def test_leaving_out_a_block_is_a_refit_without_it(formula, noise):
    law = compile_law(join_model(formula, None, None).force)
    lines = select_lines(records(noise), rsgen.Observation(), switched=False)
    with np.errstate(all="ignore"):
        fit = fit_lines(lines, law, {}, *start_values(lines, law, {}))
        found = np.sqrt(np.diag(band_jackknife(fit)))
        groups = band_parts(lines)
        whole, moved = refitted(lines, fit, law), []
        for group in range(groups.max() + 1):
            used = np.array(lines.used)
            used[lines.used] = groups != group
            moved.append(refitted(replace(lines, used=used), fit, law) - whole)
        covariance, freedom, wider = parameter_covariance(fit)
    count = len(moved)
    # Cameron and Miller, J. Human Resources 50, 2015: the sum over G groups, times (G - 1)/G
    np.testing.assert_allclose(
        found, np.sqrt(np.sum(np.square(moved), axis=0) * (count - 1) / count), TOLERANCE
    )
    assert freedom == count - 1
    assert wider > 1
    assert np.all(np.sqrt(np.diag(covariance)) >= found * (1 - 1e-9))


def test_a_given_mass_that_a_multisine_contradicts_is_named():
    oscillator = rsgen.Oscillator(MASS, "k*x + k3*x**3 + c*v", {"k": 6000.0, "k3": 4e6, "c": 4.0})
    test = rsgen.MultisineTest(np.array([3.0, 8.0]), (2.5, 20.0), 2.0, periods=8, noise_relative=0.01)
    spectra = rsgen.simulate(oscillator, test)
    found = rsgen.identify(spectra, "k*x + k3*x**3 + c*v", mass=1.03 * MASS)
    (said,) = (finding for finding in found.verdict.decided_by if finding.code == "fixed-contradicted")
    assert said["fitted"] == pytest.approx(MASS, rel=0.005)
    assert rsgen.identify(spectra, "k*x + k3*x**3 + c*v", mass=MASS).verdict.state == "identified"
