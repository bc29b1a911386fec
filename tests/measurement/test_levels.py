"""Levels of measured tests: an entry or a run each, labels that are no amounts, held responses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import rsgen
from rsgen import MultisineSpectra, RsgenError, load_surface, save_surface, sentence
from rsgen.data.oscillator import Model, Observation
from rsgen.data.record_set import match_level
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import HistoryRule, LevelRule, MeasuredTest
from rsgen.files.signals import Channel
from rsgen.report.sentences import next_step
from tests.measurement.tables import planned, read_planned, write_columns
from tests.surfaces import severities

pytestmark = pytest.mark.usefixtures("read_here")

FREQUENCY = np.linspace(8, 12, 41)
MASS, STIFFNESS, CUBIC, DAMPING = 1.5, 5920.0, 2e6, 7.5
HELD = np.linspace(1e-3, 12e-3, 8)


def force_at(size, frequency):
    """Force [N] that holds an amplitude [m]; to first order."""
    omega = 2 * np.pi * np.asarray(frequency)
    return size * (STIFFNESS + 0.75 * CUBIC * size**2 - MASS * omega**2 + 1j * omega * DAMPING)


def of_files(tmp_path: Path, forces: dict, sizes: dict[str, float] | None = None, **more):
    """Write a file a run, force and amplitude over frequency (F/1e4 unless given), and plan to read them."""
    for name, force in forces.items():
        size = sizes[name] if sizes else np.abs(force) / 1e4
        write_columns(tmp_path / name, "f,F,X", FREQUENCY, force, size)
    signals = Channel(amplitude="F", unit="N"), Channel(amplitude="X", unit="m")
    return planned(tuple(tmp_path / name for name in forces), "f", *signals, frequency_unit="Hz", **more)


@pytest.mark.slow
def test_each_entry_is_a_level(tmp_path):
    run = np.empty((1, len(HELD)), dtype=[(name, "O") for name in ("f", "F", "X")])
    for place, size in enumerate(HELD):
        run[0, place] = FREQUENCY, force_at(size, FREQUENCY), size * np.exp(1e-3j * np.arange(41))
    scipy.io.savemat(tmp_path / "a.mat", {"run": run})
    force = Channel(complex="run/*/F", phase_sense="lead", unit="N")
    signals = force, Channel(complex="run/*/X", unit="m")
    of_runs = MeasuredTest(tmp_path / "a.mat", "run/*/f", *signals, "displacement", frequency_unit="Hz")
    surface = read_measurement(replace(of_runs, control="response"))
    assert surface.control == "response"
    np.testing.assert_allclose(surface.levels, HELD, rtol=5e-3)
    assert [int(np.count_nonzero(surface.level == level)) for level in surface.levels] == [41] * 8
    assert severities(surface) == {}
    assert len(read_measurement(of_runs).levels) == 8
    assert len(read_measurement(replace(of_runs, level=LevelRule(spread=0.05))).levels) == 14


def test_sweeps_of_one_force_share_a_level(tmp_path):
    arrays = {}
    for name, force in (("0p05g_up", 0.05), ("0p05g_down", 0.0502), ("0p1g_up", 0.0999), ("0p1g_down", 0.1)):
        table = np.column_stack([FREQUENCY, np.full(41, force), np.full(41, force / 10)])
        arrays[f"run_{name}"] = table[:: -1 if "down" in name else 1]
    scipy.io.savemat(tmp_path / "a.mat", arrays)
    signals = Channel(amplitude="run_*[2]", unit="N"), Channel(amplitude="run_*[3]", unit="m")
    plan = planned(tmp_path / "a.mat", "run_*[1]", *signals, frequency_unit="Hz")
    np.testing.assert_allclose(read_measurement(plan).levels, [0.0501, 0.09995], rtol=1e-9)
    given = read_measurement(replace(plan, level=LevelRule(values=(0.05, 0.05, 0.1, 0.1))))
    assert given.levels.tolist() == [0.05, 0.1]
    assert not severities(given)


DOUBT, INFO = {"levels-disagree": "doubt"}, {"levels-disagree": "info"}
SWAPPED = {"levels-swapped": "doubt"}
DIP = 1 - 0.6 * np.exp(-((FREQUENCY - 10) ** 2))
STEPS = np.where(np.abs(FREQUENCY - 10) < 0.5, 0.7, 1.0)
HALF = {"2N.csv": 1.01, "6N.csv": 3.03}
LABELS = {"Level1.csv": 4.8, "Level3.csv": 28.8, "Level4.csv": 58.0}
AS_MEASURED, ALIKE = [4.8, 28.8, 58.0], {"1.csv": 5.0, "3.csv": 5.01, "9.csv": 4.99}


@pytest.mark.parametrize(("forces", "rule", "levels", "said"), [
    # labels are called by what was measured: "Level4" stood for 4 N where the force was 58 N
    (LABELS, {"name": "Level{level}.csv"}, AS_MEASURED, INFO),
    (LABELS, {"values": (1, 3, 4)}, AS_MEASURED, DOUBT),
    (LABELS, {"values": (1, 3, 4), "unit": "label"}, AS_MEASURED, INFO),
    # levels stay where the force falls at the resonance
    ({"2N.csv": 2 * DIP, "5N.csv": 5 * DIP}, {"name": "{level}N.csv"}, [2, 5], {}),
    ({"a.csv": 2 * STEPS, "b.csv": 5 * STEPS}, {}, [2, 5], {}),
    # root mean squares that a case gives
    ({"a.csv": 2**0.5, "b.csv": 18**0.5}, {"values": (1, 3), "scale": "rms"}, [2**0.5, 18**0.5], {}),
    ({"a.csv": 2**0.5, "b.csv": 1.42}, {"value": 1, "scale": "rms"}, [2**0.5], {}),
    # a unit behind the number in a name is that of the level; a length is no force
    ({"a_300mN.csv": 0.3, "a_500mN.csv": 0.5}, {"name": "a_{level}mN.csv"}, [0.3, 0.5], {}),
    ({"gap_1mm.csv": 30.0, "gap_3mm.csv": 50.0}, {"name": "gap_{level}mm.csv"}, [30.0, 50.0], INFO),
    ({"a.csv": 1.5, "b.csv": 1.0, "c.csv": 2.0}, {"values": (1, 1.5, 2)}, [1, 1.5, 2], SWAPPED),
    # several records of one level: a * is any part of the name
    ({"rep1_2N_a": 2.0, "rep2_2N_a": 2.02, "rep1_12N_b": 12.0}, {"name": "rep*_{level}N_*"}, [2, 12], {}),
    # of two numbers the one with a unit is the level
    ({"run3_2N_rep_4_a": 2.0, "run4_3N_rep_1_a": 3.0}, {"name": "run*_{level}*"}, [2, 3], {}),
    ({"2.5kN": 2500, "0p5kN": 500, "4,5kN": 4500}, {"name": "{level}kN", "factor": 1e3},
     [500, 2500, 4500], {}),
    # half a bridge: every force is 0.505 of its level; where no unit is said the numbers may be volts
    (HALF, {"name": "{level}N.csv"}, [1.01, 3.03], DOUBT),
    (HALF, {"name": "{level}N.csv", "unit": "label"}, [1.01, 3.03], INFO),
    # whole numbers may count runs, the highest first; with a unit they are amounts
    ({"r1.csv": 4, "r2.csv": 3, "r3.csv": 2}, {"name": "r{level}.csv", "unit": "label"}, [2, 3, 4], INFO),
    ({"1V": 4, "2V": 3, "3V": 2}, {"name": "{level}V", "unit": "label"}, [2, 3, 4], INFO | SWAPPED),
    # nominal levels 1.7 and 2 times off the force of their files
    ({"a.csv": 1.0, "b.csv": 3.0, "c.csv": 3.5}, {"values": (1, 3, 6)}, [1, 3, 3.5], DOUBT),
    (ALIKE, {"name": "{level}.csv"}, [1, 3, 9], {"levels-of-one-force": "doubt"}),
    (ALIKE, {"name": "{level}.csv", "unit": "label"}, [4.99, 5.0, 5.01], INFO),
])  # fmt: skip
def test_levels_of_files(tmp_path, forces, rule, levels, said):
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(**rule)))
    np.testing.assert_allclose(surface.levels, levels)
    assert severities(surface) == said
    if forces is HALF:
        (found,) = surface.findings
        # of what the case calls labels no ratio: their unit, as volts, may not be one of forces
        assert ("ratio" in found.numbers) == (rule.get("unit") != "label")
        for times in ("0.505 times as much at all levels", "nearly a factor of 2, as"):
            assert (times in sentence(found)) == (said == DOUBT)
        assert next_step(found).startswith("Look for a wrong unit of the force, a sensitivity")


def test_levels_of_a_multisine_are_root_mean_squares_whatever_their_scale():
    record, rule = Channel(samples=1), HistoryRule("multisine", rate=100.0)
    level = LevelRule(values=(1.0, 3.0), scale="rms")
    test = planned(("a", "b"), None, record, record, history=rule, phase_known=True, level=level)
    assert (test.level_values, test.level_factor) == ((1.0, 3.0), 1.0)


@pytest.mark.parametrize(("rule", "said"), [
    # a star could take the digits of the level
    ({"name": "rep*{level}N.csv"}, "right before"), ({"name": "rep*1.{level}N.csv"}, "right before"),
    # the volts of a drive are labels, which cannot stand for a force
    ({"name": "{level}V", "unit": "V"}, r"level.unit: 'V' .* needed; unit = \"label\" where the levels are"),
    ({"values": (1, 3), "unit": "label"}, "stands for the force, which was not recorded"),
])  # fmt: skip
def test_levels_that_cannot_be_are_refused(rule, said):
    with pytest.raises(RsgenError, match=said):
        planned((Path("1V"), Path("2V")), force=None, level=LevelRule(**rule))


def test_of_two_numbers_in_a_name_either_may_be_the_level(tmp_path):
    test = of_files(tmp_path, {"run3_2_rep_4_a": 2.0}, level=LevelRule(name="run*_{level}*"))
    with pytest.raises(RsgenError, match=r"2 or 4 may be the level .* such as its unit"):
        read_measurement(test)


def test_unstable_points_of_a_continuation_are_marked(tmp_path):
    """Above the resonance the force that holds an amplitude falls between two folds."""
    frequency = np.repeat(np.linspace(10.6, 11.8, 6), 24)
    # amplitudes differ a little from one frequency to the next
    size = np.tile(np.linspace(1e-3, 4e-2, 24), 6) * (1 + 0.02 * np.sin(1.7 * np.arange(144)))
    force = np.abs(force_at(size, frequency))
    path = write_columns(tmp_path / "a.csv", "f,F,X", frequency, force, size)
    surface = read_planned(path, "f", "F", "X", control="continuation")
    assert (surface.control, surface.level_unit) == ("continuation", "m")
    stable = np.abs(force_at(1.001 * size, frequency)) > force
    assert np.count_nonzero(~stable) > 12
    # the force turns between two points, of which either may count
    assert np.all((surface.stable != stable).reshape(6, 24).sum(axis=1) <= 2)
    assert np.count_nonzero(~surface.stable & ~stable) > 0.8 * np.count_nonzero(~stable)


# 2 is a label, and the amount of another level
@pytest.mark.parametrize(("asked", "held"), [(1, 2.0), (2, 4.0), (3, 6.0), (6, 6.0)])
def test_a_level_is_held_out_by_its_label(tmp_path, asked, held):
    forces, rule = {"1.csv": 2.0, "2.csv": 4.0, "3.csv": 6.0}, LevelRule(name="{level}.csv", unit="label")
    saved = read_measurement(of_files(tmp_path, forces, level=rule))
    save_surface(tmp_path / "surface.h5", saved)
    for surface in (saved, load_surface(tmp_path / "surface.h5"), saved.select(np.arange(len(saved))[::-1])):
        assert np.unique(surface.level[surface.held_out((asked,))]).tolist() == [held]
    assert saved.find_level(asked) == held
    model = Model("k*x + c*v", observation=Observation(hold_out=(asked,)))
    said = [f for f in rsgen.identify(saved, model).findings if f.code == "held-out-by-label"]
    assert [f["level"] for f in said] == ([held] if asked == 2 else [])


def test_records_are_held_out_by_their_labels():
    lines = np.ones((3, 1, 4), complex)
    spectra = MultisineSpectra([2.0, 4.0, 6.0], 1.0, lines, lines, label=[1, 2, 3])
    assert spectra.select([2, 1, 0]).held_out((1,)).tolist() == [False, False, True]
    # a label may have several amounts, and an amount several labels
    several = MultisineSpectra([1.0, 1.3, 1.0, 5.0], 1.0, lines[[0] * 4], lines[[0] * 4], label=[1, 1, 2, 3])
    assert several.held_out((1.0,)).tolist() == [True, True, False, False]
    # a label within its printed digits, as of a surface; the refusal lists labels
    thirds = replace(spectra, label=np.array([1 / 3, 2 / 3, 1.0]))
    assert thirds.held_out((0.667,)).tolist() == [False, True, False]
    with pytest.raises(RsgenError, match=r"it has 0\.333333 \(2 N\), 0\.666667 \(4 N\), 1 \(6 N\)"):
        thirds.require_levels((9.0,))


def test_levels_of_a_sweep_that_a_mass_corrected_are_not_said_to_be_measured():
    test = rsgen.load_case("cases/formats/mat-sweep.toml").test
    turned = replace(test, response=replace(test.response, factor=-1000.0))
    found = read_measurement(replace(turned, history=replace(test.history, mass=1.5)))
    (said,) = (one for one in found.findings if one.code == "levels-disagree")
    assert "were measured, corrected for the sweep with the given mass of 1.5 kg," in sentence(said)


@pytest.mark.parametrize(("levels", "asked", "meant"), [
    ([2.38636e-09 * (1 + 1.9e-6), 5e-9], 2.38636e-09, 0), ([3.4217, 5.0], 3.42, 0),
    ([3.4217, 3.4229], 3.42, None), ([3.42, 3.4229], 3.42, 0), ([2.6, 5.0], 3.0, None),
    ([0.2994, 0.8008], 0.8, 1), ([0.8008, 0.7994], 0.8, None),
])  # fmt: skip
def test_a_level_is_found_by_the_digits_that_are_printed(levels, asked, meant):
    assert match_level(np.array(levels), asked) == (None if meant is None else levels[meant])
