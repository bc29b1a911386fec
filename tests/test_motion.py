"""Periodic motions against direct sums, the tangent of a force against differences."""

import numpy as np
import pytest

from rsgen.law.motion import Motion, fourier_series

SERIES = [((1, 0, 2, 3), 64, False), ((0, 1, 2), 32, False), ((1, 3, 5, 7), 64, True), ((1,), 64, True)]


def _random(count: int, orders: tuple[int, ...], seed: int) -> np.ndarray:
    values = np.random.default_rng(seed).normal(size=(2, count, len(orders)))
    harmonics = values[0] + 1j * values[1]
    harmonics[:, np.array(orders) == 0] = harmonics.real[:, np.array(orders) == 0]
    return harmonics


@pytest.mark.parametrize(("orders", "samples", "half"), SERIES)
def test_a_series_is_its_sum_and_comes_back(orders, samples, half):
    series = fourier_series(orders, samples, half)
    harmonics = _random(5, orders, 1)
    phase = series.step * np.arange(series.shape.shape[1])
    assert phase[-1] + series.step == pytest.approx(np.pi if half else 2 * np.pi)
    turns = [(1j * np.array(orders)) ** n for n in range(3)]
    for turn, matrix in zip(turns, (series.shape, series.rate, series.bend), strict=True):
        direct = (harmonics[:, :, None] * turn[:, None] * np.exp(1j * np.outer(orders, phase))).real.sum(1)
        assert series.real(harmonics) @ matrix == pytest.approx(direct, abs=1e-12)
    signal = series.real(harmonics) @ series.shape
    assert series.complex(signal @ series.project) == pytest.approx(harmonics, abs=1e-13)


def test_waveforms_are_the_sum_and_its_derivatives():
    motion, samples = Motion(np.array([1.0, 2.0, 30.0, 400.0]), _random(4, (0, 1, 2, 3), 5)), 16
    time = motion.interval(samples) * np.arange(samples)
    for power, wave in enumerate(motion.waveforms(samples)):
        rate = 1j * motion.orders * motion.omega[:, None]
        phase = np.exp(1j * motion.orders[None, :, None] * motion.omega[:, None, None] * time[:, None, :])
        direct = ((motion.harmonics * rate**power)[:, :, None] * phase).real.sum(axis=1)
        assert wave == pytest.approx(direct, rel=1e-12, abs=1e-12 * np.abs(direct).max())
    # a turn is a shift in time: a quarter period of the fundamental is four of sixteen samples
    turned = motion.turned(np.full(4, np.pi / 2))
    for one, other in zip(turned.waveforms(samples), motion.waveforms(samples), strict=True):
        assert one == pytest.approx(np.roll(other, -4, axis=1), abs=1e-9 * np.abs(other).max())
