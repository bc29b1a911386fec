"""Channels of the SDyPy family (SEP 5), in and out, against the family's own check."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rsgen.common.errors import MeasurementError
from rsgen.data.history import TimeHistory, from_sep5, to_sep5

ROUND_OFF = 1e-15
TIME = np.arange(400) / 200
FORCE = 3.0 * np.cos(30 * TIME)
MOTION = 2e-3 * np.sin(30 * TIME)
POUND = 0.45359237 * 9.80665


def channels(**second: Any) -> list[dict[str, Any]]:
    """Force in pounds and response as ``second`` says."""
    return [
        {"data": FORCE / POUND, "fs": 200, "name": "load", "unit_str": "lbf", "unit_tex": "lbf"},
        {"data": MOTION, "fs": 200.0, "name": "x", "unit_str": "m", "site": "wing"} | second,
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unit", "size", "quantity"),
    [
        ("µm", 1e-6, "displacement"), ("in", 0.0254, "displacement"), ("mm/s", 1e-3, "velocity"),
        ("m/s²", 1.0, "acceleration"), ("g", 9.80665, "acceleration"), ("mm/s^2", 1e-3, "acceleration"),
    ],
)  # fmt: skip
def test_units_say_what_a_channel_is(unit: str, size: float, quantity: str) -> None:
    found = from_sep5(channels(data=MOTION / size, unit_str=unit), "x", "load", level=3.0)
    assert (found.quantity, found.rate, found.level) == (quantity, 200.0, 3.0)
    np.testing.assert_allclose(found.response, MOTION, rtol=4 * ROUND_OFF)
    np.testing.assert_allclose(found.reference, FORCE, rtol=4 * ROUND_OFF)


def test_what_goes_out_keeps_to_the_proposal_and_comes_back() -> None:
    sep005 = pytest.importorskip("sdypy_sep005.sep005", reason="no sdypy-sep005 here: install rsgen[test]")
    history = TimeHistory(200, FORCE, MOTION, "velocity")
    out = to_sep5(history)
    sep005.assert_sep005(out)
    sep005.assert_sep005(channels())
    back = from_sep5(out, "velocity", "force")
    assert (back.rate, back.quantity) == (200.0, "velocity")
    np.testing.assert_array_equal(back.reference, FORCE)
    np.testing.assert_array_equal(back.response, MOTION)
    assert [channel["name"] for channel in to_sep5(TimeHistory(200, None, MOTION))] == ["displacement"]


def test_instants_in_place_of_a_rate_and_a_matrix_of_one_row() -> None:
    changed = {"fs": None, "time": TIME + 3.0, "data": MOTION[None]}
    found = from_sep5(channels(**changed), "x")
    assert found.rate == pytest.approx(200, rel=1e-12)
    assert (found.start, found.force) == (3.0, None)
    np.testing.assert_array_equal(found.response, MOTION)


@pytest.mark.parametrize(
    ("second", "reason"),
    [
        ({"fs": None}, "channel 2: fs or time is missing"),
        ({"fs": -1}, "fs: -1; a positive number"),
        ({"fs": 100}, "were not sampled together: 200 and 100 Hz"),
        ({"fs": None, "time": TIME + 1}, "were not sampled together: .*begun at 0 and 1 s"),
        ({"start_timestamp": "2024-01-01T00:00:01"}, "were not sampled together"),
        ({"time": TIME[:-1]}, "time of shape"),
        ({"time": TIME**2}, "is off the even spacing"),
        ({"Fs": 200}, "the field 'Fs' is prohibited; write fs"),
        ({"starttimestamp": "x"}, "'starttimestamp' is prohibited; write start_timestamp"),
        ({"unit": "m"}, "the field 'unit' is prohibited"),
        ({"name": "load"}, "name 'load'; a text of its own is needed"),
        ({"name": "y"}, "no channel is called 'x'; known: 'load', 'y'"),
        ({"unit_str": None}, "unit_str is empty; the unit is needed"),
        ({"unit_str": "V"}, "is in 'V'; a displacement, velocity or acceleration is needed"),
        ({"data": np.eye(3)}, "one row of real numbers is needed"),
        ({"data": ["a"] * 400}, "one row of real numbers is needed"),
        ({"data": MOTION * np.nan}, "sample 1 is not finite"),
    ],
)
def test_faults_of_channels(second: dict[str, Any], reason: str) -> None:
    first = channels()[0] | (
        {"start_timestamp": "2024-01-01T00:00:00"} if "start_timestamp" in second else {}
    )
    with pytest.raises(MeasurementError, match=reason):
        from_sep5([first, channels(**second)[1]], "x", "load")


@pytest.mark.parametrize("given", [[], {}, "channels", [1], [{"data": MOTION, "fs": 1, "name": "x"}]])
def test_what_is_no_list_of_channels(given: Any) -> None:
    with pytest.raises(MeasurementError, match="SEP 5: "):
        from_sep5(given, "x")
