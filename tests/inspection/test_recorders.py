"""Files of recorders: channels, names and units beside the numbers, points of a modal test, sheets."""

import numpy as np
import pytest
import scipy.io
import scipy.signal

from tests.inspection import drafts
from tests.inspection.drafts import FREQUENCY, MASS, OMEGA, RECEPTANCE, is_receptance, read_draft
from tests.measurement.universal_files import response_set, write_sets

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]

RATE = 256.0
TIME = np.arange(int(60 * RATE)) / RATE
FORCE = np.sin(2 * np.pi * (6 * TIME + 4 / 60 * TIME**2))
SYSTEM = ([[0, 1], [-drafts.STIFFNESS / MASS, -drafts.DAMPING / MASS]], [[0], [1 / MASS]])
ACCELERATION = scipy.signal.lsim((*SYSTEM, [SYSTEM[0][1]], [[1 / MASS]]), FORCE, TIME)[1].ravel()


def test_names_and_units_in_structs_of_a_modal_analyser(tmp_path):
    """Of each signal: steps of the abscissa, numbers, the label of their unit, and a record with its name."""
    signals = {}
    named = (("Wing:2:+Z", 0.6 * ACCELERATION, "g"), ("Shaker", FORCE, "N"), ("Wing:1:+Z", ACCELERATION, "g"))
    for number, (name, values, unit) in enumerate(named):
        signals[f"Signal_{number}"] = {
            "x_values": {"start_value": 0.0, "increment": 1 / RATE, "number_of_values": float(len(values))},
            "y_values": {"values": values / (9.80665 if unit == "g" else 1), "quantity": {"label": unit}},
            "function_record": {"name": name},
        }
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, signals)
    tables, _surface, _doubts = read_draft(path)
    assert tables["time"] == {"rate": "256 Hz"}
    assert tables["force"] == {"samples": "Signal_1/y_values/values", "unit": "N"}
    first = {"samples": "Signal_2/y_values/values", "unit": "g"}
    assert first.items() <= tables["channels"]["wing1_z"].items()


def test_channels_without_names_are_not_guessed_silently(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"ch1": FORCE, "ch2": ACCELERATION, "ch3": 0.4 * ACCELERATION, "fs": RATE})
    doubts = drafts.drafted(path).doubts
    assert "TODO: write the path of the force" in doubts["test.force.samples"]
    assert "ch1, ch2, ch3" in doubts["test.response.samples"]


def modal_file(path, points: list[tuple[int, int, float]], titles: tuple[str, ...] = ()):
    """Write accelerances at nodes and directions, times a number; without titles each is called "a"."""
    named = [{"rsp_ent_name": name, "ref_ent_name": name} for name in ("NONE", "WING")]
    sets = [
        response_set(
            FREQUENCY, -(OMEGA**2) * share * RECEPTANCE, rsp_node=node, rsp_dir=direction, id1=title,
            ref_node=7 * bool(node), ref_dir=3 * bool(node), **named[bool(node)],
        )
        for (node, direction, share), title in zip(points, titles or "a" * len(points), strict=True)
    ]  # fmt: skip
    return write_sets(path, *sets)


@pytest.mark.parametrize(("points", "left_out"), [
    ([(1, 3, 1.0), (2, 3, 0.6), (3, -3, -0.3)], "left out: WING 2 +Z, WING 3 -Z;"),
    ([(1, 3, 1.0), (1, 1, 0.6)], "left out: WING 1 +X;"),
    ([(1, 3, 1.0), (2, 3, 0.6), (1, 3, 1.1), (2, 3, 0.7)], "left out: WING 2 +Z and 1 more of this point;"),
    ([(1, 3, 1.0), (1, 3, 1.0), (1, 3, 1.0)], ""),
])  # fmt: skip
def test_points_of_a_modal_test_are_no_levels(tmp_path, points, left_out):
    tables, surface, doubts = read_draft(modal_file(tmp_path / "a.uff", points))
    if left_out:
        assert doubts["test.response.complex"].startswith(left_out)
        assert tables["response"]["complex"] == "1/ordinate"
        assert "value" in tables["level"]
        assert is_receptance(surface)
    else:
        assert tables["response"]["complex"] == "*/ordinate"
        assert len(tables["level"]["values"]) == len(points)


def test_levels_are_read_from_the_titles_of_functions(tmp_path):
    path = modal_file(tmp_path / "a.uff", [(0, 0, 1.0)] * 2, ("receptance, 2 N", "receptance, 10 N"))
    tables, surface, doubts = read_draft(path)
    assert tables["level"] == {"values": ["2 N", "10 N"], "scale": "peak"}
    assert "titles" in doubts["test.level.values"]
    assert surface.levels.tolist() == [2.0, 10.0]
    assert is_receptance(surface)
