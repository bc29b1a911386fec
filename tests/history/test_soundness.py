"""A record whose samples are cut off or missing says so; a good one, however coarse, does not."""

import numpy as np
import pytest

from rsgen.data.history import TimeHistory, record_findings

RATE = 1024.0
TIME = np.arange(60 * 1024) / RATE
# a sweep with a resonance, silent at both ends
ENVELOPE = 1 / np.hypot(1 - (TIME / 30) ** 2, 0.05)
LIVE = (TIME > 3) & (TIME < 55)
FORCE = np.where(LIVE, np.sin(2 * np.pi * (10 * TIME + 0.1 * TIME**2)), 0.0)
RESPONSE = np.where(LIVE, ENVELOPE * np.sin(2 * np.pi * (10 * TIME + 0.1 * TIME**2) - 1), 0.0)


def found(response: np.ndarray, force: np.ndarray | None = FORCE):
    return record_findings(TimeHistory(RATE, force, response, "acceleration", label="a.mat"))


@pytest.mark.parametrize("bits", [8, 12, 16, 24])
@pytest.mark.parametrize("force", [FORCE, None])
def test_good_records_are_not_remarked(bits: int, force: np.ndarray | None) -> None:
    step = 2 * np.abs(RESPONSE).max() / 2**bits
    steady = np.where(LIVE, np.sin(2 * np.pi * 10.01 * TIME), 0.0)
    for record in (RESPONSE, steady, steady * 0.1 * np.abs(RESPONSE).max()):
        coarse = np.round(record / step) * step
        assert found(coarse, force) == ()
        assert found(coarse.astype(np.float32), force) == ()


@pytest.mark.parametrize("limit", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_clipped_records_are_found(limit: float, step: float) -> None:
    most = limit * np.abs(RESPONSE).max()
    coarse = np.round(RESPONSE / step) * step if step else RESPONSE
    for cut in (np.clip(coarse, -most, most), np.minimum(coarse, most), np.maximum(coarse, -most)):
        (finding,) = found(cut)
        assert (finding.code, *finding.names.values()) == ("range-reached", "a.mat", "response")
        clipped = np.count_nonzero(np.isin(cut, (most, -most)))
        # tops of one or two samples are no flat ones
        assert 0.9 * clipped < finding["samples"] <= clipped
        assert finding.numbers["limit"] == (np.abs(cut[np.isin(cut, (most, -most))]).max(), "m/s^2")
    assert found(RESPONSE, np.clip(FORCE, -0.8, 0.8))[0].names["signal"] == "force"


def test_a_response_that_stands_still_is_found() -> None:
    broken = RESPONSE.copy()
    broken[20 * 1024 : 21 * 1024] = 0.0
    broken[40 * 1024 : 40 * 1024 + 100] = broken[40 * 1024]
    (finding,) = found(broken)
    assert finding.code == "response-stands-still"
    assert finding["times"] == 2
    assert finding["begin"] == pytest.approx(20, abs=2 / RATE)
    assert finding["length"] == pytest.approx(1, abs=2 / RATE)
    assert found(broken, None) == ()
