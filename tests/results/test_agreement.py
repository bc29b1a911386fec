"""Results: agreement of their parts against refits, and how their values are reached."""

from dataclasses import replace

import numpy as np
import pytest

from rsgen import ResponseSurface, RsgenError, identify
from rsgen.identification.fitting.least_squares import Regression, fit
from rsgen.identification.lines.line_fit import jackknife
from rsgen.identification.results.alternatives import Alternative, Alternatives, compare_parts
from tests.fitting.test_least_squares import straight
from tests.samples import cubic_model, cubic_surface
from tests.surfaces import MASS, model, surface


def line_through(x: np.ndarray, y: np.ndarray) -> Regression:
    """Fit y = a + b x."""
    by = np.stack([np.ones(len(x)), x], axis=1)[:, None]
    return fit(*straight(by, y[:, None]), exclude=False)


@pytest.fixture
def data():
    generator = np.random.default_rng(5)
    x = generator.uniform(1, 3, 40)
    group = np.arange(40) % 5
    return x, 2 + 3 * x + generator.normal(size=40) + generator.normal(size=5)[group], group


def test_of_a_linear_model_one_step_is_the_refit(data):
    x, y, group = data
    part = group < 2
    whole, here, there = line_through(x, y), line_through(x[part], y[part]), line_through(x[~part], y[~part])
    found = compare_parts(whole, part)
    assert found.moved == pytest.approx(here.parameters - there.parameters, rel=1e-9)
    # the same noise in both parts
    variance = sum(np.diag(each.basis @ each.basis.T) for each in (here, there))
    assert found.error == pytest.approx(whole.sigma * np.sqrt(variance), rel=1e-9)
    # slopes by three values that are no numbers have no eigenvalues
    unknown = np.full((*whole.rows.shape[:2], 3), np.nan)
    assert compare_parts(replace(whole, rows=unknown), part) is None


def test_the_jackknife_is_that_of_refits(data):
    x, y, group = data
    whole = line_through(x, y)
    left_out = [line_through(x[group != g], y[group != g]).parameters - whole.parameters for g in range(5)]
    expected = 4 / 5 * np.sum([np.outer(moved, moved) for moved in left_out], axis=0)
    assert jackknife(whole, group) == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_gains_of_the_levels_are_in_the_intervals():
    """Inner and outer levels were not compared, so that 28 of 40 intervals had the mass; 35 have it."""
    test = surface("cubic")
    test, within = test.select(test.level < 9), 0
    for seed in range(20):
        generator = np.random.default_rng(seed)
        gains = 1 + 4e-3 * generator.normal(size=len(test.levels))
        noise = 4e-3 * generator.normal(size=(2, len(test)))
        response = test.harmonics[:, 1] * gains[np.searchsorted(test.levels, test.level)]
        response = response * (1 + noise[0] + 1j * noise[1])
        found = identify(ResponseSurface(test.level, test.frequency, test.force, response), model("cubic"))
        low, high = found["m"].interval
        within += low < MASS < high
    assert within >= 17


@pytest.mark.parametrize(("halves", "severity"), [(7.0, "doubt"), (1.0, "warning"), (None, "info")])
def test_a_term_that_widens_a_value_beyond_a_tenth_is_a_doubt_where_halves_disagree(halves, severity):
    kinds = {"term": {"x**3": Alternative(1.0, 1.0, np.array([0.0, 1.0]))}}
    if halves is not None:
        kinds["halves"] = {"alternate levels": Alternative(halves, 1.0, np.array([5e-3, 0.0]))}
    others = Alternatives(("k", "k2"), np.array([0.01, 0.01]), kinds)
    (said,) = others.judge(np.array([1.0, 2.0]), 0.01)[1]
    assert (said.code, said.severity, said.parameter) == ("intervals-widened", severity, "k2")
    # 200 is known to a hundredth
    assert others.judge(np.array([1.0, 200.0]), 0.01)[1][0].severity in ("info", "warning")


def test_estimates_come_by_name():
    found = identify(cubic_surface(), cubic_model().elements)
    for estimate in found.refined:
        assert found[estimate.name] is estimate
        assert estimate.name in found
    assert [estimate.name for estimate in found] == [*found.model.parameters, "m"]
    assert "kn3" not in found
    for name in ("k9", 0, None):
        with pytest.raises(KeyError, match="there are c1, k1, kn1, m") as fault:
            found[name]  # type: ignore[index]  # the attempt is the test
        assert isinstance(fault.value, RsgenError)
