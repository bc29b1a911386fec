"""Time histories: read from any format into evenly sampled SI units, and turned into surfaces."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from rsgen.cases.loading import load_case
from rsgen.common.errors import MeasurementError
from rsgen.data.history.record import sampling_rate
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.histories import read_histories
from rsgen.files.plan import HistoryRule, Layout, LevelRule, MeasuredTest
from rsgen.files.signals import Channel

ROOT = Path(__file__).parents[2]
FORMATS = ROOT / "cases" / "formats"
CSV = {
    entry["id"]: entry
    for entry in json.loads((Path(__file__).parents[1] / "corpus" / "csv.json").read_text(encoding="utf-8"))
}
# single precision in the files; the method itself is accurate to better than this
SINGLE = 1e-3


def swept(**keys: Any) -> HistoryRule:
    return HistoryRule("swept-sine", **keys)


def history(*files: Path, force: Any = "F", response: Any = "a", **keys: Any) -> MeasuredTest:
    """Plan to read time histories; a text is the channel of a signal."""
    signals = (Channel(samples=one) if isinstance(one, str) else one for one in (force, response))
    known = {"quantity": "acceleration", "history": swept(rate_column="fs")}
    return MeasuredTest(files, None, *signals, **known | keys)


N = 64
T = np.arange(N) / 50.0
FORCE = np.sin(T)
ACCELERATION = np.array([np.cos(T), np.cos(2 * T), np.cos(3 * T)])


def write(path: Path) -> Path:
    if path.suffix == ".csv":
        rows = [f"{t:.3f},{f:.17g},{a:.17g}" for t, f, a in zip(T, FORCE, ACCELERATION[1], strict=True)]
        path.write_text("\n".join(["t,F,a", *rows]) + "\n", encoding="utf-8")
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {"F": FORCE[None], "a": ACCELERATION, "fs": 50.0, "t": T[:, None]})
    else:
        np.savez(path, F=FORCE, a=ACCELERATION.T, fs=[50.0], t=T)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".mat", ".npz", ".csv"])
def test_histories_come_as_written(tmp_path, ending):
    path = write(tmp_path / f"a{ending}")
    channel = "a" if ending == ".csv" else "a[2]"
    rules = [swept(time="t"), swept(rate=50.0), *([swept(rate_column="fs")] if ending != ".csv" else [])]
    response = Channel(samples=channel, factor=9.80665)
    for rule in rules:
        (got,) = read_histories(history(path, history=rule, response=response, level=LevelRule(2.0)))
        assert got.rate == pytest.approx(50, rel=1e-12)
        assert got.level == 2
        np.testing.assert_array_equal(got.force, FORCE)
        np.testing.assert_allclose(got.response, ACCELERATION[1] * 9.80665, rtol=1e-15)


def test_instants_in_milliseconds_begin_where_they_say(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"{2500 + 20 * i},{f:.17g},{a:.17g}" for i, (f, a) in enumerate(zip(FORCE, FORCE, strict=True))]
    path.write_text("\n".join(["t,F,a", *rows]) + "\n", encoding="utf-8")
    whole, part = (
        read_histories(history(path, history=swept(time="t", unit="ms", start=start)))[0]
        for start in (None, 2.6)
    )
    assert (whole.rate, part.rate) == pytest.approx((50.0, 50.0), rel=1e-9)
    assert (whole.start, part.start) == pytest.approx((2.5, 2.6), rel=1e-9)
    assert part.response.tolist() == FORCE[5:].tolist()
    rule = swept(time="t", unit="ms", start=2.6, stop=3.0)
    assert read_histories(history(path, history=rule))[0].response.tolist() == FORCE[5:26].tolist()
    with pytest.raises(MeasurementError, match="nothing between start and stop"):
        read_histories(history(path, history=swept(time="t", start=9000.0)))


def test_a_rate_beside_instants_must_be_theirs(tmp_path):
    # a step of 1/64 s, rounded to hundredths, with two samples missing where asked
    def read(rate, missing=0):
        rows = [f"{(i + missing * (i > 30)) / 64:.2f},{f:.17g},{f:.17g}" for i, f in enumerate(FORCE)]
        (tmp_path / "a.csv").write_text("\n".join(["t,F,a", *rows]) + "\n", encoding="utf-8")
        (got,) = read_histories(history(tmp_path / "a.csv", history=swept(time="t", rate=rate)))
        return got.rate

    assert read(64.0) == 64.0
    with pytest.raises(MeasurementError, match=r"64.* instants a second, the rate is 50 Hz"):
        read(50.0)
    with pytest.raises(MeasurementError, match=r"the rate is 64 Hz: off by up to 0\.0\d+ s;"):
        read(64.0, missing=2)
    with pytest.raises(MeasurementError, match="give the rate, too, where the time stamps are only rounded"):
        read(None)


def test_integers_of_a_recorder_are_scaled(tmp_path):
    path = tmp_path / "a.npz"
    counts = np.round(32767 * FORCE).astype("i2")
    np.savez(path, F=counts, a=counts.astype("i4"), fs=50.0)
    (got,) = read_histories(
        history(path, force=Channel(samples="F", factor=0.5), response=Channel(samples="a", factor=2.0))
    )
    assert got.force is not None
    assert got.force.dtype == np.float32
    assert got.force.tolist() == (counts * 0.5).tolist()
    assert got.response.tolist() == (counts * 2.0).tolist()


@pytest.mark.slow
@pytest.mark.parametrize(("keys", "message"), [
    ({}, "name one channel, as in 'a[1]'"),
    ({"response": "F"}, "is force and response"),
    ({"response": "fs"}, "samples differ in number: 64 of 'F', 1 of 'fs'"),
    ({"response": "a[1]", "history": swept(rate_column="t")}, "no sampling"),
    ({"response": "a[1]", "history": swept(time="F")}, " off the even spacing"),
])  # fmt: skip
def test_faults_of_histories(tmp_path, keys, message):
    path = write(tmp_path / "a.mat")
    with pytest.raises(MeasurementError) as caught:
        read_histories(history(path, **keys))
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["data-nonmono.csv", "data-jitter.csv"])
def test_uneven_times_are_refused(tmp_path, name):
    path = tmp_path / "a.csv"
    path.write_bytes(base64.b64decode(CSV[name]["input_b64"]))
    rule = HistoryRule("ring-down", time="t")
    test = history(path, force=None, response="x", history=rule, layout=Layout())
    with pytest.raises(MeasurementError, match="off the even spacing"):
        read_histories(test)


def test_instants_beyond_every_number_are_refused():
    with pytest.raises(MeasurementError, match="off the even spacing"):
        sampling_rate(np.array([0.0, 1e308, 1e-323]), "t")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "damping"), [("mat-sweep", 7.5), ("hdf5-steps", 7.5), ("uff-decay", 1.2)])
def test_histories_give_the_curves_they_were_made_with(name, damping):
    test = load_case(FORMATS / f"{name}.toml").test
    assert isinstance(test, MeasuredTest)
    surface = read_measurement(test)
    surface = surface.select(surface.settled)
    dynamic = surface.force / surface.harmonics[:, 1]
    stiffness = 5920 + 0.75 * 2e6 * surface.amplitude**2
    assert len(surface) > 10
    np.testing.assert_allclose(dynamic.real + 1.5 * surface.omega**2, stiffness, rtol=SINGLE)
    # c is identifiable near resonance; elsewhere it is the small part of a large force
    near = np.abs(dynamic.imag) > 0.3 * np.abs(dynamic)
    np.testing.assert_allclose((dynamic.imag / surface.omega)[near], damping, rtol=5 * SINGLE)
