"""Virtual tests of driven bases, sweeps and free decays: closed forms, units, the law of the stepped test."""

from typing import Any

import numpy as np
import pytest

import rsgen as rs
from rsgen.app.study.run_case import obtain_table
from rsgen.common.tolerances import interval_sigmas
from tests.case_files import law, write_small

LEVELS = {"displacement": [2e-5, 1e-4], "velocity": [2e-3, 1e-2], "acceleration": [0.2, 1.0]}
MASS = 1.5
CUBIC = rs.Oscillator(MASS, "k*x + kn*x**3 + c*v", {"k": 6000.0, "kn": 4e6, "c": 4.0})
LIGHT = rs.Oscillator(MASS, CUBIC.elements, {**CUBIC.values, "c": 1.0})
LAW = str(CUBIC.force)


@pytest.mark.parametrize("method", ["time", "harmonic-balance"])
@pytest.mark.parametrize("base", LEVELS)
def test_a_linear_structure_has_its_transmissibility(base, method):
    """z/x_b = omega^2/(omega_0^2 - omega^2 + 2 i zeta omega_0 omega), x_b from what of it is given."""
    oscillator = rs.Oscillator(2.0, "k*x + c*v", {"k": 2e4, "c": 4.0})
    grid = {"level": LEVELS[base], "frequency": np.linspace(11, 25, 40), "accuracy": 1e-9}
    surface = rs.simulate(oscillator, rs.SimulatedTest(**grid, base=base, method=method))
    omega = surface.omega
    of_base = surface.level / (1j * omega) ** list(LEVELS).index(base)
    expected = of_base * omega**2 / (1e4 - omega**2 + 2j * omega)
    np.testing.assert_allclose(surface.harmonics[:, 1], expected, rtol=1e-8)
    np.testing.assert_allclose(surface.force, of_base * omega**2, rtol=1e-12)
    unit = ("m", "m/s", "m/s^2")[list(LEVELS).index(base)]
    assert (surface.per_mass, surface.base, surface.level_unit) == (True, base, unit)


@pytest.mark.parametrize(("quantity", "levels", "held", "meant"), [
    ("displacement", ["20 um", "100 um"], "20 um", [2e-5, 1e-4]),
    ("acceleration", ["0.1 g", "200 mg"], "0.1 g", [0.980665, 1.96133]),
])  # fmt: skip
def test_a_case_knows_the_mass_beforehand_and_levels_in_their_unit(tmp_path, quantity, levels, held, meant):
    changes = {
        **law("k*x + c*v", k=2e4, c=4.0), "system.mass": "2 kg", "test.level.values": levels,
        "test.base": {"quantity": quantity}, "identify": {"hold_out": [held]},
    }  # fmt: skip
    case = rs.load_case(write_small(tmp_path, "shaken", changes))
    np.testing.assert_allclose(case.test.level, meant)
    assert case.observation.hold_out == pytest.approx(meant[:1])
    # as it was measured; what is identified has the mass
    surface = obtain_table(case)
    assert surface.per_mass
    assert rs.identify(surface, case.model)["k"].unit == "N/m"


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
