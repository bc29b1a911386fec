"""Response control: one held amplitude gives one stiffness and one damping, whatever the noise of it says."""

import numpy as np
import pytest

import rsgen as rs

MASS, K, C, K3 = 1.3, 30000.0, 12.0, 4e10
LAW = "k*x + c*v + k3*x**3"


def held(*levels: float, seed: int, moved: float = 0.003) -> rs.ResponseSurface:
    """Make a test of a cubic spring at held amplitudes [m], with 0.5 % noise of the force."""
    random = np.random.default_rng(seed)
    level, frequency = (part.ravel() for part in np.meshgrid(levels, np.linspace(22, 30, 33), indexing="ij"))
    omega, count = 2 * np.pi * frequency, len(level)
    stiffness = K + 0.75 * K3 * level**2 - MASS * omega**2 + 1j * omega * C
    noise = 1 + 0.0035 * (random.standard_normal(count) + 1j * random.standard_normal(count))
    amplitude = level * (1 + moved * random.standard_normal(count))
    return rs.ResponseSurface(
        level, frequency, level * stiffness * noise, amplitude.astype(complex), control="response"
    )


@pytest.mark.parametrize("seed", range(3))
def test_one_held_amplitude_determines_one_stiffness(seed):
    found = rs.identify(held(3e-4, seed=seed), LAW, mass=MASS)
    assert [found[name].finding.code for name in ("k", "k3")] == ["confounded"] * 2
    assert found["c"].interval[0] < C < found["c"].interval[1]
    assert found.verdict.state == "doubtful"


@pytest.mark.parametrize("seed", range(2))
def test_two_held_amplitudes_determine_two_stiffnesses(seed):
    found = rs.identify(held(1e-4, 3e-4, seed=seed), LAW, mass=MASS)
    for name, true in (("k", K), ("k3", K3), ("c", C)):
        low, high = found[name].interval
        assert low < true < high and found[name].identifiable
