"""Parts of the modal table against closed forms: splines, what their shapes say together, and their price."""

import numpy as np
import pytest

from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import Points, select_points
from rsgen.identification.modal_result import ModalSplines, SplineBasis
from rsgen.identification.modal_table import ModePoints, ModeProblem, _harmonics_error

SIZES = np.geomspace(1e-3, 2e-2, 30)
TESTED = (1e-3, 2e-2)


@pytest.mark.parametrize("power", [2, 1, 0, -1])
def test_slopes_of_splines_are_by_the_logarithm_of_the_amplitude(power):
    basis, h = SplineBasis.over(SIZES, TESTED, 2, 3, power), 1e-6
    inside = np.geomspace(1.3e-3, 1.8e-2, 17)
    up, down = (basis(inside * np.exp(step))[0] for step in (h, -h))
    slope = (up - down) / (2 * h)
    assert np.abs(basis(inside)[1] - slope).max() < 1e-6 * np.abs(slope).max()


def flat(stiffness: float, damping: float, mass: float, others=()) -> ModalSplines:
    basis = SplineBasis.over(SIZES, TESTED, 0, 1, 1)
    return ModalSplines(basis, (1,), np.array([stiffness, damping]), mass, np.zeros((3, 3)), 10, others)


def test_shapes_that_fit_as_well_count_by_their_weight():
    # variance between models: the sum of w_i (value_i - value)^2 (Burnham and Anderson, 2002, Sec. 4.3)
    others = ((0.25, flat(5200.0, 4.4, 1.5)), (0.75, flat(5000.0, 4.0, 1.6)))
    k, c, errors = flat(5000.0, 4.0, 1.5, others).at(np.array([5e-3]))
    assert (k[0], c[0]) == pytest.approx((5000.0, 4.0))
    expected = [0.25 * 200**2, 0.25 * 0.4**2, 0.75 * 0.1**2]
    assert np.diag(errors[0]) == pytest.approx(expected, rel=1e-9)


def points_of(harmonics: np.ndarray, noise: float = 0.0) -> Points:
    """Eight points of k = 5000 N/m, c = 4 N s/m, m = 1.5 kg with these harmonics."""
    frequency = np.linspace(8.5, 10.0, len(harmonics))
    omega = 2 * np.pi * frequency
    force = (5000 - 1.5 * omega**2 + 4j * omega) * harmonics[:, 1]
    generator = np.random.default_rng(9)
    force = force * (1 + noise * generator.standard_normal(len(omega)))
    surface = ResponseSurface(np.abs(force), frequency, force, harmonics)
    return select_points(surface, Model("k*x + c*v"))


def test_the_mass_lacks_the_kinetic_energy_of_the_harmonics():
    # of x = X cos(wt) + 0.1 X cos(3wt) + 0.05 X cos(2wt): 9 * 0.01 + 4 * 0.0025 of the fundamental's
    harmonics = np.zeros((8, 4), dtype=complex)
    harmonics[:, 1:] = np.linspace(1e-3, 8e-3, 8)[:, None] * np.array([1.0, 0.05j, 0.1])
    assert _harmonics_error(points_of(harmonics), 1e-4) == pytest.approx(0.10, rel=1e-9)


def test_few_points_make_coefficients_dear():
    # AIC with the correction for n numbers and q coefficients: n log(mean square) + 2 q n/(n - q - 1)
    # (Hurvich and Tsai, Biometrika 76, 1989)
    harmonics = np.zeros((8, 2), dtype=complex)
    harmonics[:, 1] = np.linspace(1e-3, 8e-3, 8)
    points = points_of(harmonics, noise=0.01)
    tested = (1e-3, 8e-3)
    seen = ModePoints(Observed.of(points), points, np.zeros(0), tested)
    problem = ModeProblem(seen, SplineBasis.over(points.amplitude, tested, 0, 1, 1), (1,), np.nan)
    found, price = problem.solve()
    size = np.abs(points.force)
    columns = np.stack(
        [points.amplitude, 1j * points.omega * points.amplitude, -(points.omega**2) * points.amplitude]
    )
    matrix, right = (columns / size).T, points.force / size
    matrix = np.concatenate([matrix.real, matrix.imag])
    right = np.concatenate([right.real, right.imag])
    own, squares, *_ = np.linalg.lstsq(matrix / np.abs(matrix).max(axis=0), right, rcond=None)
    assert found == pytest.approx(own / np.abs(matrix).max(axis=0), rel=1e-8)
    n, q = 16, 3
    assert price == pytest.approx(n * np.log(squares[0] / n) + 2 * q * n / (n - q - 1), rel=1e-8)
