"""Laws and tables that nobody should bring: a sentence or a result, never a traceback or a warning."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest

from rsgen import Observation, ResponseSurface, RsgenError, identify, make_element
from rsgen.law.character import character
from tests.surfaces import surface
from tests.virtual import fundamentals

CUBIC = "k*x + k3*x**3 + c*v"


@pytest.fixture(autouse=True)
def no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.fixture(scope="module")
def table():
    return surface("cubic", levels=np.array([2.0, 6.0, 10.0]), frequencies=np.linspace(8.5, 11.5, 31))


@pytest.mark.parametrize("name", ["T", "F"])
def test_a_parameter_may_be_called_as_a_variable_of_a_test(table, name):
    found = identify(fundamentals(table), f"k*x + k3*x**3 + {name}*v")
    assert found[name].unit in {"", "N*s/m"}
    assert found[name].value == pytest.approx(3.8, rel=1e-3)


@pytest.mark.parametrize("law", ["k*x + c*v + 1e300*exp(a*x)", "k*x + c*v + exp(1e300*v)"])
def test_a_law_that_overflows_is_refused(table, law):
    with pytest.raises(RsgenError, match=r"law: .* follows none of the"):
        identify(fundamentals(table), law)


def test_a_law_with_a_number_that_overflows_has_a_character():
    for law in ("exp(1e300)*x", "1e300*exp(a*x*1e300)*sign(x)", "tan(1e300)*x"):
        assert character(make_element("law", law).force).springs


@pytest.mark.parametrize("part", ["response", "force", "frequency"])
@pytest.mark.parametrize("factor", [1e-200, 1e200])
def test_sizes_that_no_number_can_square_are_refused(table, part, factor):
    columns = {"response": table.harmonics[:, 1], "force": table.force, "frequency": table.frequency}
    read = ResponseSurface(level=table.level, **columns | {part: factor * columns[part]})
    with pytest.raises(RsgenError, match=rf"surface\.{part}: .* must be 1e-60 to 1e\+60"):
        identify(read, CUBIC)


GENERATOR = np.random.default_rng(0)
AWKWARD: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "noise": lambda x: GENERATOR.normal(size=len(x)) + 1j * GENERATOR.normal(size=len(x)),
    "constant": lambda x: 0 * x + 1e-3, "conjugate": np.conj, "real": lambda x: np.abs(x) + 0j,
    "drop-outs": lambda x: np.where(GENERATOR.random(len(x)) < 0.2, 0, x),
    "gaps": lambda x: np.where(GENERATOR.random(len(x)) < 0.2, np.nan, x), "shuffled": GENERATOR.permutation,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", [
    pytest.param(kind, marks=[pytest.mark.thorough] * (kind in ("noise", "real"))) for kind in AWKWARD
])  # fmt: skip
@pytest.mark.parametrize(
    "law", [CUBIC, pytest.param("k*x + k2*x**2 + c*v + F*sign(v)", marks=pytest.mark.thorough)]
)
def test_awkward_responses_give_a_result_without_a_warning(table, kind, law):
    try:
        found = identify(fundamentals(table, AWKWARD[kind](table.harmonics[:, 1])), law)
    except RsgenError as fault:
        # no spring answers every force with one response, or with noise: round-off decides where its fit ends
        if kind in ("constant", "noise") and "follows none of the 93 points" in str(fault):
            return
        raise
    assert len(found.refined) == len(found.model.parameters) + 1


@pytest.mark.slow
@pytest.mark.parametrize("background", ["none", "neighbour+offset"])
def test_one_frequency_gives_a_result_without_a_warning(table, background):
    one = ResponseSurface(table.level, 0 * table.frequency + 10.0, table.force, table.harmonics[:, 1])
    found = identify(one, CUBIC, Observation(background=background))
    assert any(estimate.finding is not None for estimate in found.refined) or found.findings
