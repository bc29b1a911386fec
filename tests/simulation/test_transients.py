"""Virtual sweeps and free decays: the law of the stepped test, noise, progress."""

from typing import Any

import numpy as np
import pytest

import rsgen as rs
from rsgen.common.tolerances import interval_sigmas

MASS = 1.5
CUBIC = rs.Oscillator(MASS, "k*x + kn*x**3 + c*v", {"k": 6000.0, "kn": 4e6, "c": 4.0})
LIGHT = rs.Oscillator(MASS, CUBIC.elements, {**CUBIC.values, "c": 1.0})
LAW = str(CUBIC.force)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["linear", pytest.param("logarithmic", marks=pytest.mark.thorough)])
def test_a_slow_sweep_has_the_law_of_the_stepped_test(kind):
    sweep = rs.SweepTest([1, 2, 4], (8, 14), duration=80, rate=200, law=kind)
    swept = rs.identify(rs.simulate(CUBIC, sweep), LAW)
    stepped = rs.identify(rs.simulate(CUBIC, rs.SimulatedTest([1, 2, 4], np.linspace(8, 14, 61))), LAW)
    for name in (*CUBIC.values, "m"):
        low, high = swept[name].interval
        assert low < stepped[name].value < high
        assert swept[name].value == pytest.approx(stepped[name].value, rel=2e-3)


@pytest.mark.thorough
def test_errors_of_sweeps_and_decays_are_as_large_as_the_scatter():
    deviations: dict[str, list[float]] = {"sweep": [], "decay": []}
    for seed in range(1, 21):
        noise: dict[str, Any] = {"noise_relative": 0.003, "seed": seed}
        sweep = rs.SweepTest([2, 4], (8, 14), duration=60, rate=200, sweep="up", **noise)
        decay = rs.DecayTest([12e-3, 24e-3], duration=20, rate=400, **noise)
        for kind, truth, test, mass in (("sweep", CUBIC, sweep, None), ("decay", LIGHT, decay, MASS)):
            found = rs.identify(rs.simulate(truth, test), LAW, mass=mass)
            assert found.verdict.state == "identified"
            # by noise alone, without what terms that it hides would move
            known = zip(found.alternatives.names, found.alternatives.error, strict=True)
            deviations[kind] += [
                (found[name].value - truth.values[name]) / error for name, error in known if name != "m"
            ]
    inside = np.mean([np.abs(missed) < interval_sigmas() for missed in deviations.values()])
    size = {kind: float(np.sqrt(np.mean(np.square(missed)))) for kind, missed in deviations.items()}
    assert all(0.6 < rms < 1.4 for rms in size.values()), size
    assert 0.88 < inside < 0.99, inside


def test_a_sweep_up_and_down_reports_its_progress_from_nothing_to_all():
    shares: list[float] = []
    rs.simulate(CUBIC, rs.SweepTest([1, 2], (8, 14), duration=12, rate=2000), progress=shares.append)
    assert shares[0] == 0
    assert shares == sorted(shares)
    assert 0.5 in shares
    assert 0.5 < shares[-1] < 1
