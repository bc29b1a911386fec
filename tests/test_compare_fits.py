"""Identifications side by side and against the truth."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.identification.results.alternatives import Alternative
from tests.surfaces import model, noisy, surface, truth
from tests.virtual import only, simulated

LAW = "k*x + k3*x**3 + c*v"
TRUE = {"k": 6000.0, "k3": 1e6, "c": 7.0}


@pytest.fixture(scope="module")
def fits():
    surface = noisy(simulated(LAW, TRUE, [1, 3, 6, 10], (8, 14, 41)), 0.01, 1)
    return [
        rs.identify(surface, LAW, rs.Observation(hold_out=(6.0,))),
        rs.identify(surface, LAW, rs.Observation(background="phase"), fixed={"m": 1.5}),
        rs.identify(surface, "k*x + c*v", rs.Observation(hold_out=(6.0,))),
    ]


def test_fits_stand_side_by_side(fits):
    compared = rs.compare_fits(fits, ["cubic", "with phase", "linear"])
    k3 = compared["k3"]
    first, second, third = k3.estimates
    assert (first, second, third) == (fits[0]["k3"], fits[1]["k3"], None)
    shift = (second.value - first.value) / np.hypot(first.standard_error, second.standard_error)
    assert k3.shifts == pytest.approx((0, shift, np.nan), nan_ok=True)
    assert compared["psi"].estimates[0] is None
    assert compared["psi"].estimates[1].unit == "rad"
    # a fixed value has no interval to be disjoint from another
    heavy = replace(fits[1], model=replace(fits[1].model, mass=1.6, fixed={}))
    assert not any(rs.compare_fits([fits[0], heavy])["m"].disjoint)
    assert [fit.held_out.keys() for fit in compared.fits] == [{"6 N rest"}, set(), {"6 N rest"}]
    assert compared.fits[0].held_out["6 N rest"] < 0.03 < compared.fits[2].held_out["6 N rest"]
    assert str(rs.compare_fits(fits[:1], ["one"])).splitlines()[0].split() == ["unit", "one"]
    assert "1.5 (fixed)" in str(compared)
    lines = compared.to_dicts()
    assert [line["fit"] for line in lines if line["name"] == "k3"] == ["cubic", "with phase"]
    assert [line["fit"] for line in lines if line["name"] == "k"] == ["cubic", "with phase", "linear"]
    assert compared.findings == ()


def test_an_alternative_that_gains_nothing_is_none(fits):
    others = fits[0].alternatives
    none = replace(others, kinds={"term": {"x": Alternative(0.0, 1.0, np.ones(len(others.names)))}})
    assert len(none.largest(np.ones(len(others.names)))) == 1
    assert len(rs.compare_fits(replace(fits[0], alternatives=none)).fits) == 1


def test_identified_results_that_disagree_are_named(fits):
    moved = [
        replace(one, value=1.1 * one.value, interval=tuple(1.1 * end for end in one.interval))
        if one.name in ("k", "k3")
        else one
        for one in fits[0].refined
    ]
    other = replace(fits[0], refined=tuple(moved))
    finding = only(rs.compare_fits([fits[1], fits[0], other], ["a", "b", "c"]), "results-disagree")
    assert set(finding.names["values"].split(", ")) == {"k", "k3"}
    assert "c" in (finding.names["first"], finding.names["second"])
    assert finding["shift"] > 10
    doubted = replace(other, findings=(rs.Finding("law-does-not-fit", "doubt"),))
    assert rs.compare_fits([fits[0], doubted]).findings == ()


def test_a_missed_tolerance_fails_the_whole_and_forces_are_judged_over_the_tested_range():
    combined = rs.identify(surface("combined", levels=np.array([2.0, 6, 12])), model("combined"))
    # 10 % on the cubic term, whose share of the force at the largest X is the deviation
    wrong = truth("combined") | {"kn": 3.3e5}
    result = rs.compare(combined, wrong, {"kn": 1e-2, "stiffness_force": 1e-3, "c": 1e-2})
    rows = {row.name: row for row in result.rows}
    assert list(rows) == ["c", "cn", "k", "kn", "m", "stiffness_force", "damping_force"]
    assert rows["k"].relative_error == abs(combined["k"].value - 5920) / 5920 < rows["k"].first_order_error
    missed = {name: row for name, row in rows.items() if not row.passed}
    assert not result.passed
    assert missed.keys() == {"kn", "stiffness_force"}
    assert missed["kn"].relative_error == pytest.approx(0.0909, rel=1e-2)
    largest = combined.curve.amplitude[combined.curve.used].max()
    force = 5920 * largest + 3.3e5 * largest**3
    row = missed["stiffness_force"]
    assert (row.true, row.unit) == (pytest.approx(force, rel=1e-12), "N")
    assert row.relative_error == pytest.approx(0.3e5 * largest**3 / force, rel=1e-3)
