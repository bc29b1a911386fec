"""Tables of a control-based continuation: stable and unstable points of one surface, read and identified."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsgen
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.controlled import ControlledStates, hold_states
from rsgen.files import MeasuredTest, Signal, read_measurement

MASS, VALUES = 1.5, {"k": 5920.0, "k3": 3e5, "c": 2.0}
LAW = "k*x + k3*x**3 + c*v"
FREQUENCIES, POINTS = np.linspace(9.6, 10.8, 6), 24


@pytest.fixture(scope="module")
def states():
    """S-curves at six frequencies; the amplitudes differ a little from one to the next."""
    frequency = np.repeat(FREQUENCIES, POINTS)
    size = np.tile(np.linspace(3e-3, 6e-2, POINTS), len(FREQUENCIES))
    size = size * (1 + 0.02 * np.sin(1.7 * np.arange(len(size))))
    return hold_states(rsgen.Oscillator(MASS, LAW, VALUES), size, frequency, harmonics=7, order=15)


def read(folder: Path, states: ControlledStates, **options: Any) -> ResponseSurface:
    ratio = states.force / states.harmonics[:, 1]
    table = np.stack(
        [
            np.repeat(FREQUENCIES, POINTS), np.abs(states.force), np.abs(states.harmonics[:, 1]),
            np.degrees(np.angle(ratio)),
        ],
        axis=1,
    )  # fmt: skip
    path = folder / "continuation.csv"
    np.savetxt(path, table, delimiter=",", header="frequency,force,response,lag", comments="")
    plan = MeasuredTest(
        files=path, frequency="frequency", force=Signal(amplitude="force"),
        response=Signal(amplitude="response", phase="lag", phase_sense="lag"), quantity="displacement",
        **options,
    )  # fmt: skip
    return read_measurement(plan)


def test_unstable_points_of_a_fold_are_marked(tmp_path, states):
    surface = read(tmp_path, states, control="continuation")
    assert (surface.control, surface.level_unit) == ("continuation", "m")
    assert np.count_nonzero(~states.stable) > 4
    # the force turns between two points, of which either may count
    rows = (surface.stable != states.stable).reshape(len(FREQUENCIES), POINTS)
    assert np.all(rows.sum(axis=1) <= 2)
    assert np.count_nonzero(~surface.stable & ~states.stable) > 0.8 * np.count_nonzero(~states.stable)
