"""A shaken base: transmissibility in closed form, parameters per unit mass, the case file, the page."""

import numpy as np
import pytest

import rsgen as rs
from rsgen.app.study.run_case import obtain_table
from tests.case_files import law, write_small

LAW = "k*x + k3*x**3 + c*v"
TRUE = {"k": 2e4, "k3": 5e9, "c": 4.0}
MASS = 2.0
LEVELS = {"displacement": [2e-5, 1e-4], "velocity": [2e-3, 1e-2], "acceleration": [0.2, 1.0]}


@pytest.mark.parametrize("method", ["time", "harmonic-balance"])
@pytest.mark.parametrize("base", LEVELS)
def test_a_linear_structure_has_its_transmissibility(base, method):
    """z/x_b = omega^2/(omega_0^2 - omega^2 + 2 i zeta omega_0 omega), x_b from what of it is given."""
    oscillator = rs.Oscillator(MASS, "k*x + c*v", {"k": 2e4, "c": 4.0})
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
        **law(LAW, **TRUE), "system.mass": "2 kg", "test.level.values": levels,
        "test.base": {"quantity": quantity}, "identify": {"hold_out": [held]},
    }  # fmt: skip
    case = rs.load_case(write_small(tmp_path, "shaken", changes))
    np.testing.assert_allclose(case.test.level, meant)
    assert case.observation.hold_out == pytest.approx(meant[:1])
    # as it was measured; what is identified has the mass
    surface = obtain_table(case)
    assert surface.per_mass
    assert rs.identify(surface, case.model)["k"].unit == "N/m"
