"""Time histories: read from any format into evenly sampled SI units, and turned into surfaces."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from rsgen import read, sentence
from rsgen.common.errors import MeasurementError
from rsgen.data.history.record import sampling_rate
from rsgen.files.histories import _record, read_motions
from rsgen.files.inspection import clues
from rsgen.files.inspection.listing import list_contents
from rsgen.files.plan import HistoryRule, LevelRule, MeasuredTest
from rsgen.files.signals import BaseRule, Channel
from rsgen.report.sentences import next_step
from tests.measurement.tables import write_columns

pytestmark = pytest.mark.usefixtures("read_here")

FORMATS = Path(__file__).parents[2] / "cases" / "formats"
# single precision in the files; the method itself is accurate to better than this
SINGLE = 1e-3


def swept(**keys) -> HistoryRule:
    return HistoryRule("swept-sine", **keys)


def history(*files: Path, force="F", response="a", **keys) -> MeasuredTest:
    """Plan to read time histories; a text is the channel of a signal."""
    signals = (Channel(samples=one) if isinstance(one, str) else one for one in (force, response))
    known = {"quantity": "acceleration", "history": swept(rate_column="fs")}
    return MeasuredTest(files, None, *signals, **known | keys)


def read_record(*files: Path, **keys):
    """Return the last history of what ``history`` of the same arguments plans."""
    return read_motions(history(*files, **keys))[0][-1]


def contradictions(record) -> dict[tuple[str, str, str], str]:
    """Return code, severity and parameter of what was found, with its sentence."""
    found = (one for one in record.findings if one.code != "unit-of-file")
    return {(one.code, one.severity, one.parameter): sentence(one) for one in found}


RATE = "fixed-contradicted", "doubt", "rate"

N = 64
T = np.arange(N) / 50.0
FORCE = np.sin(T)
ACCELERATION = np.array([np.cos(T), np.cos(2 * T), np.cos(3 * T)])


def write(path: Path) -> Path:
    if path.suffix == ".csv":
        write_columns(path, "t,F,a", T, FORCE, ACCELERATION[1])
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
        got = read_record(path, history=rule, response=response, level=LevelRule(2.0))
        assert (got.rate, got.level) == (pytest.approx(50, rel=1e-12), 2)
        np.testing.assert_array_equal(got.force, FORCE)
        np.testing.assert_allclose(got.response, ACCELERATION[1] * 9.80665, rtol=1e-15)


def test_instants_in_milliseconds_begin_where_they_say(tmp_path):
    path = write_columns(tmp_path / "a.csv", "t,F,a", 2500 + 20 * np.arange(N), FORCE, FORCE)
    rules = (swept(time="t", unit="ms", start=start) for start in (None, 2.6))
    whole, part = (read_record(path, history=rule) for rule in rules)
    assert (whole.rate, part.rate) == pytest.approx((50.0, 50.0), rel=1e-9)
    assert (whole.start, part.start) == pytest.approx((2.5, 2.6), rel=1e-9)
    assert part.response.tolist() == FORCE[5:].tolist()
    rule = swept(time="t", unit="ms", start=2.6, stop=3.0)
    assert read_record(path, history=rule).response.tolist() == FORCE[5:26].tolist()
    with pytest.raises(MeasurementError, match="nothing between start and stop"):
        read_record(path, history=swept(time="t", start=9000.0))


@pytest.mark.parametrize(("title", "unit", "rate", "found"), [
    ("t_ms", None, 50.0, ["unit-of-file"]), ("t [ms]", "ms", 50.0, []), ("t", None, 0.05, []),
    ("t [s]", "ms", 50.0, ["unit-contradicts-title"]), ("t [ms]", "s", 0.05, ["unit-contradicts-title"]),
    ("t [min]", None, 0.05 / 60, ["unit-of-file"]),
])  # fmt: skip
def test_instants_have_the_unit_of_the_case_or_of_the_file(tmp_path, title, unit, rate, found):
    path = write_columns(tmp_path / "a.csv", f"{title},F [N],a [m/s^2]", 20 * np.arange(N), FORCE, FORCE)
    keys = {"force": "F [N]", "response": "a [m/s^2]", "history": swept(time=title, unit=unit)}
    got = read_record(path, **keys)
    assert got.rate == pytest.approx(rate, rel=1e-9)
    assert [finding.code for finding in got.findings] == found
    assert all(sentence(one) for one in got.findings)


def test_a_rate_beside_instants_must_be_theirs(tmp_path):
    # a step of 1/64 s, rounded to hundredths, with two samples missing where asked
    def read(rate, missing=0):
        instants = np.round([(i + missing * (i > 30)) / 64 for i in range(N)], 2)
        path = write_columns(tmp_path / "a.csv", "t,F,a", instants, FORCE, FORCE)
        return read_record(path, history=swept(time="t", rate=rate)).rate

    assert read(64.0) == 64.0
    with pytest.raises(MeasurementError, match=r"64.* instants a second, the rate is 50 Hz"):
        read(50.0)
    with pytest.raises(MeasurementError, match=r"the rate is 64 Hz: off by up to 0\.0\d+ s;"):
        read(64.0, missing=2)
    with pytest.raises(MeasurementError, match="give the rate, too, where the time stamps are only rounded"):
        read(None)
    with pytest.raises(MeasurementError, match="off the even spacing"):
        sampling_rate(np.array([0.0, 1e308, 1e-323]), "t")


@pytest.mark.parametrize(("title", "step", "rate", "doubted"), [
    ("t [s]", 1 / 64, 64.0, False), ("zeit_ms", 1000 / 64, 64.0, False), ("zeit_ms", 1000 / 64, 32.0, True),
    ("time", 1000 / 64, 64.0, False), ("time", 1 / 64, 128.0, True), ("t [s]", 0.0, 16.0, False),
    ("level", 1 / 64, 16.0, False),
])  # fmt: skip
@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_a_rate_that_an_unread_time_contradicts_is_doubted(tmp_path, title, step, rate, doubted, ending):
    path = tmp_path / f"a{ending}"
    # instants have three decimals, and a clock that is read late
    time = np.round(step * (np.arange(N) + 0.02 * FORCE), 3)
    if ending == ".csv":
        write_columns(path, f"{title},F,a", time, FORCE, FORCE)
    else:
        # a unit in brackets is of a text
        np.savez(path, **{title.removesuffix(" [s]"): time, "F": FORCE, "a": FORCE})
    found = contradictions(read_record(path, history=swept(rate=rate)))
    assert [*found] == [RATE] * doubted
    if doubted:
        assert re.search(rf"read at a rate of {rate:g} Hz.* it is 6\d\.?\d* Hz", found[RATE])


@pytest.mark.parametrize(("name", "value", "doubted"), [
    ("fs", 64.0, False), ("fs", 128.0, True), ("SampleRate", 128.0, True), ("fs", 0.064, False),
    ("fsamp", 128.0, True), ("dt", 1 / 64, False), ("dt", 1 / 128, True), ("sweep_rate", 0.1, False),
    ("frame_rate", 128.0, False), ("calibrated", 1.0, False), ("sampling_period", 1 / 128, True),
    ("sampling_points", 128, False),
])  # fmt: skip
def test_a_rate_that_a_number_in_the_file_contradicts_is_doubted(tmp_path, name, value, doubted):
    np.savez(tmp_path / "b.npz", F=FORCE, a=ACCELERATION[1])
    np.savez(tmp_path / "a.npz", F=FORCE, a=ACCELERATION[0], **{name: value})
    levels, rule = LevelRule(values=(1.0, 2.0)), swept(rate=64.0)
    found = contradictions(read_record(tmp_path / "b.npz", tmp_path / "a.npz", level=levels, history=rule))
    assert [*found] == [RATE] * doubted
    if doubted:
        assert f"a rate of 64 Hz, but by {name} in the file it is 128 Hz" in found[RATE]


@pytest.mark.parametrize(("unit", "rate", "number", "doubted"), [
    ("s", 64.0, 128.0, True), ("s", 64.0, 0.064, False), ("ms", 2048.0, 2048.0, True),
])  # fmt: skip
def test_instants_that_a_rate_in_the_file_contradicts_are_doubted(tmp_path, unit, rate, number, doubted):
    np.savez(tmp_path / "a.npz", F=FORCE, a=ACCELERATION[0], time=np.arange(N) / rate, fs=number)
    got = read_record(tmp_path / "a.npz", history=swept(time="time", unit=unit))
    assert [f.parameter for f in got.findings if f.code == "fixed-contradicted"] == ["rate"] * doubted


@pytest.mark.parametrize(("texts", "given", "doubted"), [
    ({"unit": "V, V"}, {}, True), ({"units": "N, V"}, {}, True), ({"units": "N, g"}, {}, False),
    ({"unit": "V, V"}, {"factor": "100 mV/g"}, False), ({"unit": "V"}, {}, True),
])  # fmt: skip
@pytest.mark.parametrize("place", ["data[2]", "data[:,2]"])
def test_volts_that_are_read_as_a_motion_are_doubted(tmp_path, texts, given, doubted, place):
    channels = {"data": np.column_stack([FORCE, ACCELERATION[0]]), "fs": 50.0}
    scipy.io.savemat(tmp_path / "a.mat", channels | texts | {"channels": "force cell, accelerometer"})
    force = Channel(samples="data[1]", unit="V", factor="10 mV/N")
    response = Channel(samples=place, **{"unit": "V" if given else "g"} | given)
    got = read_record(tmp_path / "a.mat", force=force, response=response)
    said = [sentence(finding) for finding in got.findings if finding.code == "unit-contradicts-title"]
    assert len(got.findings) == len(said) == doubted
    if doubted:
        assert "data[2], accelerometer [V] is read in g, but the file says V" in said[0]
        assert 'write unit = "V", and as factor the sensitivity' in next_step(got.findings[0])


@pytest.mark.parametrize(("text", "units", "doubted"), [
    ("g", ("g", "m/s^2"), 0), ("m/s²", ("g", "g"), 2), ("V", ("g", "g"), 0), ("g", (None, None), 2),
])  # fmt: skip
def test_a_unit_of_acceleration_for_all_is_compared_and_proposed(tmp_path, text, units, doubted):
    scipy.io.savemat(tmp_path / "a.mat", {"table": FORCE, "top": ACCELERATION[0], "fs": 50.0, "unit": text})
    base = BaseRule(Channel(samples="table", unit=units[0], quantity="acceleration"), "absolute")
    response = Channel(samples="top", unit=units[1])
    got = read_record(tmp_path / "a.mat", force=None, base=base, response=response)
    assert [f.code for f in got.findings if f.severity == "doubt"] == ["unit-contradicts-title"] * doubted
    proposed = {one.path: one.unit for one in clues.readable(list_contents(tmp_path / "a.mat"))}
    unit = "" if text == "V" else text.replace("²", "^2")
    assert proposed == {"table": unit, "top": unit, "fs": ""}


@pytest.mark.parametrize(("start", "cut"), [(0.0, False), (5.0, True)])
def test_a_start_that_cuts_a_decay_is_named(tmp_path, start, cut):
    t = np.arange(0, 20, 1 / 200)
    np.savez(tmp_path / "a.npz", x=1e-3 * np.exp(-0.3 * t) * np.cos(60 * t))
    rule = HistoryRule("ring-down", rate=200.0, start=start)
    got = read_record(tmp_path / "a.npz", force=None, response="x", quantity="displacement", history=rule)
    found = [one for one in got.findings if one.code != "unit-of-file"]
    said = [(one.code, one.severity, round(one["ratio"], 1)) for one in found]
    assert said == [("decay-taken", "warning", 4.5)] * cut


@pytest.mark.parametrize(("quantity", "doubted"), [("displacement", False), ("velocity", True)])
def test_a_title_of_another_quantity_than_the_response_is_a_doubt(tmp_path, quantity, doubted):
    title, rule = "Displacement (mm)", HistoryRule("ring-down", rate=200.0)
    path = write_columns(tmp_path / "a.csv", f"n,{title}", np.arange(N), ACCELERATION[0])
    got = read_record(path, force=None, response=title, quantity=quantity, history=rule)
    assert [f.code for f in got.findings if f.severity == "doubt"] == ["unit-contradicts-title"] * doubted


@pytest.mark.parametrize(("title", "rate", "found"), [
    ("rate [kHz]", 5e4, ["unit-of-file"]), ("fs [kS/s]", 5e4, ["unit-of-file"]), ("fs [1/s]", 50.0, []),
    ("run f_s", 50.0, []), ("dt [ms]", None, []), ("rate [V]", None, []),
])  # fmt: skip
def test_a_rate_has_the_unit_of_its_title_and_one_that_is_none_of_rates_is_refused(
    tmp_path, title, rate, found
):
    path = write_columns(tmp_path / "a.csv", f"{title},F [N],a [m/s^2]", 0 * T + 50, FORCE, FORCE)
    keys = {"force": "F [N]", "response": "a [m/s^2]", "history": swept(rate_column=title)}
    if rate is None:
        refused = f"{path}: '{title}' is in {title[-3:-1].strip('[')}; a sampling rate in Hz or kHz is needed"
        with pytest.raises(MeasurementError, match=f"^{re.escape(refused)}"):
            read_record(path, **keys)
    else:
        got = read_record(path, **keys)
        assert (got.rate, [one.code for one in got.findings]) == (rate, found)


def test_a_signal_that_is_asked_for_again_is_scaled_once(tmp_path):
    test = history(write(tmp_path / "a.npz"), response=Channel(samples="a[2]", factor=9.80665))
    record = _record(test, swept(rate=50.0), 0)
    for _ in range(2):
        np.testing.assert_allclose(record.sum("response", slice(None)), ACCELERATION[1] * 9.80665)


def test_integers_of_a_recorder_are_scaled(tmp_path):
    counts = np.round(32767 * FORCE).astype("i2")
    np.savez(tmp_path / "a.npz", F=counts, a=counts.astype("i4"), fs=50.0)
    got = read_record(tmp_path / "a.npz", force=Channel(samples="F", factor=0.5))
    assert got.force.dtype == np.float32
    assert (got.force.tolist(), got.response.tolist()) == ((counts * 0.5).tolist(), counts.tolist())


@pytest.mark.slow
@pytest.mark.parametrize(("keys", "message"), [
    ({}, "name one channel, as in 'a[1]'"), ({"response": "F"}, "is force and response"),
    ({"response": "fs"}, "samples differ in number: 64 of 'F', 1 of 'fs'"),
    ({"response": "a[1]", "history": swept(rate_column="t")}, "no sampling"),
    ({"response": "a[1]", "history": swept(time="F")}, " off the even spacing"),
])  # fmt: skip
def test_faults_of_histories(tmp_path, keys, message):
    path = write(tmp_path / "a.mat")
    with pytest.raises(MeasurementError, match=f"^{re.escape(str(path))}: .*{re.escape(message)}"):
        read_record(path, **keys)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "damping"), [("mat-sweep", 7.5), ("hdf5-steps", 7.5), ("uff-decay", 1.2)])
def test_histories_give_the_curves_they_were_made_with(name, damping):
    surface = read(FORMATS / f"{name}.toml")
    surface = surface.select(surface.settled)
    dynamic = surface.force / surface.harmonics[:, 1]
    stiffness = 5920 + 0.75 * 2e6 * surface.amplitude**2
    assert len(surface) > 10
    np.testing.assert_allclose(dynamic.real + 1.5 * surface.omega**2, stiffness, rtol=SINGLE)
    # c is identifiable near resonance; elsewhere it is the small part of a large force
    near = np.abs(dynamic.imag) > 0.3 * np.abs(dynamic)
    np.testing.assert_allclose((dynamic.imag / surface.omega)[near], damping, rtol=5 * SINGLE)
