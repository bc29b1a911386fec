import numpy as np
import pytest

from rsgen.common.solvers import determined, solve_scaled
from rsgen.identification.fitting.least_squares import Linearisation, Rules, descend, fit, summarise


def drawn(rows: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(1)
    # columns of sizes as different as those of a stiffness and a cubic spring
    matrix = generator.standard_normal((rows, 4)) * [1e-6, 1.0, 1e4, 1e9]
    return matrix, generator.standard_normal(rows)


@pytest.mark.parametrize("rows", [4, 4096, 4097, 20_000])
def test_many_rows_are_solved_as_one_matrix_is(rows):
    matrix, right = drawn(rows)
    scale = np.sqrt(np.sum(matrix**2, axis=0))
    whole = np.linalg.lstsq(matrix / scale, right, rcond=None)[0] / scale
    solution, inverse, null = solve_scaled(matrix, right)
    assert np.allclose(solution, whole, rtol=1e-11, atol=0)
    covariance = np.linalg.inv((matrix / scale).T @ (matrix / scale)) / np.outer(scale, scale)
    assert np.allclose(inverse @ inverse.T, covariance, rtol=1e-9, atol=1e-9 * np.diag(covariance).min())
    assert null.shape == (4, 0)


def test_what_is_not_identifiable_is_named():
    generator = np.random.default_rng(2)
    one, other = generator.normal(size=(2, 30))
    matrix = np.stack([one, 1e9 * one, other, np.zeros(30)], axis=1)
    solution, _, null = solve_scaled(matrix, 3 * one + other)
    assert matrix @ solution == pytest.approx(3 * one + other, rel=1e-9, abs=1e-9)
    assert null.shape[1] == 2
    assert (np.abs(null).max(axis=1) > 1e-3).tolist() == [True, True, False, True]


def descended(rows, start: list[float], count: int, size: float):
    """Descend along residuals (2,) and slopes (2, q) of a size, the same at so many points."""

    def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
        residual, by = (np.tile(part, (count, *[1] * np.ndim(part))) for part in rows(p))
        return Linearisation(size * residual, np.zeros((count, 2, 0)), size * by)

    parameters, _, _, converged = descend(linearise, np.array(start), np.zeros((count, 0)))
    return parameters, converged


def test_a_narrow_valley_with_a_bend_is_followed_to_its_end():
    """Rosenbrock's, 1e5 steep: a thirty-second of a step leads up from its floor, a full one back to it.

    It is one of exact data, as that of the square of a one-sided stiffness.
    """

    def rows(p: np.ndarray):
        return [1e5 * (p[0] ** 2 - p[1]), 1 - p[0]], [[-2e5 * p[0], 1e5], [1.0, 0.0]]

    parameters, converged = descended(rows, [0.3, 0.09], 4, 1e-6)
    assert converged
    assert parameters == pytest.approx([1, 1], rel=1e-9)


@pytest.mark.parametrize(("size", "expected"), [(1.0, False), (1e-6, True)])
def test_what_truncated_waveforms_leave_of_exact_data_is_no_open_step(size, expected):
    """A wrong slope promises a twelfth of the sum of squares, and no step has it."""
    parameters, converged = descended(lambda p: ([1.0, 1 - p[0]], [[-0.3], [1.0]]), [1.0], 40, size)
    assert parameters == pytest.approx([1])
    assert converged is expected


def line_through(noise: float, seed: int, spoilt: int = 0):
    """Points of y = p0 + p1 x with equal noise on x and y; nuisances are x and an idle one."""
    generator, x = np.random.default_rng(seed), np.linspace(0, 1, 60)
    seen_x, seen_y = x + noise * generator.normal(size=60), 0.5 + 2 * x + noise * generator.normal(size=60)
    seen_y[:spoilt] += 1

    def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
        predicted = p[0] + p[1] * nuisance[:, 0]
        residual = np.stack([seen_x - nuisance[:, 0], seen_y - predicted, -nuisance[:, 1]], axis=1)
        by_own, by_parameter = np.zeros((60, 3, 2)), np.zeros((60, 3, 2))
        by_own[:, 0, 0], by_own[:, 1, 0], by_own[:, 2, 1] = 1, p[1], 1
        by_parameter[:, 1, 0], by_parameter[:, 1, 1] = 1, nuisance[:, 0]
        return Linearisation(residual / noise, by_own / noise, by_parameter / noise)

    return linearise, np.array([0.0, 1.0]), np.stack([seen_x, np.zeros(60)], axis=1)


@pytest.mark.slow
def test_noise_on_both_sides_does_not_bias_the_slope_and_is_found_with_its_errors():
    # ordinary least squares would find 2/(1 + 0.2^2/var(x)) = 1.35
    found = [fit(*line_through(0.2, seed)).parameters[1] for seed in range(200)]
    spread = np.std(found) / np.sqrt(200)
    assert abs(np.mean(found) - 2) < 0.1 + 4 * spread
    assert np.median(found) == pytest.approx(2, abs=4 * spread)

    runs = [fit(*line_through(0.01, seed)) for seed in range(100)]
    # four standard errors of the mean of 100
    assert np.mean([run.sigma for run in runs]) == pytest.approx(1, rel=0.04)
    scores = [(run.parameters[1] - 2) / np.sqrt(run.covariance[1, 1]) for run in runs]
    assert np.std(scores) == pytest.approx(1, rel=0.25)  # 3.5 standard errors of a spread of 100


def test_outliers_are_set_aside_but_not_when_neighbours_agree():
    assert np.flatnonzero(~fit(*line_through(0.01, 1, spoilt=3)).used).tolist() == [0, 1, 2]
    pairs = np.stack([np.arange(59), np.arange(1, 60)], axis=1)
    systematic = fit(*line_through(0.01, 1, spoilt=8), neighbours=pairs)
    assert systematic.used.all()


@pytest.mark.parametrize(("spoilt", "outliers"), [([30], [30]), ([28, 29, 30, 31, 32, 33], [])])
def test_an_outlier_that_pulls_peaks_off_its_neighbours_is_set_aside_alone(spoilt, outliers):
    # three runs over a peak of the same size and place
    place, pairs = np.tile(np.arange(-10, 10), 3) / 1.5, np.stack([np.arange(59), np.arange(1, 60)], axis=1)
    peak = np.exp(-(place**2))
    slopes = np.stack([np.ones(60), peak, place * peak], axis=1)[:, None].repeat(2, axis=1)
    seen = slopes @ [1.0, 2.0, 1.0] + 0.01 * np.random.default_rng(1).normal(size=(60, 2))
    seen[spoilt, 0] += 1
    found = fit(*straight(slopes, seen), neighbours=pairs)
    assert np.flatnonzero(~found.used).tolist() == outliers


def test_of_what_is_not_determined_no_covariance_is_known():
    known = np.isfinite(determined(np.eye(3), np.array([[1.0], [0.0], [0.0]])))
    assert known.tolist() == [[False] * 3, [False, True, True], [False, True, True]]


@pytest.mark.parametrize("shared", [-0.3, 0.6])
def test_errors_follow_from_noise_that_neighbours_share(shared):
    generator, record = np.random.default_rng(2), np.repeat([0, 1], 40)
    slopes = np.tile(np.linspace(-1, 1, 40)[:, None] ** np.arange(3), (2, 1))
    errors = {"independent": Rules(), "shared": Rules(record=record)}
    inside: dict[str, list[np.ndarray]] = {name: [] for name in errors}
    for _ in range(200):
        noise = generator.normal(size=81)
        seen = noise[1:] + shared * noise[:-1]
        values = np.linalg.lstsq(slopes, seen, rcond=None)[0]
        line = Linearisation((seen - slopes @ values)[:, None], np.zeros((80, 1, 0)), slopes[:, None])
        for name, rules in errors.items():
            found = summarise(line, values, np.zeros((80, 0)), rules)
            inside[name].append(np.abs(values) < 2 * np.sqrt(np.diag(found.covariance)))
    assert not 0.88 < np.mean(inside["independent"]) < 0.99
    assert 0.88 < np.mean(inside["shared"]) < 0.99


def straight(slopes: np.ndarray, seen: np.ndarray):
    """Readings (n, r) that are linear in the parameters, without nuisances."""
    count, rows, parameters = slopes.shape

    def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
        return Linearisation(seen - slopes @ p, np.zeros((count, rows, 0)), slopes)

    return linearise, np.ones(parameters), np.zeros((count, 0))


def test_what_nothing_determines_takes_up_no_freedom():
    # two parameters of which only the sum has an effect: of 40 numbers one goes into it
    seen = np.random.default_rng(5).normal(size=(20, 2))
    found = fit(*straight(np.ones((20, 2, 2)), seen), exclude=False)
    assert found.freedom == 39
    assert found.sigma == pytest.approx(seen.std(ddof=1), rel=1e-9)


def test_errors_are_never_less_than_those_of_equal_noise():
    # all noise where the slope is small: the scatter of the scores alone would say a smaller error
    x = np.linspace(0, 1, 40)
    seen = np.outer(2 * x, np.ones(2))
    seen[:10] += 0.1 * np.array([[1.0, -1.0], [-1.0, 1.0]] * 5)
    found = fit(*straight(np.repeat(x[:, None, None], 2, axis=1), seen), exclude=False)
    assert found.covariance[0, 0] == pytest.approx(found.sigma**2 / (2 * np.sum(x**2)), rel=1e-9)


def test_what_is_known_of_a_parameter_counts_as_one_more_reading():
    generator = np.random.default_rng(6)
    slopes, seen = generator.normal(size=(20, 2, 3)), generator.normal(size=(20, 2))
    linearise, start, idle = straight(slopes, seen)
    rules = Rules(prior=np.array([0.0, 0.0, 8.0]))
    parameters, nuisance, line, converged = descend(linearise, start, idle, rules)
    matrix = np.concatenate([slopes.reshape(-1, 3), [[0.0, 0.0, 8.0]]])
    expected = np.linalg.lstsq(matrix, np.append(seen.reshape(-1), 0.0), rcond=None)[0]
    assert converged
    assert parameters == pytest.approx(expected, rel=1e-12)
    found = summarise(line, parameters, nuisance, rules)
    assert found.freedom == 41 - 3
    assert found.basis @ found.basis.T == pytest.approx(np.linalg.inv(matrix.T @ matrix), rel=1e-9)


@pytest.mark.parametrize("most", [10.0, 2.5])
def test_linear_parameters_are_best_beside_nonlinear_ones_within_bounds(most):
    """A decay a exp(-b t), from values at which a is three times too small."""
    t = np.linspace(0, 2, 50)[:, None]
    seen = 3 * np.exp(-4 * t)

    def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
        shape = np.exp(-p[1] * t)
        slopes = np.stack([shape, -p[0] * t * shape], axis=2)
        return Linearisation(seen - p[0] * shape, np.zeros((50, 1, 0)), slopes)

    rules = Rules(
        linear=[0], bounded_step=lambda p, change: np.array([p[0], np.clip(p[1] + change[1], 0.1, most)])
    )
    parameters, *_ = descend(linearise, np.array([1.0, 1.0]), np.zeros((50, 0)), rules)
    rate = min(4.0, most)
    shape = np.exp(-rate * t)
    assert parameters == pytest.approx([float(np.sum(shape * seen) / np.sum(shape**2)), rate], rel=1e-9)
