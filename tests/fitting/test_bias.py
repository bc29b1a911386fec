from __future__ import annotations

import numpy as np
import pytest

from rsgen.fitting.least_squares import Linearisation, fit, remove_bias


@pytest.mark.slow
def test_the_bias_of_squared_noise_is_removed() -> None:
    """Points of y = p x^2 / 2 with noise on both: what curves in x takes the noise of x for a smaller p."""
    noise, true, runs, count = 0.15, 2.0, 300, 160
    x = np.linspace(0.2, 1, count)

    def found(seed: int, *, corrected: bool) -> float:
        generator = np.random.default_rng(seed)
        seen_x = x + noise * generator.normal(size=count)
        seen_y = true / 2 * x**2 + noise * generator.normal(size=count)

        def linearise(p: np.ndarray, nuisance: np.ndarray) -> Linearisation:
            s = nuisance[:, 0]
            residual = np.stack([seen_x - s, seen_y - p[0] / 2 * s**2, -nuisance[:, 1]], axis=1) / noise
            by_own, by_parameter = np.zeros((count, 3, 2)), np.zeros((count, 3, 1))
            by_own[:, 0, 0], by_own[:, 1, 0], by_own[:, 2, 1] = 1, p[0] * s, 1
            by_parameter[:, 1, 0] = s**2 / 2
            return Linearisation(residual, by_own / noise, by_parameter / noise)

        nuisance = np.stack([seen_x, np.zeros(count)], axis=1)
        fitted = fit(linearise, np.array([1.5]), nuisance, reject=False)
        if corrected:
            second = np.zeros((count, 3, 2))
            second[:, 1, 0] = fitted.parameters[0] / noise
            fitted = remove_bias(fitted, linearise(fitted.parameters, fitted.nuisance), lambda: second)
        return float(fitted.parameters[0])

    raw, corrected_values = (
        [found(seed, corrected=corrected) for seed in range(runs)] for corrected in (False, True)
    )
    error = np.std(corrected_values) / np.sqrt(runs)
    assert abs(np.mean(raw) - true) > 4 * error
    assert abs(np.mean(corrected_values) - true) < 2.5 * error
