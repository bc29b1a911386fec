"""Frequency responses as universal files: read again by pyuff and by rsgen, in SI."""

from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.analysis.export import save_frf
from rsgen.files.sandbox import read_binary

FORMATS = Path(__file__).parents[1] / "cases" / "formats"
# 13 digits of a response are written, and as many of a frequency as its 13 columns hold
RESPONSE, FREQUENCY = 1e-12, 1e-9
LEVELS = (1.0, 3.0)


def two_levels() -> rsgen.ResponseSurface:
    """Up at one level and down at the other, at uneven frequencies, under a force with a phase."""
    frequency = np.concatenate([np.geomspace(8, 12, 30), np.geomspace(13, 7, 25)]) * 1.0000001
    level = np.repeat(LEVELS, (30, 25))
    force = level * np.exp(0.4j) * (1 + 0.01 * np.arange(55))
    omega = 2 * np.pi * frequency
    response = force / (5920 - 1.5 * omega**2 + 7.5j * omega)
    return rsgen.ResponseSurface(level, frequency, force, response, sweep=np.repeat(["up", "down"], (30, 25)))


def test_pyuff_reads_what_was_measured(tmp_path):
    pyuff = pytest.importorskip("pyuff", reason="no pyuff here: install rsgen[test]")
    surface, path = two_levels(), tmp_path / "a.uff"
    save_frf(path, surface)
    file = pyuff.UFF(str(path))
    assert [int(kind) for kind in file.get_set_types()] == [151, 164, 58, 58]
    system = file.read_sets(1)
    assert (system["units_code"], system["length"], system["force"]) == (1, 1.0, 1.0)
    for number, (level, sweep) in enumerate(zip(LEVELS, ("up", "down"), strict=True), start=2):
        found = file.read_sets(number)
        run = surface.select(surface.level == level)
        run = run.select(np.argsort(run.frequency))
        np.testing.assert_allclose(found["x"], run.frequency, rtol=FREQUENCY)
        np.testing.assert_allclose(found["data"], run.harmonics[:, 1] / run.force, rtol=RESPONSE)
        assert found["id1"].strip() == f"receptance, {level:g} N, {sweep}, measured"
        assert (found["ordinate_axis_units_lab"], found["orddenom_axis_units_lab"]) == ("m", "N")
        assert (found["ordinate_spec_data_type"], found["orddenom_spec_data_type"]) == (8, 13)


@pytest.mark.slow
def test_predicted_curves_are_stable_parts_with_rising_frequencies(tmp_path):
    """A hardening spring bends its curve over: two stable parts, which obey the balance of the law."""
    mass, stiffness, cubic, damping, level = 1.5, 5920.0, 1e7, 7.5, 6.0
    law = {"k": stiffness, "k3": cubic, "c": damping}
    oscillator = rsgen.Oscillator(mass, "k*x + k3*x**3 + c*v", law)
    path = tmp_path / "a.uff"
    save_frf(path, rsgen.predict(oscillator, [level]))
    titles = [line for line in path.read_text().split("\n") if line.startswith("receptance,")]
    assert titles == [f"receptance, 6 N, stable part {n}, predicted" for n in (1, 2)]
    found = read_binary(path, "uff", ["*/abscissa", "*/ordinate"])
    assert [bool((np.diff(channel.values) > 0).all()) for channel in found[0]] == [True, True]
    frequency, receptance = (np.concatenate([channel.values for channel in channels]) for channels in found)
    omega = 2 * np.pi * frequency
    amplitude = level * np.abs(receptance)
    # one harmonic: what the others add to a cubic spring is below a percent here
    balance = 1 / (stiffness + 0.75 * cubic * amplitude**2 - mass * omega**2 + 1j * damping * omega)
    np.testing.assert_allclose(receptance, balance, rtol=0.03)


@pytest.mark.parametrize(
    ("results", "reason"),
    [
        ((), "results: none given"),
        ((7,), "results: int; must be ResponseSurface or Prediction"),
        (
            (rsgen.ResponseSurface(1.0, [9, 10], 1.0, [1, 2], phase_known=False),),
            "surface: the phases were not recorded",
        ),
        (
            (rsgen.ResponseSurface(1.0, [9, 10], 0.0, [1j, 2j]),),
            "surface: has no settled point under a force",
        ),
    ],
)
def test_what_is_no_frequency_response_is_refused(tmp_path, results, reason):
    with pytest.raises(rsgen.RsgenError, match=reason):
        save_frf(tmp_path / "a.uff", *results)
    assert not list(tmp_path.iterdir())
