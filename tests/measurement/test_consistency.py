"""Runs that do not fit together: copies, rows written twice, units that differ, branches in one order."""

from pathlib import Path

import numpy as np
import pytest

from rsgen.common.errors import MeasurementError
from rsgen.data.surface import ResponseSurface
from rsgen.files import MeasuredTest, Signal, SweepRule, read_measurement
from tests.surfaces import severities

FREQUENCY = np.linspace(8, 12, 41)
OMEGA = 2 * np.pi * FREQUENCY
RECEPTANCE = np.abs(1 / (5920 - 1.5 * OMEGA**2 + 7.5j * OMEGA))


def write(path: Path, force: float, response: np.ndarray, frequency: np.ndarray = FREQUENCY) -> Path:
    rows = (f"{f:.6g},{force:.9g},{x:.9g}\n" for f, x in zip(frequency, response, strict=True))
    path.write_text("f,F,x\n" + "".join(rows), encoding="utf-8")
    return path


def read(*paths: Path, sweep: SweepRule = SweepRule()) -> ResponseSurface:  # noqa: B008 - immutable
    signals = Signal(amplitude="F"), Signal(amplitude="x")
    return read_measurement(
        MeasuredTest(paths, "f", *signals, "displacement", phase_known=False, sweep=sweep)
    )


@pytest.fixture
def noisy():
    return RECEPTANCE * (1 + 1e-3 * np.random.default_rng(1).standard_normal(41))


def test_a_copy_in_place_of_another_run_is_doubted(tmp_path, noisy):
    first = write(tmp_path / "a.csv", 1.0, noisy)
    copy = write(tmp_path / "b.csv", 2.0, noisy)
    surface = read(first, copy, write(tmp_path / "c.csv", 5.0, 5 * noisy))
    assert severities(surface) == {"run-repeated": "doubt"}
    assert surface.findings[0].names == {"first": "a.csv", "second": "b.csv"}


def test_a_file_stands_once_in_a_plan(tmp_path, noisy):
    path = write(tmp_path / "a.csv", 1.0, noisy)
    with pytest.raises(MeasurementError, match=r"'a\.csv' stands twice"):
        read(path, path)


def test_rows_written_twice_count_once(tmp_path, noisy):
    path = write(tmp_path / "a.csv", 1.0, np.repeat(noisy, 2), np.repeat(FREQUENCY, 2))
    surface = read(path)
    assert len(surface) == 41
    assert severities(surface) == {"rows-left-out": "warning"}
    assert surface.findings[0]["rows"] == 41


@pytest.mark.parametrize(("hardens", "upper"), [(True, "up"), (False, "down")])
def test_an_upper_branch_is_no_upward_sweep_where_a_mode_softens(tmp_path, hardens, upper):
    """Two files sorted by frequency were called upward sweeps, one the upper branch of a softening mode."""
    high = np.linspace(1, 3, 41) if hardens else np.linspace(3, 1, 41)
    low = np.linspace(0.3, 0.4, 41)
    paths = write(tmp_path / "upper.csv", 1.0, high), write(tmp_path / "lower.csv", 1.0, low)
    surface = read(*paths)
    assert set(surface.sweep[:41]) == {upper}
    assert set(surface.sweep[41:]) == {"down" if upper == "up" else "up"}
    (said,) = [finding for finding in surface.findings if finding.code == "direction-from-branch"]
    assert said["points"] == 41
    assert set(read(*paths, sweep=SweepRule(direction="up")).sweep) == {"up"}
