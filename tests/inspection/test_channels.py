"""Several sensors, a driven base, a force with its phase: columns as laboratories name them, in any order."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rsgen.common.errors import RsgenError
from rsgen.files.inspection.clues import TODO
from rsgen.files.inspection.proposal import propose
from rsgen.files.tree import Contents, Entry
from tests.inspection import drafts
from tests.inspection.drafts import FREQUENCY, OMEGA, RECEPTANCE, is_receptance, read_draft, write_table

G = 9.80665
SHAPES = {"one": 1.0, "two": 0.6 * np.exp(0.02j), "three": -0.3}
"""Motion of each sensor over that of the first; the last one is on the other side of a node."""


def force(level: float) -> np.ndarray:
    """A force that drops at the resonance, with a phase of its own, as a channel of an analyser has."""
    return level * (1 - 0.3 * np.exp(-((FREQUENCY - 10) ** 2))) * np.exp(0.4j + 0.05j * FREQUENCY)


def acceleration(sensor: str, level: float) -> np.ndarray:
    return -(OMEGA**2) * SHAPES[sensor] * RECEPTANCE * force(level)


def polar(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.abs(values), np.angle(values, deg=True)


def parts(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return values.real, values.imag


@dataclass
class Titles:
    """Titles of a program: force, and what it calls sensors; ``parts`` are its titles of one channel."""

    frequency: str
    force: str
    sensors: dict[str, str]
    parts: tuple[str, str]
    unit: str = "g"
    delimiter: str = ";"

    def columns(self, level: float) -> dict[str, np.ndarray]:
        signals = {(self.force, "N"): force(level)}
        scale = {"g": 1 / G, "m/s²": 1.0, "m/s^2": 1.0, "mm/s": 1e3, "mm": 1e3}[self.unit]
        order = {"mm/s": 1, "mm": 2}.get(self.unit, 0)
        for name, called in self.sensors.items():
            signals[called, self.unit] = scale * acceleration(name, level) / (1j * OMEGA) ** order
        columns = {self.frequency: FREQUENCY}
        in_parts = "im" in self.parts[1].casefold()
        for (called, unit), values in signals.items():
            pair = parts(values) if in_parts else polar(values)
            for title, numbers in zip(self.parts, pair, strict=True):
                columns[title.format(called, unit)] = numbers
        return columns


def called(name: str, *places: str) -> dict[str, str]:
    return dict(zip(SHAPES, (name.format(place) for place in places), strict=False))


LABORATORIES = {
    "phase first": Titles(
        "Frequency (Hz)", "Force", called("{}", "Wing", "Payload", "Pylon"),
        ("Amplitude {} ({})", "Phase {} (°)"),
    ),
    "vibrometer": Titles(
        "Frequency [ Hz ]", "Ref1 Force", called("Vib {}", "Velocity 1", "Velocity 2"),
        ("{} Magnitude [ {} ]", "{} Phase [ ° ]"), "mm/s", delimiter="\t",
    ),
    "modal": Titles(
        "Linear [Hz]", "FORC:1:+Z", called("WING:{}:+Z", "1", "2", "17"),
        ("Real {} [{}]", "Imaginary {} [{}]"), "m/s²",
    ),
    "din": Titles("f/Hz", "F", called("X{}", "1", "2"), ("|{}|/{}", "arg({})/deg"), "mm", delimiter=","),
    "script": Titles("freq_hz", "f", called("a{}", "1", "2", "3"), ("{}_re_{}", "{}_im_{}"), delimiter=","),
    "camels": Titles("freqHz", "force", called("acc{}", "Tip", "Root"), ("{}Amp [{}]", "{}Phase [deg]")),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", LABORATORIES)
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_columns_of_one_sensor_find_each_other(tmp_path, name, seed):
    """Whatever the order, force and response are read with their own phases: the receptance is exact."""
    titles = LABORATORIES[name]
    path = drafts.write_levels(tmp_path / "a.csv", titles.columns, titles.delimiter, seed)
    tables, surface, doubts = read_draft(path)
    assert doubts["test.response.channels"].startswith("or ")
    # every channel is that of its own sensor
    sensors = {titles.parts[0].format(text, titles.unit): name for name, text in titles.sensors.items()}
    read = {}
    for called, channel in tables["channels"].items():
        keys = ("amplitude", "phase") if "amplitude" in channel else ("real", "imaginary")
        first, second = (channel[key] for key in keys)
        read[called] = sensors.pop(first)
        assert second == titles.parts[1].format(titles.sensors[read[called]], titles.unit)
    assert not sensors
    assert is_receptance(surface, SHAPES[read[tables["response"]["channels"]]])


STATIC = drafts.STIFFNESS + 1j * OMEGA * drafts.DAMPING
TRANSMISSIBILITY = STATIC / (STATIC - drafts.MASS * OMEGA**2)
"""Absolute motion of the mass over that of the base."""


@pytest.mark.parametrize(("base", "mass"), [
    (("Table Mag (g)", "Table Phs (deg)"), ("DUT Mag (g)", "DUT Phs (deg)")),
    (("Re Tisch [g]", "Im Tisch [g]"), ("Re Masse [g]", "Im Masse [g]")),
    (("CTRL1 (g)", "CTRL1 Phase (deg)"), ("RESP2 (g)", "RESP2 Phase (deg)")),
])  # fmt: skip
@pytest.mark.parametrize("seed", [None, 3])
def test_a_driven_base_is_recognised(tmp_path, base, mass, seed):
    levels = base[0].startswith("Table")

    def columns(level: float) -> dict:
        moved = level / G * np.exp(0.3j) * np.ones_like(FREQUENCY)
        split = parts if base[0].startswith("Re ") else polar
        found = {"Frequency [Hz]": FREQUENCY} | ({"Level [g]": level / G} if levels else {})
        for titles, values in ((base, moved), (mass, moved * TRANSMISSIBILITY)):
            found |= dict(zip(titles, split(values), strict=True))
        return found

    tables, surface, doubts = read_draft(drafts.write_levels(tmp_path / "a.csv", columns, ";", seed))
    assert tables["base"].get("amplitude", tables["base"].get("real")) == base[0]
    assert tables["base"]["response"] == "absolute"
    assert "force" not in tables
    assert (tables.get("level") == {"column": "Level [g]"}) is levels
    assert surface.per_mass
    assert is_receptance(surface, drafts.MASS)
    assert doubts["test.base.response"].startswith(f'{TODO}or "relative"')


@pytest.mark.parametrize(("titles", "driven", "asked"), [
    ("base,tip", "base", True), ("table,mass", "base", True), ("Tisch,Masse", "base", True),
    ("base [m/s^2],tip", "base", False), ("shaker [g],tip [g]", "base", False),
    ("shaker,tip", "force", True), ("shaker [V],tip [g]", "force", True), ("f,tip", "force", True),
])  # fmt: skip
def test_a_base_is_told_by_its_name_where_no_unit_stands(tmp_path, titles, driven, asked):
    rows = "\n".join(f"{i / 100},{np.sin(i)},{np.cos(i)}" for i in range(40))
    path = tmp_path / "a.csv"
    path.write_text(f"t [s],{titles}\n{rows}\n", encoding="utf-8")
    found = drafts.drafted(path)
    assert [name for name in ("base", "force") if f"test.{name}" in found.tables] == [driven]
    assert found.tables[f"test.{driven}"]["samples"] == titles.split(",")[0]
    key = "factor" if titles.startswith("shaker [V]") else "unit"
    assert found.doubts.get(f"test.{driven}.{key}", "").startswith(TODO) is asked


@pytest.mark.parametrize(("head", "phase", "place", "said"), [
    # the phase of x1 was not recorded; two directions are no real and imaginary part
    ("f [Hz],F [N],x1 [g],x2 phase [deg]", None, "amplitude", "left out: x2 phase [deg]"),
    ("f_Hz,F_N,x1_g,y1_g,phase_deg", "phase_deg", "phase", "y1_g"),
])  # fmt: skip
def test_a_phase_or_a_part_of_another_channel_is_never_taken(tmp_path, head, phase, place, said):
    def values(level: float) -> tuple[np.ndarray, ...]:
        size, turn = polar(acceleration("one", level))
        return np.abs(force(level)), size, *([0.6 * size] if phase else []), turn

    tables, _surface, doubts = read_draft(write_table(tmp_path / "a.csv", head, values))
    response = tables["response"]
    assert (response["amplitude"], response.get("phase")) == (head.split(",")[2], phase)
    assert response.get("phase_known", True) is bool(phase)
    assert said in doubts[f"test.response.{place}"]


@pytest.mark.parametrize("order", ["{} H{} [N]", "{} {}f [N]", "{} harm. {} [N]"])
def test_harmonics_are_not_taken_for_sensors(tmp_path, order):
    def columns(level: float) -> dict[str, np.ndarray]:
        found = {"f [Hz]": FREQUENCY}
        signals = (("F", "[N]", force(level)), ("a", "[m/s²]", acceleration("one", level)))
        for number, size in ((3, 0.1), (1, 1.0), (2, 0.3)):
            for called, unit, values in signals:
                titles = (order.format(called, number).replace("[N]", part) for part in (unit, "phase [deg]"))
                found |= zip(titles, polar(size * values * np.exp(number * 1j)), strict=True)
        return found

    tables, surface, doubts = read_draft(drafts.write_levels(tmp_path / "a.csv", columns))
    assert tables["force"]["phase"] == order.format("F", 1).replace("[N]", "phase [deg]")
    assert "a table is read at its fundamental" in doubts["test.response.amplitude"]
    assert is_receptance(surface)


MOBILITY = 1j * OMEGA * RECEPTANCE
HEADS = {
    # brackets of the unit amid the title
    "amid": (
        "Frequency (Hz),Force (N) Mag,Force (N) Phase,Acc1 (g) Mag,Acc1 (g) Phase",
        lambda level: (*polar(force(level)), *polar(acceleration("one", level) / G)),
        {"unit": "g"},
    ),
    # no unit at all: the user enters the quantity
    "transfer": (
        "Frequency,H(f) Tip+Z/Shaker+Z real,H(f) Tip+Z/Shaker+Z imag,Coherence,Level",
        lambda level: (*parts(-(OMEGA**2) * RECEPTANCE), 0.99, level),
        {"quantity": "acceleration", "unit": "m/s^2/N", "per_force": True},
    ),
    "estimates": (
        "f_Hz,H1_re,H1_im,H2_re,H2_im,F_N",
        lambda level: (*parts(MOBILITY), *parts(0.4 * MOBILITY), level),
        {"quantity": "velocity", "unit": "m/s/N", "per_force": True},
    ),
    "spectra": (
        "Frequency (Hz),Frequency Response H1(Response;Force) - Real Part [(m/s²)/N],"
        "Frequency Response H1(Response;Force) - Imag Part [(m/s²)/N],Autospectrum(Force) [N]",
        lambda level: (*parts(-(OMEGA**2) * RECEPTANCE), level), {"unit": "(m/s^2)/N", "per_force": True},
    ),
    # a log of readings, with the instants at which they were taken
    "log": (
        "f [Hz],No.,Time [s],Temp [°C],F [N],acc_x [g],acc_x phase [°],gamma2",
        lambda level: (
            np.arange(17), 3.0 * np.arange(17), 20, level,
            *polar(acceleration("one", level) / force(level) * level / G), 0.98,
        ),
        {"unit": "g"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADS)
@pytest.mark.parametrize("seed", [None, 4])
def test_headers_of_other_programs(tmp_path, name, seed):
    head, values, said = HEADS[name]
    path = write_table(tmp_path / "a.csv", head, values, "\t", seed)
    entered = said if "quantity" in said else {}
    assert not entered or "TODO: no unit stands with it" in drafts.drafted(path).doubts["test.response.unit"]
    tables, surface, _ = read_draft(path, response=entered)
    assert said.items() <= tables["response"].items()
    # the first response in the order of the file
    assert is_receptance(surface, 0.4 if "H2_re" in tables["response"].values() else 1)


def test_a_level_in_decibels_is_refused_by_its_title(tmp_path):
    size, phase = polar(RECEPTANCE)
    values = lambda level: (level, 20 * np.log10(level * size * 1e6), phase)  # noqa: E731
    path = write_table(tmp_path / "a.csv", "f_Hz,F_N,x1_dB,phase1_deg", values)
    assert "decibels" in drafts.drafted(path).doubts["test.response.unit"]
    with pytest.raises(RsgenError, match="logarithmic"):
        read_draft(path)


def test_absolute_motion_on_a_base_needs_phases(tmp_path):
    values = lambda level: (level / G, np.abs(level / G * TRANSMISSIBILITY))  # noqa: E731
    path = write_table(tmp_path / "a.csv", "f [Hz],Base Z [g],Tip [g]", values)
    with pytest.raises(RsgenError, match="no phases were recorded"):
        read_draft(path)


MILLI = 1e3 * RECEPTANCE


@pytest.mark.slow
@pytest.mark.parametrize(("real", "imaginary"), [
    ("Re [mm]", "Im [mm]"), ("x_re_mm", "x_im_mm"), ("Re{X} [mm]", "Im{X} [mm]"), ("xRe [mm]", "xIm [mm]"),
    ("ReX/mm", "ImX/mm"), ("Realteil [mm]", "Imaginärteil [mm]"), ("x.r [mm]", "x.i [mm]"),
    ("disp real part (mm)", "disp imag part (mm)"), ("In-phase (mm)", "Quadrature (mm)"),
])  # fmt: skip
@pytest.mark.parametrize("order", [1, -1])
def test_real_and_imaginary_part_of_the_response(tmp_path, real, imaginary, order):
    head = ",".join(["f [Hz]", "F [N]", *[real, imaginary][::order]])
    path = write_table(tmp_path / "a.csv", head, lambda level: [level, *parts(level * MILLI)[::order]])
    tables, surface, _ = read_draft(path)
    assert (tables["response"]["real"], tables["response"]["imaginary"]) == (real, imaginary)
    assert is_receptance(surface)


@pytest.mark.parametrize("titles", [
    ("x@{}N [mm]", "phi@{}N [deg]"), ("x_{}N_mm", "phase_{}N_deg"), ("x_re_mm F={}N", "x_im_mm F={}N"),
])  # fmt: skip
def test_levels_side_by_side_are_read(tmp_path, titles):
    columns = {"f [Hz]": FREQUENCY}
    for level in ("5", "1", "2.5"):
        pair = (parts if "im" in titles[1] else polar)(float(level) * MILLI)
        columns |= zip((title.format(level) for title in titles), pair, strict=True)
    path = tmp_path / "a.csv"
    rows = [";".join(f"{value:.9g}" for value in row) for row in np.transpose([*columns.values()])]
    # a level that ends earlier leaves its cells empty
    rows[-1] = ";".join([*rows[-1].split(";")[:-2], "", ""])
    path.write_text("\n".join([";".join(columns), *rows, ""]), encoding="utf-8")
    tables, surface, _ = read_draft(path)
    assert tables["level"] == {"values": ["5 N", "1 N", "2.5 N"]}
    assert surface.levels.tolist() == [1.0, 2.5, 5.0]
    count = len(FREQUENCY)
    assert [int(np.sum(surface.level == level)) for level in surface.levels] == [count, count - 1, count]
    assert is_receptance(surface)


@pytest.mark.slow
@pytest.mark.parametrize("title", ["phase {}", pytest.param("base acc {}", marks=pytest.mark.thorough)])
def test_a_draft_of_thousands_of_columns_takes_no_time(title):
    names = ["freq", *(title.format(number) for number in range(9000)), "acc tip", "acc root"]
    entries = tuple(Entry(name, (20,), "float64", low=0.0, high=1.0) for name in names)
    begun = time.process_time()
    assert propose(Contents(Path("a.csv"), "csv", entries)) is not None
    # each compared with each: 10 s
    assert time.process_time() - begun < 5
