import numpy as np
import pytest

from rsgen.identification.fitting.least_squares import Linearisation, fit, remove_bias

NOISE, TRUE, COUNT = 0.15, 2.0, 160


def found(seed: int, *, corrected: bool, expected: float = NOISE) -> float:
    """Slope of y = p x^2 / 2 with noise on both, in units of the noise that was expected."""
    x = np.linspace(0.2, 1, COUNT)
    generator = np.random.default_rng(seed)
    seen_x = x + NOISE * generator.normal(size=COUNT)
    seen_y = TRUE / 2 * x**2 + NOISE * generator.normal(size=COUNT)

    def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
        s = nuisance[:, 0]
        residual = np.stack([seen_x - s, seen_y - p[0] / 2 * s**2, -nuisance[:, 1]], axis=1) / expected
        by_own, by_parameter = np.zeros((COUNT, 3, 2)), np.zeros((COUNT, 3, 1))
        by_own[:, 0, 0], by_own[:, 1, 0], by_own[:, 2, 1] = 1, p[0] * s, 1
        by_parameter[:, 1, 0] = s**2 / 2
        return Linearisation(residual, by_own / expected, by_parameter / expected)

    nuisance = np.stack([seen_x, np.zeros(COUNT)], axis=1)
    fitted = fit(linearise, np.array([1.5]), nuisance, exclude=False)
    if corrected:
        line = linearise(fitted.parameters, fitted.nuisance)

        def bend(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            second, slopes = np.zeros((COUNT, 3)), np.zeros((COUNT, 3, 1))
            second[:, 1] = fitted.parameters[0] / expected * direction[:, 0] ** 2
            slopes[:, 1, 0] = fitted.nuisance[:, 0] * direction[:, 0] / expected
            return second, slopes

        fitted = remove_bias(fitted, line, bend)
    return float(fitted.parameters[0])


@pytest.mark.slow
def test_the_bias_of_squared_noise_is_removed():
    """What curves in x takes the noise of x for a smaller p."""
    runs = 300
    raw, corrected_values = (
        [found(seed, corrected=corrected) for seed in range(runs)] for corrected in (False, True)
    )
    error = np.std(corrected_values) / np.sqrt(runs)
    assert abs(np.mean(raw) - TRUE) > 4 * error
    assert abs(np.mean(corrected_values) - TRUE) < 2.5 * error


def test_the_correction_is_that_of_the_noise_found_whatever_was_expected():
    values = [found(1, corrected=True, expected=NOISE * times) for times in (0.3, 1.0, 3.0)]
    assert values == pytest.approx([values[1]] * 3, rel=1e-6)
    # a good part of the bias, so that the numbers say something
    assert abs(values[1] - found(1, corrected=False)) > 0.01
