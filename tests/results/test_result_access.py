"""Laws of what a result gives by name, as a table and as a data frame."""

import pytest

from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from rsgen.identification.identify import identify
from rsgen.identification.ranking import Candidate, Ranking
from tests.samples import cubic_model, cubic_surface


@pytest.fixture(scope="module")
def found():
    return identify(cubic_surface(), cubic_model().elements)


@pytest.fixture(scope="module")
def ranking():
    model = Model("k*x + k3*x**3 + c*v")
    candidates = (
        Candidate("cubic-spring", "c*v + k*x + k3*x**3", 4, 1e-4, 0.0, True, {}),
        Candidate("linear", "c*v + k*x", 3, 0.1, 1e4, False, {}),
    )
    return Ranking(candidates, model, True, (), 1e-4, 0.0, cubic_surface())


def test_estimates_come_by_name(found):
    for estimate in found.refined:
        assert found[estimate.name] is estimate
        assert estimate.name in found
    assert [estimate.name for estimate in found] == [*found.model.parameters, "m"]
    assert "kn3" not in found


@pytest.mark.parametrize("name", ["k9", 0, None])
def test_a_name_that_is_not_there_is_answered_with_those_that_are(found, name):
    with pytest.raises(KeyError, match="there are c1, k1, kn1, m") as fault:
        found[name]  # type: ignore[index]  # the attempt is the test
    assert isinstance(fault.value, RsgenError)


def test_the_table_holds_values_intervals_and_units(found):
    lines = str(found).splitlines()
    assert lines[:2] == ["identified", "c1*v + k1*x + kn1*x**3"]
    assert lines[2].split("  ")[0] == "parameter"
    for line, estimate in zip(lines[3 : 3 + len(found.refined)], found.refined, strict=True):
        name, value, low, to, high, unit = line.split()
        assert (name, to, unit) == (estimate.name, "to", estimate.unit)
        width = estimate.interval[1] - estimate.interval[0]
        for shown, exact in (
            (value, estimate.value),
            (low, estimate.interval[0]),
            (high, estimate.interval[1]),
        ):
            # rounded to a small part of the interval, or to ten digits
            assert float(shown) == pytest.approx(exact, rel=1e-9, abs=width / 20)
    # the misfit is the one that the page states: of real and imaginary part together
    assert found.residual == found.outcome["misfit"]
    assert f"misfit {found.residual:.2g}" in str(found)
    html = found._repr_html_()
    assert html.count("<tr>") == 1 + len(found.refined)
