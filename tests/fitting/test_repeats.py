"""Laws of repeats: joined to means they give the same estimate, and standard errors from their scatter."""

import numpy as np
import pytest

from rsgen import ResponseSurface, identify
from rsgen.identification.fitting.repeats import Repeats, gather_repeats
from tests.surfaces import changed, distances, joined, model, noisy, surface, truth
from tests.virtual import fundamentals, only, simulated

READINGS, NOISE = 8, 0.01


def repeated(table: ResponseSurface, seed: int, noise: float = NOISE) -> ResponseSurface:
    """Every point read several times, with noise anew and the clock at another moment each time."""
    random = np.random.default_rng(seed)
    parts, orders = [], np.arange(table.harmonics.shape[1])
    for reading in range(READINGS):
        part, turn = noisy(table, noise, 100 * seed + reading), np.exp(2j * np.pi * random.random(len(table)))
        turned = part.harmonics * turn[:, None] ** orders
        parts.append(changed(part, force=part.force * turn, harmonics=turned))
    return joined(*parts)


@pytest.fixture(scope="module")
def cubic():
    return surface("cubic")


def test_readings_become_means_with_their_scatter(cubic):
    means, repeats = gather_repeats(repeated(cubic, 1))
    assert len(means) == len(cubic)
    assert set(repeats.count) == {READINGS}
    assert repeats.noise == pytest.approx(np.sqrt(2) * NOISE, rel=0.1)
    order, again = (np.lexsort((t.frequency, t.level)) for t in (cubic, means))
    ratio = (means.harmonics[again, 1] / means.force[again]) / (
        cubic.harmonics[order, 1] / cubic.force[order]
    )
    assert np.abs(ratio - 1).max() < 6 * NOISE / np.sqrt(READINGS)


def test_exact_copies_are_no_measure_of_noise(cubic):
    table, repeats = gather_repeats(repeated(cubic, 1, noise=0.0))
    assert repeats is None
    assert len(table) == READINGS * len(cubic)
    assert gather_repeats(cubic) == (cubic, None)


@pytest.mark.parametrize("times", [3.0, 1.3], ids=["other branch", "not settled"])
def test_a_reading_on_another_branch_is_not_averaged_and_one_that_has_not_settled_is_set_aside(cubic, times):
    table = repeated(cubic, 3)
    harmonics = np.array(table.harmonics)
    harmonics[0] *= times
    means, repeats = gather_repeats(changed(table, harmonics=harmonics))
    if times == 3:
        assert len(means) == len(cubic) - 1 + READINGS
        assert np.count_nonzero(repeats.count == 1) == READINGS
    else:
        assert repeats.excluded >= 1
        assert repeats.noise == pytest.approx(np.sqrt(2) * NOISE, rel=0.1)


def test_one_wrong_reading_of_two_is_no_noise_of_the_others(cubic):
    table = repeated(cubic, 4).select(np.arange(2 * len(cubic)))
    harmonics = np.array(table.harmonics)
    harmonics[5] *= 0.8 * np.exp(0.2j)
    wrong, right = (gather_repeats(one)[1] for one in (changed(table, harmonics=harmonics), table))
    assert wrong.noise == pytest.approx(right.noise, rel=0.01)


def pairs(force: complex, response: complex) -> Repeats:
    """Two readings of each of three points, as far above their mean as below."""
    row, sign = np.repeat(np.arange(3), 2), np.tile([1.0, -1.0], 3)
    return Repeats(row, np.tile([0, 1], 3), np.full(3, 2), force * sign, response * sign, np.zeros((6, 0)), 0)


def test_the_noise_of_two_readings_is_that_of_their_difference():
    # two numbers a and b have the variance (a - b)^2 / 2, force and response together
    assert pairs(0.03, 0.0).noise == pytest.approx(np.sqrt(0.06**2 / 2))
    assert pairs(0.03, 0.04j).noise == pytest.approx(np.sqrt((0.06**2 + 0.08**2) / 2))


def test_the_error_of_a_mean_of_two_is_half_of_their_difference():
    # an estimate that is the sum of what the real part of the first force and the imaginary part of the
    # second response deviate by: their variances add, each (a - b)^2 / 4
    influence = np.zeros((3, 4, 1))
    influence[0, 0], influence[1, 3] = 1.0, 1.0
    covariance, freedom = pairs(0.03, 0.04j).covariance(np.arange(3), influence)
    assert covariance[0, 0] == pytest.approx(0.03**2 + 0.04**2, rel=1e-12)
    assert freedom[0] == pytest.approx((0.03**2 + 0.04**2) ** 2 / (0.03**4 + 0.04**4), rel=1e-12)


def test_two_branches_side_by_side_are_no_repeats():
    law = "c*v + Piecewise((k1*x, abs(x) <= b), (k2*x + b*(k1 - k2)*sign(x), True))"
    gap = law, {"k1": 32250.0, "k2": 58000.0, "b": 4e-4, "c": 4.0}, [0.25, 0.5, 0.9, 1.5], (27, 40, 60), 0.85
    both = joined(*(noisy(simulated(*gap, sweep=way), 3e-3, 1) for way in ("up", "down")))
    mixed = fundamentals(both.select(np.lexsort((both.frequency, both.level))), sweep="up")
    found = identify(mixed, law)
    assert [(f.code, f.names["by"]) for f in found.verdict.decided_by] == [("repeats-scatter", "branch")]


@pytest.mark.slow
def test_standard_errors_are_those_of_doing_the_test_again(cubic):
    scores = []
    for seed in range(8):
        found = identify(repeated(cubic, seed), model("cubic"))
        scores.append(distances(found, truth("cubic")))
        assert only(found, "repeats-scatter").severity == "info"
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5
