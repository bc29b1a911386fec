"""Newton's corrections of many points at once against a solver of linear equations."""

import numpy as np
import pytest

from rsgen.dynamics.fixed_point import attraction, correction


@pytest.mark.parametrize("size", [2, 3, 4, 5])
def test_corrections_solve_their_equations_also_where_a_pivot_vanishes(size):
    random = np.random.default_rng(size)
    jacobian = random.normal(size=(size, size, 50))
    jacobian[0, 0, :10] = 1.0  # I - J begins with a zero
    jacobian[:, :, 20:30] *= 0.3
    residual = random.normal(size=(size, 50))
    matrix = np.moveaxis(np.eye(size)[:, :, None] - jacobian, 2, 0)
    exact = np.linalg.solve(matrix, residual.T[:, :, None])[..., 0].T
    loss = np.linalg.cond(matrix)
    # without exchange of rows a pivot of 1e-4 may cost four digits more than the condition does
    assert np.all(np.abs(correction(jacobian, residual) - exact) < 1e-11 * loss * np.abs(exact).max(axis=0))


def test_a_singular_point_moves_by_its_residual_and_spoils_no_other():
    jacobian = np.zeros((3, 3, 3))
    jacobian[:, :, 1] = np.eye(3)
    residual = np.arange(9.0).reshape(3, 3)
    assert np.array_equal(correction(jacobian, residual), residual)


@pytest.mark.parametrize("size", [2, 3, 4])
def test_a_point_attracts_where_all_eigenvalues_are_inside_the_unit_circle(size):
    generator = np.random.default_rng(size)
    jacobian = generator.normal(size=(size, size, 400)) / np.sqrt(size)
    largest = np.abs(np.linalg.eigvals(np.moveaxis(jacobian, -1, 0))).max(axis=1)
    inside = attraction(jacobian) > 0
    assert 50 < np.count_nonzero(inside) < 350
    assert np.array_equal(inside, largest < 1)
