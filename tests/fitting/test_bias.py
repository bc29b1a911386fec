"""What noise does to an estimate: its bias, and the influence of each measured value."""

from dataclasses import replace

import numpy as np
import pytest

from rsgen.identification.fitting.fit import fit_balance
from rsgen.identification.fitting.forward import remove_bias
from rsgen.identification.fitting.least_squares import Linearisation, Regression, fit
from rsgen.identification.fitting.observed import Observed, Problem
from rsgen.identification.fitting.points import Points, select_points
from rsgen.law.numeric import compile_law
from tests.surfaces import LAWS, MASS, model, surface

NOISE, TRUE, COUNT = 0.15, 2.0, 160


def found(seed: int, *, corrected: bool, expected: float = NOISE) -> float:
    """Slope of y = p x^2 / 2 with noise on both, in units of the noise that was expected."""
    x, generator = np.linspace(0.2, 1, COUNT), np.random.default_rng(seed)
    seen_x = x + NOISE * generator.normal(size=COUNT)
    seen_y = TRUE / 2 * x**2 + NOISE * generator.normal(size=COUNT)

    def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
        s = nuisance[:, 0]
        residual = np.stack([seen_x - s, seen_y - p[0] / 2 * s**2], axis=1) / expected
        by_own, by_parameter = np.ones((COUNT, 2, 1)), np.zeros((COUNT, 2, 1))
        by_own[:, 1, 0], by_parameter[:, 1, 0] = p[0] * s, s**2 / 2
        return Linearisation(residual, by_own / expected, by_parameter / expected)

    fitted = fit(linearise, np.array([1.5]), seen_x[:, None], exclude=False)
    if corrected:
        line = linearise(fitted.parameters, fitted.nuisance)

        def bend(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            second, slopes = np.zeros((COUNT, 2)), np.zeros((COUNT, 2, 1))
            second[:, 1] = fitted.parameters[0] / expected * direction[:, 0] ** 2
            slopes[:, 1, 0] = fitted.nuisance[:, 0] * direction[:, 0] / expected
            return second, slopes

        fitted = remove_bias(fitted, line, bend)
    return float(fitted.parameters[0])


@pytest.mark.slow
def test_the_bias_of_squared_noise_is_removed():
    """What curves in x takes the noise of x for a smaller p."""
    runs = range(300)
    raw, mended = ([found(seed, corrected=corrected) for seed in runs] for corrected in (False, True))
    error = np.std(mended) / np.sqrt(len(runs))
    assert abs(np.mean(raw) - TRUE) > 4 * error
    assert abs(np.mean(mended) - TRUE) < 2.5 * error


def test_the_correction_is_that_of_the_noise_found_whatever_was_expected():
    values = [found(1, corrected=True, expected=NOISE * times) for times in (0.3, 1.0, 3.0)]
    assert values == pytest.approx([values[1]] * 3, rel=1e-6)
    assert abs(values[1] - found(1, corrected=False)) > 0.01


CHANGE = 1e-5
"""Relative: its effect, not its square, is what is looked at, and no noise is seen in the data."""

TURN = np.exp(0.7j)
"""Phase of the clock, so that no part of a force or response is zero."""


@pytest.fixture(scope="module")
def points():
    table = surface("cubic", levels=np.array([2.0, 4.0]), frequencies=np.linspace(8.5, 11.5, 9))
    found = select_points(table, model("cubic"))
    turned = found.harmonics * TURN ** np.arange(found.harmonics.shape[1])
    return replace(found, force=found.force * TURN, harmonics=turned)


def fitted(points: Points) -> Regression:
    law = compile_law(model("cubic").force)
    problem = Problem(model("cubic").elements, law, Observed.of(points))
    values = np.array([LAWS["cubic"][1][name] for name in law.parameters])
    return fit_balance(problem, problem.join(values, MASS, np.zeros(0)), order=5, exclude=False).regression


@pytest.mark.parametrize("part", [1.0, 1.0j], ids=["amplitude", "phase"])
@pytest.mark.parametrize("row", [0, 1], ids=["force", "response"])
def test_an_estimate_moves_by_the_influence_of_what_was_changed(points, row, part):
    before = fitted(points)
    half = (before.influence.shape[1] + 1) // 2
    column = row if part == 1.0 else row + half
    # where the phase matters, near the resonance of the lower level
    place = int(np.argmax(np.abs(before.influence[:, column, 0])))
    force, harmonics = np.array(points.force), np.array(points.harmonics)
    if row == 0:
        force[place] *= 1 + CHANGE * part
    else:
        harmonics[place, 1] *= 1 + CHANGE * part
    after = fitted(replace(points, force=force, harmonics=harmonics))
    moved, expected = after.parameters - before.parameters, before.influence[place, column] * CHANGE
    error = np.sqrt(np.diag(after.covariance))
    # a fit ends where a step moves no parameter by more than a hundredth of its error
    assert np.abs((moved - expected) / error).max() < 0.05
    assert np.abs(expected / error).max() > 0.3
