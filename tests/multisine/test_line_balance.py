"""What single periods say of the balance at the lines, against formulas for laws that are simple enough."""

import numpy as np
import pytest

import rsgen
from rsgen.dynamics.linear_part import background_of_lines
from rsgen.identification.lines.line_balance import Balance, BalanceNoise, SpectralLines
from rsgen.identification.lines.line_fit import fit_lines
from rsgen.law.motion import harmonics_of, waveform
from rsgen.law.numeric import ForceLaw, compile_law

MASS, OMEGA0, LINES, PERIODS = 1.5, np.pi, 24, 4
STIFFNESS, DAMPING, SQUARE = 5000.0, 4.0, 6e4


def records(*, of_force: float, of_response: float, mean_known: bool = True) -> rsgen.MultisineSpectra:
    """Periods of one record with noise of either at every line but the mean."""
    generator = np.random.default_rng(2)

    def drawn(size: float) -> np.ndarray:
        noise = generator.standard_normal((2, 1, PERIODS, LINES + 1)) * size * (np.arange(LINES + 1) > 0)
        return noise[0] + 1j * noise[1]

    response = np.zeros((1, 1, LINES + 1), dtype=complex)
    response[..., 1:8] = 1e-3 * np.exp(1j * np.arange(7))
    force = np.ones((1, 1, LINES + 1)) * (np.arange(LINES + 1) > 0)
    return rsgen.MultisineSpectra(
        np.ones(1), OMEGA0, force + drawn(of_force), response + drawn(of_response), mean_known
    )


def lines_from(spectra: rsgen.MultisineSpectra, first: int = 1) -> SpectralLines:
    """All lines from the first on, noisy or not, are taken from the record."""
    used = np.arange(LINES + 1)[None] > 0
    none = background_of_lines("none", spectra, (1.0, 2.0))
    return SpectralLines(spectra, used, 256, np.array([first]), np.array([LINES]), LINES, none, np.zeros(0))


def law_of(text: str) -> ForceLaw:
    return compile_law(rsgen.Law(text).force)


def noise_of(lines: SpectralLines, text: str, *values: float) -> BalanceNoise:
    law, numbers = law_of(text), np.array(values)
    balance = Balance.of(lines, law, numbers, MASS, BalanceNoise.unknown(lines, len(values)))
    return balance.noise(lines, law, numbers, MASS)


def test_the_bias_of_a_square_is_the_variance_of_the_mean_motion():
    # along the mean of P periods k2 x^2 is too large by k2 var(x)/P, with the variance of P numbers
    spectra = records(of_force=0.0, of_response=1e-4)
    lines = lines_from(spectra)
    waves = waveform(np.array(spectra.response[0]), lines.samples)
    bias = SQUARE * waves.var(axis=0, ddof=1) / PERIODS
    expected = harmonics_of(bias, LINES + 1)
    found = noise_of(lines, "k2*x**2", SQUARE).bias[0]
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_the_bias_follows_the_values_between_two_looks_at_the_periods():
    spectra = records(of_force=0.0, of_response=1e-4)
    lines, law, text = lines_from(spectra), law_of("k2*x**2"), "k2*x**2"
    twice = np.array([2 * SQUARE])
    once, anew = (
        Balance.of(lines, law, twice, MASS, noise_of(lines, text, size)) for size in (SQUARE, 2 * SQUARE)
    )
    assert once.residual == pytest.approx(anew.residual, rel=1e-9)


def test_slopes_go_with_the_balance_as_the_mean_of_all_periods_does():
    # of k x the slope is x, and noise of x moves the balance by -(k - m omega^2) x
    spectra = records(of_force=0.0, of_response=1e-5)
    lines = lines_from(spectra)
    found = noise_of(lines, "k*x", STIFFNESS).cross_covariance[0, 0]
    omega = OMEGA0 * np.arange(LINES + 1)
    power = np.sum(np.abs(spectra.response[0] - spectra.mean_response[0]) ** 2, axis=0)
    expected = -(STIFFNESS - MASS * omega**2) * power / (PERIODS - 1) / PERIODS
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_where_the_law_moves_itself_noise_of_the_force_counts_by_what_inertia_takes_of_it():
    spectra = records(of_force=0.01, of_response=1e-15)
    lines = lines_from(spectra, first=6)
    found = noise_of(lines, "k*x + c*v", DAMPING, STIFFNESS)
    apart = spectra.force[0] - spectra.mean_force[0]
    omega = OMEGA0 * np.arange(1, LINES + 1)
    dynamic = STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING
    share = np.where(omega < 6 * OMEGA0, -MASS * omega**2 / dynamic, 1.0)
    # the balance of every period, and the power that is expected of it
    assert found.deviation[0, :, 1:] == pytest.approx(share * apart[:, 1:], rel=1e-6, abs=1e-12)
    expected = np.abs(share) ** 2 * spectra.noise()[0][0, 1:] ** 2
    assert found.weight_shape[0, 1:] == pytest.approx(expected, rel=1e-6)


def test_slopes_follow_the_mean_that_the_law_finds():
    spectra = records(of_force=0.0, of_response=0.0, mean_known=False)
    lines, law = lines_from(spectra), law_of("k*x + k2*x**2 + c*v")
    values, none = np.array([DAMPING, STIFFNESS, SQUARE]), BalanceNoise.unknown(lines, 3)
    found = Balance.of(lines, law, values, MASS, none)
    for place, value in enumerate(values):
        step = np.zeros(3)
        step[place] = 1e-3 * value
        up, down = (Balance.of(lines, law, values + s, MASS, none).residual[0, 1:] for s in (step, -step))
        slope = (down - up) / (2 * step[place])
        assert np.abs(found.slopes[0, place, 1:] - slope).max() < 1e-5 * np.abs(slope).max()


def linear(*, of_force: float, of_response: float, seed: int, periods: int = 32) -> rsgen.MultisineSpectra:
    """A linear structure below its resonance at 9.2 Hz, all lines alike, with white noise."""
    generator, omega = np.random.default_rng(seed), OMEGA0 * np.arange(LINES + 1) / 4
    response = 1e-3 * np.exp(2j * np.pi * generator.random(LINES + 1)) * (omega > 0)
    force = (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING) * response
    drawn = generator.standard_normal((2, 2, periods, LINES + 1)) / np.sqrt(2)
    both = [one + size * (part[0] + 1j * part[1]) * (omega > 0) for one, size, part in
            zip((force, response), (of_force, of_response), drawn, strict=True)]  # fmt: skip
    return rsgen.MultisineSpectra(np.ones(1), OMEGA0 / 4, both[0][None], both[1][None])


def test_errors_are_those_of_noise_on_the_force_alone():
    # of k and c the real and the imaginary part of each line have half of its variance
    spectra, law = linear(of_force=0.02, of_response=0.0, seed=3), law_of("k*x + c*v")
    lines = lines_from(spectra)
    found = fit_lines(lines, law, {"m": MASS}, np.array([DAMPING, STIFFNESS]), MASS)
    covariance = found.errors[0].covariance
    omega = OMEGA0 / 4 * np.arange(1, LINES + 1)
    variance = 0.02**2 / spectra.periods / 2 / np.array([np.sum((1e-3 * omega) ** 2), LINES * 1e-6])
    # a variance from 31 x 24 complex numbers, and lines that are weighed by it; a given mass has none
    assert np.diag(covariance) == pytest.approx([*variance, 0.0], rel=0.2)


def test_noise_of_the_response_does_not_pull_the_stiffness():
    # plain least squares would find k (1 - s^2/P/|x|^2), two per cent less
    law, found = law_of("k*x + c*v"), []
    for seed in range(40):
        spectra = linear(of_force=0.0, of_response=0.28e-3, seed=seed, periods=4)
        lines = lines_from(spectra)
        fit = fit_lines(lines, law, {"m": MASS}, np.array([DAMPING, STIFFNESS]), MASS)
        found.append(fit.values[list(law.parameters).index("k")] / STIFFNESS - 1)
    assert abs(np.mean(found)) < 3 * np.std(found) / np.sqrt(len(found)) + 2e-3
    assert np.std(found) / np.sqrt(len(found)) < 4e-3
