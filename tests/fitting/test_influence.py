"""What a reading does to an estimate, against the estimate of readings that were changed."""

from dataclasses import replace

import numpy as np
import pytest

from rsgen.identification.fitting.fit import fit_balance
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Observed, Problem
from rsgen.identification.fitting.points import Points, select_points
from rsgen.law.numeric import compile_law
from tests.surfaces import LAWS, MASS, model, surface

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
