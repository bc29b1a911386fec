import tracemalloc

import numpy as np
import pytest

from rsgen.common.arrays import blocks
from rsgen.common.solvers import solve_scaled


def drawn(rows: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(1)
    # columns of sizes as different as those of a stiffness and a cubic spring
    matrix = generator.standard_normal((rows, 4)) * [1e-6, 1.0, 1e4, 1e9]
    return matrix, generator.standard_normal(rows)


@pytest.mark.parametrize("rows", [4, 4096, 4097, 20_000])
def test_many_rows_are_solved_as_one_matrix_is(rows: int) -> None:
    matrix, right = drawn(rows)
    scale = np.sqrt(np.sum(matrix**2, axis=0))
    whole = np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale
    solution, inverse, null = solve_scaled(matrix, right)
    assert np.allclose(solution, whole, rtol=1e-11, atol=0)
    covariance = np.linalg.inv((matrix / scale).T @ (matrix / scale)) / np.outer(scale, scale)
    assert np.allclose(inverse @ inverse.T, covariance, rtol=1e-9, atol=1e-9 * np.diag(covariance).min())
    assert null.shape == (4, 0)


def test_columns_that_differ_in_the_last_rows_alone_are_two() -> None:
    matrix, right = drawn(20_000)
    matrix[:, 2] = 2 * matrix[:, 1]
    assert solve_scaled(matrix, right)[2].shape == (4, 1)
    matrix[-3:, 2] = 0.0
    assert solve_scaled(matrix, right)[2].shape == (4, 0)


def test_the_rows_of_many_points_are_not_copied() -> None:
    matrix, right = drawn(200_000)
    tracemalloc.start()
    try:
        solve_scaled(matrix, right)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # a mask of finite numbers is an eighth of the matrix
    assert peak < 0.25 * matrix.nbytes


def test_blocks_cover_all_rows_once() -> None:
    assert [list(range(9))[part] for part in blocks(9, 4)] == [[0, 1, 2, 3], [4, 5, 6, 7], [8]]
    assert blocks(0, 4) == [slice(0, 4)]
