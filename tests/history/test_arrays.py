"""Records that are refused, and that nothing but a sentence or a surface comes of any arrays."""

import warnings

import numpy as np
import pytest

import rsgen as rs
from rsgen.data.record_set import QUANTITIES

RATE = 500.0
TIME = np.arange(0, 200, 1 / RATE)
SINE = np.cos(20 * np.pi * TIME)
SWEEP = rs.history.TimeHistory(RATE, np.cos(2 * np.pi * (8 + 0.01 * TIME) * TIME), SINE)


@pytest.mark.parametrize(("make", "message"), [
    (lambda h: h.TimeHistory.from_times(TIME**2, SINE, SINE), "sample 2 is .* off the even spacing"),
    (lambda h: h.TimeHistory.from_times(-TIME, SINE, SINE), "does not rise"),
    (lambda h: h.TimeHistory("fast", SINE, SINE), "a number of Hz is needed"),
    (lambda h: h.TimeHistory(RATE, SINE, np.where(TIME == 1, np.nan, SINE)), "sample 501 is not finite"),
    (lambda h: h.TimeHistory(RATE, SINE, 1e40 * SINE), "not finite, or above 1e"),
    (lambda h: h.TimeHistory(RATE, SINE, SINE[1:]), "100000 samples of force, 99999 of response"),
    (lambda h: h.TimeHistory(RATE, SINE[:9], SINE[:9]), "9 samples; at least 16"),
    (lambda h: h.TimeHistory(0.0, SINE, SINE, label="a.csv"), "a.csv: .*rate: 0.0 Hz"),
    (lambda h: h.TimeHistory(RATE, SINE, SINE, level=-1.0), "level: -1.0 N"),
    (lambda h: h.TimeHistory(RATE, SINE, SINE, "strain"), "must be one of displacement"),
    (lambda h: h.TimeHistory(RATE, SINE, SINE + 0j), "floating point"),
    (lambda h: h.TimeHistory(RATE, SINE[:30], np.zeros((30, 2))), "one row of samples"),
    (lambda h: h.TimeHistory(RATE, SINE, SINE, start=np.inf), "start: inf s"),
    (lambda h: h.from_swept_sine(h.TimeHistory(RATE, None, SINE)), "no force"),
    (lambda h: h.from_swept_sine(SWEEP, band=(20.0, 30.0)), "does not pass the band"),
    (lambda h: h.from_swept_sine(SWEEP, bandwidth=9.0), "harmonics of .* mix"),
    (lambda h: h.from_swept_sine(h.TimeHistory(RATE, SINE, SINE)), "no sweep found in the force"),
    (lambda h: h.from_stepped_sine(h.TimeHistory(RATE, 0 * SINE, SINE)), "no step found"),
    (lambda h: h.from_stepped_sine(h.TimeHistory(RATE, SINE, SINE), band=(9, 2)), "lowest, highest"),
    (lambda h: h.from_stepped_sine(h.TimeHistory(RATE, SINE, SINE), harmonics=0), "must be 1 or more"),
    (lambda h: h.from_free_decay(h.TimeHistory(RATE, SINE, SINE), mass=1.0), "force does not end"),
    (lambda h: h.from_free_decay(h.TimeHistory(RATE, None, SINE), mass=1.0), "does not fall by a tenth"),
    (lambda h: h.from_free_decay(h.TimeHistory(RATE, None, 0 * SINE), mass=1.0), "nothing moves"),
])  # fmt: skip
def test_faults_are_sentences(make: object, message: str) -> None:
    with pytest.raises(rs.RsgenError, match=message):
        make(rs.history)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_no_record_ends_in_a_traceback_or_a_warning(seed: int) -> None:
    """Constant, tiny, huge, offset, single-precision and short records give a surface or a sentence."""
    random = np.random.default_rng(seed)
    uses = [rs.history.from_swept_sine, rs.history.from_stepped_sine, rs.history.record_findings]
    uses.append(lambda history: rs.history.from_free_decay(history, mass=1.0))
    for _ in range(40):
        n = int(10 ** random.uniform(1.2, 3.7))
        i, f = np.arange(n), random.uniform(1e-3, 0.5)
        sine = np.cos(2 * np.pi * f * i)
        records = [
            np.zeros(n), np.ones(n), sine, random.normal(size=n), random.integers(-3, 3, n),
            np.cos(np.pi * f * (1 + random.uniform(-1, 1) * i / n) * i), np.where(i < n // 2, sine, 0.0),
            np.sign(sine), np.exp(-20 * i / n) * sine + 1e-3 * random.normal(size=n), np.round(100 * sine),
            np.exp(-5 * i / n) * sine, np.where(i == n // 3, 1.0, 0.0),
        ]  # fmt: skip
        pair = []
        for k in random.integers(0, len(records), 2):
            scale = random.choice([1.0, 1e-12, 1e-30, 1e-300, 1e12, 1e25])
            record = scale * (records[k] + random.choice([0.0, 1.0, 1e4]))
            pair.append(record.astype(np.float32) if 1e-12 <= scale <= 1e12 and seed % 2 else record)
        history = rs.history.TimeHistory(10 ** random.uniform(0, 4), *pair, random.choice(list(QUANTITIES)))
        for use in uses:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    outcome = str(type(use(history)))
                except rs.RsgenError as fault:
                    outcome = str(fault)
            assert outcome.startswith(("time history: ", "<class "))
