"""Mistakes in reading a driven base: each is named by what it breaks, whatever the law."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.data.history import SweepLaw
from rsgen.data.surface.plausibility import base_findings
from rsgen.files.plan import HistoryRule, LevelRule
from rsgen.files.signals import BaseRule, Channel
from tests.case_files import MEASURED, Changes, write_small
from tests.measurement.tables import planned, read_planned, write_columns
from tests.oracles.swept import sweep
from tests.surfaces import codes
from tests.virtual import only

pytestmark = pytest.mark.usefixtures("read_here")


def motion(first: int, **keys: object) -> dict[str, object]:
    return {"quantity": "acceleration", "real": first, "imaginary": first + 1, "phase_sense": "lead", **keys}


CASE = {
    **MEASURED, "element": [{"name": "all", "force": "k*x + k3*x**3 + c*v"}], "test.frequency": {"column": 1},
    "test.level": {"column": 2, "unit": "m/s^2"}, "test.base": motion(3), "test.response": motion(5),
}  # fmt: skip
FREQUENCY = np.tile(np.linspace(11, 22, 30), 2)
OMEGA, LEVEL = 2 * np.pi * FREQUENCY, np.repeat([0.3, 1.0], 30)


def answers(recorded: str, turn: np.ndarray | complex = 1) -> tuple[np.ndarray, np.ndarray]:
    """Exact accelerations of the base of a cubic spring per unit mass, and of the mass; turned alike."""
    z = LEVEL * 1e-3 / (1 - (FREQUENCY / 17) ** 2 + 0.15j)
    base = -(1e4 + 0.75 * 2.5e9 * np.abs(z) ** 2 + 2j * OMEGA - OMEGA**2) * z
    return turn * base, turn * (-(OMEGA**2) * z + (base if recorded == "absolute" else 0))


def findings(folder, recorded: str, said: Changes | None = None) -> list:
    """Read the answers; their phases count from a generator, not the base."""
    base, seen = answers(recorded, np.exp(1j * (0.7 + 0.35 * FREQUENCY)))
    write_columns(folder / "a.csv", "", FREQUENCY, LEVEL, base.real, base.imag, seen.real, seen.imag)
    found = rs.read(write_small(folder, "base", {**CASE, "test.base.response": recorded, **(said or {})}))
    return [f for f in found.findings if f.code in ("base-misread", "not-passive", "another-quantity")]


SENSE_OF_BASE, SENSE_OF_RESPONSE = "test.base.phase_sense", "test.response.phase_sense"


@pytest.mark.parametrize("recorded", ["absolute", "relative"])
@pytest.mark.parametrize(("said", "mistake"), [
    ({}, ""), ({SENSE_OF_RESPONSE: "lag"}, "sense-response"), ({SENSE_OF_BASE: "lag"}, "sense-base"),
    ({SENSE_OF_BASE: "lag", SENSE_OF_RESPONSE: "lag"}, "sense-both"),
    ({"test.base": motion(5), "test.response": motion(3)}, "swapped"),
    ({"test.response.factor": -1}, "sign"), ({"test.base.response": "other"}, "reference"),
])  # fmt: skip
def test_what_was_misread_of_a_driven_base_is_named(tmp_path, recorded, said, mistake):
    other = "relative" if recorded == "absolute" else "absolute"
    if "test.base" in said:
        said = {**said, "test.base.response": recorded}
    found = findings(tmp_path, recorded, {k: other if v == "other" else v for k, v in said.items()})
    assert [f.code for f in found] == (["base-misread"] if mistake else [])
    for finding in found:
        assert (finding.names["is"], finding.severity) == (mistake, "error")
        # undone, the equation holds to what four powers of the amplitude and the digits of the file leave
        assert finding["then"] < 1e-6
        if mistake == "reference":
            assert finding.names["response"] == recorded


@pytest.mark.parametrize("recorded", ["absolute", "relative"])
def test_swapped_amplitudes_beside_a_phase_are_named_and_no_mass_is(tmp_path, recorded):
    # the phase of the response, from the base, has a column of its own and stays where it is
    base, seen = answers(recorded)
    columns = (FREQUENCY, LEVEL, np.abs(base), np.abs(seen), np.angle(seen / base, deg=True))
    write_columns(tmp_path / "a.csv", "", *columns)

    def read(first: int, second: int, sense: str) -> rs.ResponseSurface:
        about = {"quantity": "acceleration", "unit": "m/s^2"}
        said = {"test.base": {**about, "amplitude": first, "response": recorded}}
        said["test.response"] = {**about, "amplitude": second, "phase": 5, "phase_sense": sense}
        return rs.read(write_small(tmp_path, "base", {**CASE, **said}))

    assert "base-misread" not in codes(read(3, 4, "lead"))
    found = only(read(3, 4, "lag"), "base-misread")
    assert (found.names["is"], found.names["sign"]) == ("sense-response", "negative")
    assert "%" not in rs.sentence(found)
    swapped = read(4, 3, "lead")
    assert only(swapped, "base-misread").names["is"] == "amplitudes-swapped"
    asked = rs.identify(swapped, "k*x + k3*x**3 + c*v")
    assert asked.verdict.state == "rejected"
    assert "fixed-contradicted" not in codes(asked)


def test_a_reversed_base_below_a_stop_is_named_as_reversed():
    # the largest motion of a spring with a stop at 0.35 mm, per unit mass; powers of the amplitude miss it
    # by 2 %; an exchanged response, so small that any law fits it, looked best, and then another quantity
    frequency, level = np.tile(np.linspace(17, 31, 15), 2), np.repeat([2.0, 4.0], 15)
    omega, size = 2 * np.pi * frequency, np.geomspace(1e-6, 2e-2, 20_000)
    inside = np.fmin(1, 3.5e-4 / size)
    touched = 1 - 2 / np.pi * (np.arcsin(inside) + inside * np.sqrt(1 - inside**2))
    dynamic = 2e4 + 4.6e4 * touched - (omega**2 - 2.93j * omega)[:, None]
    z = [level[i] / row[np.flatnonzero(np.abs(row) * size < level[i])[-1]] for i, row in enumerate(dynamic)]
    seen = np.array(z) + 2 * level / omega**2
    surface = rs.ResponseSurface(level, frequency, -level, seen)
    (found,) = base_findings(surface, absolute=True, senses=False)
    assert (found.code, found.names["is"]) == ("base-misread", "sign")


@pytest.mark.parametrize("recorded", ["absolute", "relative"])
@pytest.mark.parametrize(("factor", "mistake"), [
    (9.80665, "gravity"), (0.001, "milli"), (2**0.5, "rms"), (0.5, "peak-to-peak"),
])  # fmt: skip
def test_a_factor_of_one_channel_against_the_other_is_named(tmp_path, recorded, factor, mistake):
    (found,) = findings(tmp_path, recorded, {"test.response.factor": factor})
    assert (found.code, found.severity, found.names["is"]) == ("base-misread", "error", mistake)
    assert found["by"] * factor == pytest.approx(1, rel=1e-9)
    # what four powers of the amplitude and the digits of the file leave
    assert found["then"] < 1e-5 < found["misfit"]


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_levels_without_a_column_are_amplitudes_of_what_was_measured_of_the_base(tmp_path, quantity):
    # 3 and 10 of the unit of the base, held to a hundredth, at 30 frequencies
    base = 10 * LEVEL * (1 + 0.01 * np.sin(np.arange(60.0)))
    order = {"displacement": 0, "velocity": 1, "acceleration": 2}[quantity]
    force = -base * (1j * OMEGA) ** (2 - order)
    z = force / ((2 * np.pi * 17) ** 2 - OMEGA**2 + 10j * OMEGA)
    path = write_columns(tmp_path / "a.csv", "", FREQUENCY, base, z.real, z.imag, 10 * LEVEL / 2**0.5)
    rule = BaseRule(Channel(amplitude=2, quantity=quantity), "relative")
    response = Channel(real=3, imaginary=4, phase_sense="lead")
    how = {"force": None, "response": response, "phase_known": True, "base": rule}
    surface = read_planned(path, **how)
    assert np.sort(surface.levels) == pytest.approx([3.0, 10.0], rel=0.01)
    # levels that were measured check no unit
    assert only(surface, "not-recorded").names == {"signal": "levels"}
    # those that are given as root mean squares of a motion that was held have one factor
    given = read_planned(path, **how, level=LevelRule(column=5))
    assert only(given, "levels-disagree").names["near"] == "rms"


def test_a_fast_sweep_of_a_base_names_no_mass(tmp_path):
    oscillator = rs.Oscillator(1.0, (rs.make_element("all", "k*x + c*v"),), {"k": 4e3, "c": 1.3})
    got = sweep(oscillator, 1.0, SweepLaw("linear", 7.0, 0.2), 13.0)
    np.savez(tmp_path / "a.npz", base=-got.reference, x=got.response, fs=got.rate)
    rules = {
        "base": BaseRule(Channel(samples="base", quantity="acceleration"), "relative"),
        "history": HistoryRule("swept-sine", rate_column="fs"), "phase_known": True,
    }  # fmt: skip
    surface = read_planned(tmp_path / "a.npz", None, None, Channel(samples="x"), **rules)
    assert "mass" not in only(surface, "sweep-rate").numbers


@pytest.mark.parametrize(("quantity", "size"), [("acceleration", 9.80665), ("displacement", 1.0)])
def test_a_number_before_g_in_a_name_is_an_acceleration_of_the_base(tmp_path, quantity, size):
    base = BaseRule(Channel(amplitude=2, quantity=quantity), "relative")
    level = LevelRule(name="run_{level}g.csv")
    test = planned(tmp_path / "run_2g.csv", force=None, level=level, base=base)
    assert test.level_factor == pytest.approx(size)


def shaken(friction: float) -> rs.ResponseSurface:
    """A hardening spring; from 0.8 N on friction holds the mass off resonance at the lowest level."""
    law = "k*x + k3*x**3 + c*v + Ff*sign(v)"
    oscillator = rs.Oscillator(2.0, law, {"k": 2e4, "k3": 3e9, "c": 4.0, "Ff": friction})
    grid = [0.5, 1, 2], np.linspace(13, 22, 31)
    test = rs.simulate(oscillator, rs.SimulatedTest(*grid, base="acceleration", noise_relative=0.01))
    return test.select(test.settled)


@pytest.mark.parametrize("friction", [0.25, 0.7, 1.1])
def test_beside_friction_misread_channels_are_named(friction):
    right = shaken(friction)
    response, base = right.harmonics[:, 1], right.force / right.omega**2
    read = {
        "": right,
        "reference": replace(right, harmonics=np.stack([0 * response, response + base], 1)),
        "sign": replace(right, force=-right.force),
        "milli": replace(right, harmonics=1000 * right.harmonics),
        "radian": replace(right, frequency=2 * np.pi * right.frequency),
    }
    for mistake, surface in read.items():
        found = base_findings(surface, absolute=False, senses=False)
        assert [finding.names["is"] for finding in found] == [mistake] * bool(mistake), mistake
    asked = rs.identify(read["reference"], "k*x + k3*x**3 + c*v + Ff*sign(v)", mass=2.0)
    assert "base-misread" in [finding.code for finding in asked.verdict.decided_by]
    assert not {"not-converged", "fixed-contradicted"} & {finding.code for finding in asked.findings}


@pytest.mark.usefixtures("few_laws")
def test_a_ranking_of_a_misread_base_says_so_and_tries_no_sums():
    right = shaken(0.25)
    absolute = right.harmonics[:, 1] + right.force / right.omega**2
    ranking = rs.rank(replace(right, harmonics=np.stack([0 * absolute, absolute], 1)), mass=2.0)
    assert not ranking.fits
    assert "base-misread" in codes(ranking)
    added = [set(one.name.split(" + ")) - {"linear-spring", "linear-damper"} for one in ranking.candidates]
    assert max(map(len, added)) == 1
