"""What is no steady sine is refused with the reason, or doubted; noise of an ordinary test is neither."""

import numpy as np
import pytest

from rsgen.common.errors import MeasurementError
from rsgen.data.history import TimeHistory, from_stepped_sine, from_swept_sine
from tests.history.test_decay import RATE, response_to
from tests.surfaces import severities

TIME = np.arange(0, 120, 1 / RATE)
RANDOM = np.random.default_rng(7).normal(size=(2, len(TIME)))
STEPS = np.cos(np.cumsum(2 * np.pi * np.repeat(np.linspace(9.5, 10.5, 10), len(TIME) // 10)) / RATE)
SWEEP = np.cos(2 * np.pi * (8 + 4 / 240 * TIME) * TIME)
READERS = {"stepped": from_stepped_sine, "swept": from_swept_sine}
BLOWS = sum(300 * np.exp(-(((TIME - at) / 0.004) ** 2)) for at in (5, 40, 80))
PHASES = np.random.default_rng(1).uniform(0, 2 * np.pi, 140)
MULTISINE = sum(np.cos(2 * np.pi * k / 12 * TIME + phase) for k, phase in enumerate(PHASES, start=60))


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("force", [
    RANDOM[0], np.tile(RANDOM[0, :1000], len(TIME) // 1000), MULTISINE, BLOWS,
], ids=["white", "periodic noise", "multisine", "blows"])  # fmt: skip
def test_what_is_no_sine_is_refused(reader: str, force: np.ndarray) -> None:
    with pytest.raises(MeasurementError, match=r'blow.*"ring-down".*"multisine".*random force'):
        READERS[reader](TimeHistory(RATE, force, response_to(force)))


DRIVES = pytest.mark.parametrize(("reader", "force"), [("stepped", STEPS), ("swept", SWEEP)])


@DRIVES
@pytest.mark.parametrize(("noise", "offset"), [(0.01, 0.6), (0.03, 0.0)])
def test_an_ordinary_test_is_not_doubted(reader: str, force: np.ndarray, noise: float, offset: float) -> None:
    x = response_to(force)
    history = TimeHistory(RATE, force + offset + noise * RANDOM[0], x + noise * np.std(x) * RANDOM[1])
    found = severities(READERS[reader](history))
    assert "power-not-at-lines" not in found
    assert "doubt" not in found.values()


@DRIVES
def test_a_response_that_does_not_answer_the_force_is_a_doubt(reader: str, force: np.ndarray) -> None:
    assert severities(READERS[reader](TimeHistory(RATE, force, RANDOM[1])))["power-not-at-lines"] == "doubt"
