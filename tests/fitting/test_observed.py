"""Residuals and slopes of every observation against differences, by both forward models."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from rsgen.data.oscillator import BACKGROUNDS
from rsgen.dynamics.harmonic_balance import following_harmonics
from rsgen.identification.fitting.forward import ErrorsInVariables, HarmonicBalance, Simulator
from rsgen.identification.fitting.least_squares import Linearisation, eliminate
from rsgen.identification.fitting.observed import Comparison, Observed, Problem
from rsgen.identification.fitting.points import Points, select_points
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law
from tests.surfaces import MASS, model, surface

VALUES = np.array([3.8, 5920.0, -2.2e5])
OF_DIFFERENCES = {"balance": 2e-6, "simulator": 2e-2}
"""Error relative to the largest slope: of central differences in h = 1e-5; of one-sided ones in 1e-3."""

BACKGROUND = np.array([0.3, 2e-4, -1e-4, 5e-5, 3e-5, 0.1, -0.05, 13.0, 0.02])


@pytest.fixture(scope="module")
def points():
    table = surface("cubic", levels=np.array([2.0, 4.0]), frequencies=np.linspace(8.5, 11.5, 9))
    return select_points(table, model("cubic"))


def linearised(points: Points, kind: str, forward: str, *, phase: bool, logarithmic: bool):
    """The linearisation as a function of parameters and nuisances, and a place away from the solution."""
    law = compile_law(model("cubic").force)
    problem = Problem(model("cubic").elements, law, Observed.of(replace(points, phase_known=phase), kind))
    background = BACKGROUND[: len(problem.observed.background.names)]
    parameters = problem.join(VALUES * 1.01, MASS * 0.99, background)
    made = HarmonicBalance(law, points.motion, 5)
    if forward == "balance":
        nuisance = problem.observed.nuisances(points.amplitude, np.angle(points.harmonics[:, 1]))
    else:
        # what a unit of each parameter does to the force that holds an amplitude, and so to the amplitude
        held = made(*problem.split(parameters)[:2], points.amplitude)
        strength = np.sqrt(np.mean(np.abs(held.force_by / held.force[:, None]) ** 2, axis=0))
        odd = following_harmonics(law, 5)
        made = Simulator(
            model("cubic").elements, law, Motion(points.omega, points.harmonics), points.amplitude,
            points.force, odd, parameters[:4], strength, 0.05, null=np.zeros((4, 0)), accuracy=1e-9,
        )  # fmt: skip
        nuisance = problem.observed.nuisances(np.abs(points.force), np.angle(points.force))
    scale = points.amplitude if logarithmic else None

    def at(p: np.ndarray, u: np.ndarray) -> Linearisation:
        values, mass, b = problem.split(p)
        response = made(values, mass, np.exp(u[:, 0]))
        return problem.observed.linearise(
            response, Comparison(b, u, scale, problem.observed.compared(made.harmonics))
        )

    return at, parameters, nuisance + 0.003, problem.observed.fitted


@pytest.mark.slow
@pytest.mark.parametrize("forward", ["balance", "simulator"])
@pytest.mark.parametrize("phase", [True, False])
@pytest.mark.parametrize("kind", BACKGROUNDS)
def test_slopes_are_those_of_the_residuals(points, kind, phase, forward):
    for logarithmic in (False, True) if phase else (True,):
        at, place, nuisance, fitted = linearised(points, kind, forward, phase=phase, logarithmic=logarithmic)
        line = at(place, nuisance)
        assert np.isfinite(line.residual).all()
        h = 1e-5

        def close(slope: np.ndarray, high: Linearisation, low: Linearisation, step: float) -> None:
            # the prediction grows by what the residual falls
            difference = (low.residual - high.residual) / (2 * step)
            limit = OF_DIFFERENCES[forward] * max(float(np.abs(difference).max()), 1e-12)
            assert np.abs(slope - difference).max() < limit

        for j, value in enumerate(place):
            if j >= 4 and not fitted[j - 4]:
                assert not line.by_parameter[:, :, j].any()
                continue
            step = h * value * np.eye(len(place))[j]
            pair = at(place + step, nuisance), at(place - step, nuisance)
            close(line.by_parameter[:, :, j], *pair, step[j])
        for k, move in enumerate(h * np.eye(nuisance.shape[1])):
            close(line.by_nuisance[:, :, k], at(place, nuisance + move), at(place, nuisance - move), h)


def test_elimination_is_the_full_least_squares(points):
    at, place, nuisance, _ = linearised(points, "residuals", "balance", phase=True, logarithmic=True)
    line = at(place, nuisance)
    count, rows, k = line.by_nuisance.shape
    scale = np.abs(line.by_parameter).max(axis=(0, 1))
    dense = np.hstack([block_diag(*line.by_nuisance), (line.by_parameter / scale).reshape(count * rows, -1)])
    whole = np.linalg.lstsq(dense, line.residual.ravel(), rcond=None)[0][count * k :]
    residual, matrix = eliminate(line)
    small = np.linalg.lstsq((matrix / scale).reshape(count * rows, -1), residual.ravel(), rcond=None)[0]
    # condition of the problem, about 1e4, times round-off
    assert small == pytest.approx(whole, rel=1e-8, abs=1e-8 * np.abs(whole).max())


def test_second_derivatives_along_a_direction_are_those_of_the_residuals(points):
    # of sizes and phases together, in both kinds of rows
    law = compile_law(model("cubic").force)
    problem = Problem(model("cubic").elements, law, Observed.of(points))
    parameters = problem.join(VALUES * 1.01, MASS * 0.99)
    nuisance = problem.observed.nuisances(points.amplitude, np.angle(points.harmonics[:, 1])) + 0.003
    direction, h = 0.02 * np.random.default_rng(0).normal(size=nuisance.shape), 0.05
    for scale in (None, points.amplitude):
        descent = ErrorsInVariables(problem, HarmonicBalance(law, points.motion, 5))
        descent.scale = scale
        low, here, high = (
            descent.linearise(parameters, nuisance + times * direction) for times in (-h, 0.0, h)
        )
        second, slopes = descent._bend(parameters, nuisance, direction, descent._rows(parameters, nuisance))
        difference = (2 * here.residual - low.residual - high.residual) / h**2
        # error of central differences in a thousandth of a unit: its square, and round-off over it
        assert np.abs(second - difference).max() < 1e-4 * np.abs(difference).max()
        moved = (high.by_parameter - low.by_parameter) / (2 * h)
        assert np.abs(slopes - moved).max() < 1e-4 * np.abs(moved).max()
