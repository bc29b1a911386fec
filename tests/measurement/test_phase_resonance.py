"""Tables of a phase-locked loop: one row a level, with a phase or without."""

import numpy as np
import pytest

import rsgen
from rsgen.app.cli.check_command import point_faults
from rsgen.data.surface.plausibility import lag_findings
from rsgen.files.signals import Channel
from tests.case_files import GONE, MEASURED, write_small
from tests.measurement.tables import read_planned, write_columns
from tests.surfaces import codes
from tests.virtual import only

MASS, K, K3, C = 1.5, 5920.0, 3e5, 3.8
AMPLITUDE = np.linspace(4e-3, 48e-3, 23)
"""Forces of neighbours at the upper end differ by 4.6 %, less than the runs of a shaker scatter."""


def table(folder, lag: float = 90.0, quantity: str = "displacement"):
    k = K + 0.75 * K3 * AMPLITUDE**2
    cotangent = 1 / np.tan(np.radians(lag))
    omega = (-C * cotangent + np.sqrt((C * cotangent) ** 2 + 4 * MASS * k)) / (2 * MASS)
    force = omega * C * AMPLITUDE / np.sin(np.radians(lag))
    order = {"displacement": 0, "velocity": 1}[quantity]
    columns = (omega / 2 / np.pi, force, AMPLITUDE * omega**order, lag - 90 * order)
    return write_columns(folder / "loop.csv", "frequency,force,response,lag", *columns)


def read(path, **options) -> rsgen.ResponseSurface:
    options = {"phase_known": True, "frequency_unit": "Hz"} | options
    phase = {"phase": "lag", "phase_sense": "lag"} if options["phase_known"] else {}
    unit = "m/s" if options.get("quantity") == "velocity" else "m"
    signals = Channel(amplitude="force", unit="N"), Channel(amplitude="response", unit=unit, **phase)
    return read_planned(path, "frequency", *signals, **options)


def test_each_row_of_a_backbone_is_a_level(tmp_path):
    surface = read(table(tmp_path), control="phase")
    assert (surface.control, len(surface.levels)) == ("phase", 23)
    np.testing.assert_allclose(surface.level, np.abs(surface.force), rtol=1e-9)
    assert [finding.code for finding in surface.findings] == ["phase-lag"]
    found = rsgen.identify(surface, "k*x + k3*x**3 + c*v", mass=MASS)
    assert found["k"].value == pytest.approx(K, rel=1e-4)
    assert found["k3"].value == pytest.approx(K3, rel=0.01)


def test_without_a_phase_the_loop_is_trusted_and_that_is_said(tmp_path):
    surface = read(table(tmp_path), phase_known=False, control="phase")
    assert surface.phase_known
    np.testing.assert_allclose(surface.phase, np.pi / 2)
    assert "phase-lag" in codes(surface)
    modal = rsgen.modal_table(surface, mass=MASS)
    np.testing.assert_allclose(modal.stiffness, K + 0.75 * K3 * modal.amplitude**2, rtol=1e-4)
    np.testing.assert_allclose(modal.damping, C, rtol=1e-4)


def test_points_at_which_the_loop_lost_the_lock_are_named_and_doubted(tmp_path):
    path = table(tmp_path)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)[::2]
    assert "phase-lock-lost" not in codes(read(path, control="phase"))
    rows[6::2, 3] = [160, 47, 163]
    rows[6::2, 2] *= [0.4, 1.1, 0.35]
    write_columns(path, "frequency,force,response,lag", *rows.T)
    surface = read(path, control="phase")
    said = only(surface, "phase-lock-lost")
    assert (said["lost"], said["points"]) == (3, 12)
    assert np.degrees([said["low"], said["high"]]) == pytest.approx([47, 163], abs=0.5)
    assert rsgen.identify(surface, "k*x + k3*x**3 + c*v", mass=MASS).verdict.state != "identified"


def test_a_velocity_that_is_read_as_displacement_is_doubted(tmp_path):
    assert "phase-not-resonant" in codes(read(table(tmp_path, quantity="velocity"), control="phase"))
    right = read(table(tmp_path, quantity="velocity"), quantity="velocity", control="phase")
    assert "phase-not-resonant" not in codes(right)


CASE = {
    **MEASURED, "test.file": "loop.csv", "test.control": "phase", "test.frequency": {"column": "frequency"},
    "test.force": {"amplitude": "force"},
    "test.response": {
        "quantity": "displacement", "amplitude": "response", "phase": "lag", "phase_sense": "lag",
    },
}  # fmt: skip


@pytest.mark.parametrize(("changes", "refused"), [
    ({"element.1.force": "k*x + k3*x**3 + c*v"}, True), ({"system": {"mass": "1.5 kg"}}, False),
    ({"element.1.force": "k*x + c*v + masing(Min(kt*x, Fs))"}, False),
    ({"model": "rank", "element": GONE}, True),
])  # fmt: skip
def test_what_a_backbone_does_not_determine_is_refused_before_the_run(tmp_path, changes, refused):
    surface = read(table(tmp_path))
    faults = point_faults(rsgen.load_case(write_small(tmp_path, "loop", CASE | changes)), surface)
    assert bool(faults) == refused
    assert all("phase resonance" in fault for fault in faults)


def at_lags(lag: np.ndarray) -> rsgen.ResponseSurface:
    """Points of a linear mode, 90 N s/m and so 0.1 of critical, that a loop held at these lags [degrees]."""
    omega = np.sqrt(K / MASS) * np.ones(len(lag))
    level = np.linspace(1.0, 3.0, len(lag))
    response = 1e-3 * level * np.exp(-1j * np.radians(lag))
    return rsgen.ResponseSurface(level, omega / 2 / np.pi, level, response, control="phase")


def test_the_shift_of_a_lag_is_that_of_the_stiffness_it_hides():
    # k - m omega^2 = omega c cot(lag): k/m is off by 2 zeta cot(lag) omega^2, here said over zeta
    (said,) = [f for f in lag_findings(at_lags(np.full(12, 96.0))) if f.code == "phase-lag"]
    assert said["shift"] == pytest.approx(2 / np.tan(np.radians(84.0)), rel=1e-9)
    assert said["lag"] == pytest.approx(np.radians(96.0))


def test_the_lag_of_a_loop_is_that_of_most_of_its_points():
    (said,) = [f for f in lag_findings(at_lags(np.repeat([83.0, 96.0], [12, 4]))) if f.code == "phase-lag"]
    assert (said["lag"], said["points"], said["others"]) == pytest.approx((np.radians(83.0), 12, 4))
