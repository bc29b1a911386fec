"""Measurement noise of a virtual test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsgen.common.arrays import ComplexArray
from rsgen.data.surface import ResponseSurface

__all__ = ["add_noise"]


def add_noise(surface: ResponseSurface, relative: float, seed: int) -> ResponseSurface:
    """Add complex Gaussian noise to force and response, independent of each other.

    The standard deviation of the complex noise is ``relative`` |F| on the force and ``relative`` |X1| on
    every harmonic: real and imaginary part have 1/sqrt(2) of it each, and so have the mean and the peaks,
    which are real. The same seed gives the same noise; zero leaves the surface as it is.
    """
    if relative == 0:
        return surface
    # separate streams: another number of harmonics does not change the noise of the force
    of_force, of_harmonics, of_peak = (np.random.default_rng([seed, stream]) for stream in range(3))
    deviation = relative / np.sqrt(2)
    F, X = np.abs(surface.force), surface.amplitude

    def complex_noise(generator: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
        # point by point: more points do not change the noise of the first ones
        parts = generator.standard_normal((*shape, 2))
        return np.asarray(parts[..., 0] + 1j * parts[..., 1])

    on_harmonics = complex_noise(of_harmonics, surface.harmonics.shape)
    on_harmonics[:, 0] = on_harmonics[:, 0].real
    return replace(
        surface,
        force=surface.force + deviation * F * complex_noise(of_force, F.shape),
        harmonics=surface.harmonics + deviation * X[:, None] * on_harmonics,
        peak=surface.peak + deviation * X[:, None] * of_peak.standard_normal(surface.peak.shape),
    )
