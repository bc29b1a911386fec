"""Sizes that a test cannot have and responses of another quantity are found; real tests are left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.data.surface.mode_findings import flattening_findings, mode_findings, row_findings
from rsgen.data.surface.plausibility import (
    RANGES,
    Sizes,
    backbone_gap,
    level_findings,
    quantity_findings,
    size_findings,
)
from rsgen.data.surface.response_surface import ResponseSurface
from tests.samples import cubic_surface
from tests.virtual import fundamentals, only, simulated

LAW = "k1*x + kn1*x**3 + c1*v"
RANDOM = np.random.default_rng(0)


def said_of(surface: ResponseSurface) -> list[tuple[str, str]]:
    return [(found.code, found.severity) for found in level_findings(surface)]


def test_levels_in_another_order_than_forces_are_doubted_and_a_level_a_point_is_named():
    surface = cubic_surface()
    assert said_of(surface) == []
    shuffled = replace(surface, level=RANDOM.permutation(surface.level))
    assert said_of(shuffled) == [("levels-disagree", "doubt")]
    level = surface.level * (1 + 1e-3 * RANDOM.normal(size=len(surface)))
    assert said_of(fundamentals(surface, force=level, level=level)) == [("levels-disagree", "warning")]


def test_one_level_of_a_shaker_without_control_is_no_several_levels():
    force = np.array([1.36, 0.89, 0.57, 0.34, 0.24, 0.19, 0.24, 0.35, 0.57, 0.9, 1.38])
    frequency, level = np.linspace(9.8, 10.3, 11), np.full(11, 1.4)
    assert list(level_findings(ResponseSurface(level, frequency, force, 1e-3j * force))) == []
    several = ResponseSurface(level, frequency, np.where(np.arange(11) % 2, 1.4, 0.7), 1e-3j * force)
    assert [one.names["one"] for one in level_findings(several)] == ["yes"]


def test_a_level_with_the_response_of_another_one_is_doubted_held_out_or_not():
    surface = cubic_surface(levels=3, frequencies=31)
    response = surface.harmonics[:, 1].copy()
    response[surface.level == surface.levels[2]] = response[surface.level == surface.levels[1]]
    for held in ((), (surface.levels[2],)):
        found = rsgen.identify(fundamentals(surface, response), LAW, rsgen.Observation(hold_out=held))
        repeated = only(found, "run-repeated")
        assert set(repeated.names.values()) == {f"the level of {one:g} N" for one in surface.levels[1:]}
        assert not found.verdict.usable


@pytest.mark.parametrize(("off", "others"), [([2], ""), ([2, 4], "19.6 N at 9.8 N")])
def test_levels_that_are_another_multiple_of_their_forces_are_named_in_one_finding(off, others):
    surface = cubic_surface(levels=6, frequencies=31)
    force = surface.force * (1 + np.isin(surface.level, surface.levels[off]))
    found = [one for one in level_findings(fundamentals(surface, force=force)) if "force" in one.numbers]
    assert [(one.code, one.names["others"]) for one in found] == [("levels-disagree", others)]
    assert [found[0]["level"], found[0]["force"]] == pytest.approx([5.4, 10.8])


@pytest.mark.parametrize("lost", [0.0, 0.08, 0.6])
@pytest.mark.parametrize(("factor", "near"), [
    (1.8, None), (1.6, None), (1 / 1.6, None), (2, "peak-to-peak"), (0.506, "peak-to-peak"), (2**0.5, "rms"),
    (0.7, "rms"),
])  # fmt: skip
def test_forces_of_one_proportion_to_all_levels_are_named(factor, near, lost):
    """A shaker loses force near the resonance, the more of it the higher the level."""
    surface = cubic_surface()
    force = factor * (1 - lost * (surface.amplitude / surface.amplitude.max()) ** 4) * surface.force
    (said,) = level_findings(fundamentals(surface, force=force))
    assert (said.code, said.severity) == ("levels-in-other-unit", "doubt" if near else "warning")
    assert said.names.get("near") == near
    assert said["force"] / said["level"] == pytest.approx(said["ratio"]) == pytest.approx(factor, rel=0.05)


@pytest.mark.parametrize("lost", [0.3, 0.7])
@pytest.mark.parametrize("factor", [1.0, 0.8, 1.3])
def test_forces_that_fall_at_the_resonance_or_are_near_their_levels_are_as_they_should_be(factor, lost):
    """Levels are also called by the force near the resonance, which is lower than most."""
    surface = cubic_surface()
    most = np.array([surface.amplitude[surface.level == one].max() for one in surface.level])
    force = factor * (1 - lost * (surface.amplitude / most) ** 2) * surface.force
    for level in (surface.level, factor * (1 - lost) * surface.level):
        assert said_of(fundamentals(surface, force=force, level=level)) == []


@pytest.mark.parametrize("pair", [(0, 1), (0, -1), (1, -1), (2, -1)])
def test_responses_of_two_levels_that_are_exchanged_are_named(pair):
    surface = cubic_surface(levels=4, frequencies=31)
    one, other = (surface.level == surface.levels[place] for place in pair)
    response = surface.harmonics[:, 1].copy()
    response[one], response[other] = surface.harmonics[other, 1], surface.harmonics[one, 1]
    (found,) = level_findings(fundamentals(surface, response))
    assert (found.code, found.severity) == ("levels-swapped", "doubt")
    assert [found["low"], found["high"]] == [surface.levels[place] for place in pair]
    assert found["pushed"] * found["moved"] == pytest.approx(1, rel=0.3)


@pytest.mark.parametrize(("moving", "named"), [(0, [1.0, 12.0, 0]), (1, [14 / 3, 12.0, 0]), (3, [])])
def test_a_level_at_rest_above_one_that_moves_has_the_response_of_another_one(moving, named):
    surface = cubic_surface(levels=4, frequencies=31)
    moves = surface.level == surface.levels[moving]
    found = [*level_findings(replace(surface, harmonics=surface.harmonics * moves[:, None]))]
    assert [(one.code, dict(one.names)) for one in found] == [("levels-swapped", {})] * bool(named)
    assert [one[name] for one in found for name in ("low", "high", "moved")] == pytest.approx(named)


# the half of a level's response may be like that of a neighbour
@pytest.mark.parametrize(("levels", "place", "gain", "near"), [
    (2, 0, 1e3, "milli"), (4, 0, 1e3, "milli"), (4, 2, 1e3, "milli"), (6, 3, 0.5, "peak-to-peak"),
])  # fmt: skip
def test_one_level_in_another_unit_is_not_called_exchanged(levels, place, gain, near):
    surface = cubic_surface(levels=levels, frequencies=31)
    level = surface.levels[place]
    response = np.where(surface.level == level, gain, 1.0) * surface.harmonics[:, 1]
    (found,) = level_findings(fundamentals(surface, response))
    assert (found.code, found["level"], found.names["near"]) == ("levels-disagree", level, near)
    assert found["gain"] == pytest.approx(gain, rel=0.01)


@pytest.mark.parametrize("order", ["transposed", "one level of 300 times the response"])
def test_levels_that_no_exchange_mends_are_not_called_each_others(order):
    surface = cubic_surface(levels=4, frequencies=31)
    response = surface.harmonics[:, 1].reshape(4, 31)
    response = response.T if order == "transposed" else response * np.array([[300.0], [1], [1], [1]])
    (found,) = level_findings(wrong := fundamentals(surface, response.ravel()))
    assert (found.code, dict(found.names)) == ("levels-swapped", {"mends": "no"})
    assert rsgen.identify(wrong, LAW).verdict.state == "rejected"


def test_levels_in_another_order_than_their_measured_forces_are_named():
    surface = cubic_surface(levels=4, frequencies=31)
    place = np.searchsorted(surface.levels, surface.level)
    turned = replace(surface, level=surface.levels[::-1][place])
    (found,) = level_findings(turned)
    assert (found.code, found.severity) == ("levels-swapped", "doubt")
    assert found["low_measured"] > found["high_measured"]
    # numbers of runs are in any order
    assert said_of(replace(surface, level=np.array([3.0, 1.0, 4.0, 2.0])[place])) == []


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e3])
def test_forces_in_another_unit_than_their_levels_are_doubted(factor):
    surface = cubic_surface()
    (found,) = level_findings(wrong := fundamentals(surface, force=factor * surface.force))
    assert found.severity == "doubt"
    assert found["force"] == pytest.approx(factor * found["level"])
    # numbers of runs are no other unit
    assert said_of(replace(surface, level=np.searchsorted(surface.levels, surface.level) + 1.0)) == []
    one = surface.select(surface.level == surface.levels[0])
    assert said_of(replace(one, force=1e3 * one.force)) == []
    if factor == 1e-3:  # the other sizes are possible
        assert rsgen.identify(wrong, LAW).verdict.state == "doubtful"


@pytest.mark.parametrize(("sizes", "quantity"), [
    (Sizes.of(fundamentals(cubic_surface(), 1e3 * cubic_surface().harmonics[:, 1])), "velocity"),
    (Sizes(10, 70.0, 1, 1, 1), "displacement"), (Sizes(30, 0.1, 1, 1, 1, mass=8e-6), "mass"),
    (Sizes(30, 0.1, 1, 1, 1, mass=1.9e12), "stiffness"), (Sizes(30, 0.1, 1, 1, 1, damping=0.47), "damping"),
    (Sizes(500, 0.1, 1, 2e6, 1), "acceleration"), (Sizes(3e6, 0.1, 1, 1, 1), "frequency"),
    (Sizes(1e-5, 0.1, 1, 1, 1), "frequency"), (Sizes(30, 0.1, 1, 1, 1e9), "force"),
])  # fmt: skip
def test_each_quantity_has_its_bounds(sizes, quantity):
    (found,) = size_findings(sizes)
    assert (found.severity, found.names["quantity"]) == ("doubt", quantity)
    assert found.numbers["value"].unit == RANGES[quantity].unit


@pytest.mark.parametrize("sizes", [
    Sizes(5e6, 1e-7, 3.0, 1e8, 1e-6, mass=1e-12, damping=5e-6),  # a resonator on a chip
    Sizes(1.6e3, 3e-6, 0.03, 340.0, 1.7e-11, mass=3e-11, damping=4e-4),  # a wire in vacuum
    Sizes(0.1, 0.3, 0.2, 0.1, 1e5, mass=1e8, damping=0.005),  # a tower
    Sizes(0.16, 3.0, 3.0, 3.0, 1.0, mass=1.0, damping=0.05),  # numbers without units
])  # fmt: skip
def test_what_exists_is_possible(sizes):
    assert list(size_findings(sizes)) == []


def tampered(surface: ResponseSurface, mistake: str) -> np.ndarray:
    response = surface.harmonics[:, 1]
    if mistake == "radian":
        return np.abs(response) * np.exp(1j * np.angle(response) * np.pi / 180)
    by = 1 / surface.force if mistake == "per-force" else (1j * surface.omega) ** int(mistake)
    return response * by


@pytest.mark.parametrize("noise", [0.0, 0.03])
@pytest.mark.parametrize("mistake", ["+1", "+2", "-1", "-2", "radian", "per-force"])
def test_a_response_of_another_quantity_is_recognised(mistake, noise):
    surface = cubic_surface(levels=4, frequencies=31)
    random = np.random.default_rng(2)
    scatter = 1 + noise * (random.normal(size=len(surface)) + 1j * random.normal(size=len(surface)))
    noisy = fundamentals(surface, surface.harmonics[:, 1] * scatter)
    assert list(quantity_findings(noisy)) == []
    (finding,) = quantity_findings(fundamentals(surface, tampered(noisy, mistake)))
    assert (finding.severity, finding.names["is"], finding.names["sure"]) == ("doubt", mistake, "yes")
    assert "sense" not in finding.names
    if mistake != "per-force":
        (turned,) = quantity_findings(fundamentals(surface, np.conj(tampered(noisy, mistake))))
        assert (turned.names["is"], turned.names["sense"]) == (mistake, "other")


@pytest.mark.parametrize(("levels", "sure"), [((1.0, 10.0), ["level"]), ((1.0, 10.0, 12.0), [])])
def test_a_lowest_level_in_another_unit_is_no_response_per_force_for_sure(levels, sure):
    test = simulated(
        "k*x + k3*x**3 + c*v", {"k": 5e3, "k3": 1e6, "c": 4.0}, levels, (6, 14, 21), noise_relative=0.01
    )
    read = fundamentals(test, np.where(test.level == 1, 9.80665, 1) * test.harmonics[:, 1])
    assert [finding.names["sure"] for finding in quantity_findings(read)] == sure
    # three levels tell which one it is
    ranking = rsgen.rank(read, ["k*x + c*v", "k*x + k3*x**3 + c*v"])
    for found in (mode_findings(read, None), ranking.findings):
        assert [one["level"] for one in found if one.code == "levels-disagree"] == [1.0] * (len(levels) - 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bouc_wen", "f16", "wire"])
@pytest.mark.usefixtures("read_here")
def test_measured_tests_are_not_doubted(name, measured_data):
    folder = measured_data(name).parent
    case = rsgen.load_case(Path(__file__).parent / "cases" / f"{name}.toml", data=folder)
    surface = rsgen.read(case)
    assert not {"size-impossible", "another-quantity"} & {found.code for found in surface.findings}
    assert list(quantity_findings(surface)) == []
    assert all(found.severity == "info" for found in size_findings(Sizes.of(surface)))


@pytest.mark.parametrize(("gap", "modes"), [(0.045, 1), (0.055, 2)])
def test_points_at_phase_resonance_are_of_two_modes_beyond_a_gap_of_a_twentieth(gap, modes):
    lower = 20 * np.exp(1e-3 * np.arange(4))
    frequency, amplitude = np.concatenate([lower, lower * np.exp(gap + 3e-3)]), np.full(8, 1e-3)
    assert (backbone_gap(frequency, amplitude) is not None) == (modes == 2)


@pytest.mark.parametrize("control", ["force", "response"])
def test_arrays_of_a_grid_that_were_flattened_in_two_orders_are_named(control):
    levels, frequency = np.array([1.0, 2.0, 4.0]), np.linspace(8, 12, 24)
    receptance = 1 / (6000 - 1.5 * (2 * np.pi * frequency) ** 2 + 8j * 2 * np.pi * frequency)
    force = np.outer(levels, np.ones(24)) if control == "force" else 1e-3 * np.outer(levels, 1 / receptance)
    motion = force * receptance
    given = levels if control == "force" else 1e-3 * levels

    def named(level, at, *grids):
        force, motion = (grid.ravel() for grid in grids)
        found = flattening_findings(ResponseSurface(level, at, force, motion, control=control))
        return [finding.names["rows"] for finding in found]

    right = np.repeat(given, 24), np.tile(frequency, 3)
    swapped = np.tile(given, 24), np.repeat(frequency, 3)
    assert not named(*right, force, motion)
    assert not named(*swapped, force.T, motion.T)
    assert named(*swapped, force, motion) == ["levels"]
    one = ResponseSurface(np.ones(72), right[1], force.ravel(), motion.ravel(), control=control)
    assert ["one" in found.names for found in level_findings(one)] == [control == "force"]
    nominal = ResponseSurface(np.ones(72), right[1], 1.0, motion.ravel(), control=control)
    assert [f.names["rows"] for f in row_findings(nominal)] == ["readings"] * (control == "force")
    if control == "force":
        # levels in place of frequencies, but not steps of the level at a few frequencies
        exchanged = ResponseSurface(right[1], right[0], right[1], motion.ravel())
        assert [found.names["rows"] for found in row_findings(exchanged)] == ["columns"]
        steps = np.tile(np.linspace(1, 5, 24), 3), np.repeat(frequency[::8], 24)
        stepped = steps[0] * np.repeat(receptance[::8], 24)
        assert row_findings(ResponseSurface(*steps, steps[0], stepped)) == []
    assert named(right[0], swapped[1], force, motion) == ["frequencies"]
    surface = ResponseSurface(right[0], swapped[1], force.ravel(), motion.ravel(), control=control)
    for found in (rsgen.identify(surface, "k*x + c*v", mass=1.5), rsgen.modal_table(surface, mass=1.5)):
        assert "repeat and numpy.tile" in str(found)


def test_exchanged_channels_of_a_held_response_are_named():
    """The channel that is the force varies more than the motion there, which is no argument against it."""
    frequency, held = np.tile(np.linspace(8.5, 11.5, 25), 3), np.repeat([0.01, 0.02, 0.04], 25)
    omega = 2 * np.pi * frequency
    noise = 1 + 3e-3 * np.random.default_rng(0).standard_normal((75, 2)) @ np.array([1, 1j])
    force = held * (6000 - 1.5e5 * held**2 - 1.5 * omega**2 + 4j * omega) * noise
    response = np.abs(force) * np.exp(-1j * np.angle(force))
    surface = ResponseSurface(held, frequency, held, response, control="response")
    found = rsgen.identify(surface, "k*x + k3*x**3 + c*v")
    assert only(found, "another-quantity").names["is"] == "exchanged"
