"""A test with one thing wrong is doubted for the right reason, and one with nothing wrong is not."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.verdict.laboratory import judge, stepped
from tests.verdict.tampering import TAMPERINGS

pytestmark = pytest.mark.slow

QUICK = 6
"""Every sixth frequency of a case: some twenty a level."""

BY_NAME = {entry.name: entry for entry in TAMPERINGS}

DOUBTED = [
    ("cubic", "sign of the response reversed", {"not-passive", "mass-negative", "curve-negative"}),
    ("coulomb", "phase in the wrong sense (conjugate)", {"structure-feeds-exciter", "curve-negative"}),
    ("cubic", "response in mm/s^2, read as m/s^2", {"size-impossible"}),
    ("cubic", "force in kN, read as N", {"levels-disagree"}),
    ("cubic", "one level in g, read as m/s^2", {"law-does-not-fit", "parts-disagree"}),
    ("cubic", "response in g, read as m/s^2; mass known", {"fixed-contradicted"}),
    ("cubic", "rad/s read as Hz, column called omega", {"unit-contradicts-title"}),
    ("cubic", "Hz read as rad/s, column called f_Hz", {"unit-contradicts-title"}),
    ("cubic", "acceleration read as velocity", {"another-quantity"}),
    ("cubic", "two levels swapped", {"law-does-not-fit", "parts-disagree"}),
    ("quintic", "labels 1, 2, 3, ... for the forces", {"law-does-not-fit"}),
    ("combined", "the same force at every level", {"law-does-not-fit"}),
    ("coulomb", "half of a level's points from another level", {"law-does-not-fit"}),
    ("combined", "half of a level's points noise", {"points-excluded"}),
    ("quintic", "frequencies of one level 2 % too high", {"law-does-not-fit"}),
    ("piecewise", "frequencies of one level 2 % too high", {"level-deviates"}),
    ("cubic", "sensor overloaded at half of the largest response", {"range-reached"}),
    ("quintic", "a second mode in the band", {"law-does-not-fit"}),
    ("cubic", "a constant background left out", {"law-does-not-fit"}),
    ("combined", "law without the decisive term", {"law-does-not-fit"}),
    ("coulomb", "law without the decisive term", {"law-does-not-fit"}),
]
"""Case, tampering, and codes of findings that must decide, all of them."""


@pytest.mark.parametrize(("name", "wrong", "codes"), DOUBTED)
def test_one_thing_wrong_is_doubted(tmp_path, name, wrong, codes):
    outcome = judge(BY_NAME[wrong].make(name, QUICK).write(tmp_path))
    assert outcome.state in ("doubtful", "rejected")
    assert codes <= set(outcome.deciding)


@pytest.mark.parametrize(("keys", "turned"), [
    ({"factor": -1.0}, np.pi), ({"quantity": "velocity"}, np.pi / 2), ({}, 0.0),
], ids=["sign", "quantity", "nothing wrong"])  # fmt: skip
def test_a_background_takes_up_no_sign_and_no_quantity(tmp_path, keys, turned):
    test = replace(stepped("cubic", every=QUICK), further={"identify": {"background": "phase"}})
    outcome = judge(test.reading("response", **keys).write(tmp_path))
    found = [finding["phase"] for finding in outcome.findings if finding.code == "phase-turned"]
    assert np.exp(1j * np.array(found)) == pytest.approx([np.exp(1j * turned)] if turned else [], abs=0.2)


def test_a_law_that_feeds_energy_is_not_simulated(tmp_path, monkeypatch):
    # it settles nowhere, and looking for its steady states takes minutes
    def refused(*args: object, **options: object) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(sys.modules["rsgen.identification.identify"], "fit_simulator", refused)
    wrong = BY_NAME["phase in the wrong sense (conjugate)"].make("coulomb", QUICK)
    assert "structure-feeds-exciter" in judge(wrong.write(tmp_path)).deciding
    with pytest.raises(AssertionError, match="simulated"):
        judge(stepped("coulomb", every=QUICK).write(tmp_path))


def test_noise_is_no_sweep(tmp_path):
    outcome = judge(BY_NAME["noise taken as a swept sine"].make("cubic").write(tmp_path))
    assert outcome.state == "refused"
    assert "no sweep found in the force" in outcome.refusal


@pytest.mark.parametrize("name", ["combined", "coulomb", "cubic", "joint", "quintic"])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_nothing_wrong_is_not_doubted(tmp_path, name, noise):
    outcome = judge(stepped(name, noise, every=QUICK).write(tmp_path))
    assert (outcome.state, outcome.deciding, outcome.refusal) == ("identified", (), "")
