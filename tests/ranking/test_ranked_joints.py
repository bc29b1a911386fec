"""Rankings of laws across two sensors: the joint is sought, ground and joint have linear elements."""

from __future__ import annotations

import numpy as np
import pytest

import rsgen as rs
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from rsgen.identification.ranking.reference import PointTest
from tests.capabilities import MODIFIERS
from tests.identification.test_across import (
    ELEMENTS,
    GAUGE,
    SENSORS,
    driven_by_a_sine,
    gauged,
    seen_by,
    with_noise,
)  # fmt: skip
from tests.multisine.test_two_sensors import WING, spectra
from tests.surfaces import changed

LINEAR = Model(("k*x", "c*v"))


def between(*joints: str, sensors: str = SENSORS, ground: str = WING) -> list[list[rs.Element]]:
    """Each joint with a ground."""
    return [
        [rs.make_element("ground", ground), rs.make_element("joint", joint, across=sensors)]
        for joint in joints
    ]


def noisy(sensors: str, noise: float) -> rs.ResponseSurface:
    """Two masses under a sine, with noise of the motion across, or of the second sensor of a difference."""
    exact, random = driven_by_a_sine(), np.random.default_rng(1)
    return (gauged if sensors == GAUGE else with_noise)(exact, noise, random)


@pytest.mark.parametrize("sensors", [GAUGE, SENSORS])
def test_noise_of_the_second_sensor_is_in_the_rows(sensors: str) -> None:
    elements = seen_by(sensors, *ELEMENTS)
    test = PointTest(noisy(sensors, 0.003), LINEAR, [elements], sensors)
    found = test.along(test.start("joint", elements), None)
    assert found is not None
    # without the noise of the second sensor that of force and response has to be larger
    assert found.noise == pytest.approx(0.003, rel=0.15)
    assert found.leader.chi_squared / (2 * len(found.rows)) == pytest.approx(1.0, rel=0.25)
    for name, value in (("kj", 8e3), ("k3", 4e8), ("m", 3.0)):
        assert found.leader.candidate.values[name] == pytest.approx(value, rel=0.1), name


def test_the_joint_of_a_test_of_sines_is_first_and_its_reverse_is_rejected() -> None:
    row = MODIFIERS["two sensors"]
    ranking = rs.rank(row.records, row.rivals)
    # a joint that carries little of the force is no other one for that
    assert len(ranking) == len(row.rivals)
    best = ranking.candidates[0]
    assert (best.force, ranking.verdict.state) == ("c*v + k*x + k3*x**3; across gauge: kj*x**3", "identified")
    assert ranking.best["kj"].value == pytest.approx(4e6, rel=0.1)
    turned = rs.rank(changed(row.records, across=-row.records.across), row.rivals)
    assert (turned.fits, turned.verdict.state) == (False, "rejected")
    assert [finding.code for finding in turned.verdict.decided_by] == ["curve-negative"]


def test_the_joint_of_a_multisine_is_first() -> None:
    laws, records = between("kj*x**3 + cj*v", "kj*x + cj*v", "kj*x**5 + cj*v"), spectra(0.01)
    ranking = rs.rank(records, laws)
    assert ranking.candidates[0].force.endswith(f"across {SENSORS}: cj*v + kj*x**3")
    assert ranking.fits
    assert ranking.candidates[1].bic > 100


def test_laws_of_the_library_are_put_between_the_sensors(few_laws: None) -> None:
    ranking = rs.rank(noisy(SENSORS, 0.003), Model(ELEMENTS))
    own = next(candidate for candidate in ranking if candidate.own)
    assert own is ranking.candidates[0]
    assert (own.name, own.label) == ("cubic-spring", "the case's own law (cubic-spring)")
    assert all(f"; across {SENSORS}: " in candidate.force for candidate in ranking)
    assert all(element.across for element in ranking.model.elements if "j" in "".join(element.parameters))


def test_every_law_of_a_ranking_acts_between_the_same_sensors() -> None:
    surface, (law,) = driven_by_a_sine(), between("kj*x")
    with pytest.raises(RsgenError, match="but no element follows it"):
        rs.rank(surface, [law, "k*x + c*v"])
    with pytest.raises(RsgenError, match="'a - b', 'far - near'; one pair"):
        rs.rank(surface, [law, *between("kj*x", sensors="a - b")])
