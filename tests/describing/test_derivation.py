"""`rsgen derive`: what a person reads, and the picture."""

import numpy as np
import pytest
from scipy.special import j0, j1

from rsgen.describing.derivation import derive
from rsgen.formula.names import symbol
from rsgen.report.figures.equivalent import draw_derivation


def test_text_names_only_the_variables_that_occur(run_cli):
    text = run_cli("derive", "k*x + Ff*sign(v) + q*Max(0, x - b)").out
    assert "k(X, X0)    = { k + q " in text
    assert "c(X, omega) = 4 Ff/(pi omega X)" in text
    assert "X > |X0 - b|" in text
    assert "balance    0 " in text
    assert "agrees with an independent quadrature to" in text
    assert "*" not in text
    # what is not closed is an integral
    text = run_cli("derive", "k*x + F*tanh(x/a) + Ff*sign(v)").out
    assert "k + F/(pi X) integral_0^2pi sin(phi) tanh(X sin(phi)/a) dphi" in text
    assert "Integral" not in text


def test_drawing_shows_k_and_c_of_the_law():
    drawing = draw_derivation(derive("k*x + k3*x**3 + Ff*sign(v)"), {"k": 2.0, "k3": 4.0}, largest=1.0)
    force, stiffness, damping = drawing.figure.axes
    X, k = stiffness.lines[0].get_data()
    assert "N/m" in stiffness.get_ylabel()
    np.testing.assert_allclose(k, 2 + 3 * np.asarray(X) ** 2, rtol=1e-12)
    assert "damping" in damping.get_ylabel()
    assert len(force.lines) == 3  # cycles of three amplitudes: the force depends on x and v
    assert " to 5 at 1. Equivalent damping" in drawing.alternative


def test_a_wave_about_a_mean_follows_the_addition_theorem():
    # Jacobi-Anger: the sine part of cos(a X sin(phi) + b + a X0) is -2 J1(a X) sin(b + a X0), its mean
    # J0(a X) cos(b + a X0)
    derived = derive("F*cos(a*x + b) + k*x")
    assert derived.closed_form
    numbers = {"F": 2.0, "a": 1.5, "b": 0.4, "k": 3.0, "X": 0.8, "X0": 0.3}
    places = {symbol(name): number for name, number in numbers.items()}
    phase = 0.4 + 1.5 * 0.3
    stiffness = 3 - 2 * 2 * j1(1.5 * 0.8) * np.sin(phase) / 0.8
    assert float(derived.stiffness.subs(places)) == pytest.approx(stiffness, rel=1e-12)
    mean = 3 * 0.3 + 2 * j0(1.5 * 0.8) * np.cos(phase)
    assert float(derived.mean_balance.subs(places)) == pytest.approx(mean, rel=1e-12)
