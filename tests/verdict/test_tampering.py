"""A test with one thing wrong is doubted for the right reason, and one with nothing wrong is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.verdict.laboratory import judge, stepped
from tests.verdict.tampering import TAMPERINGS

QUICK = 6
"""Every sixth frequency of a case: some twenty a level."""

BY_NAME = {entry.name: entry for entry in TAMPERINGS}

DOUBTED = [
    ("cubic", "one level in g, read as m/s^2", "law-does-not-fit"),
    ("cubic", "response in g, read as m/s^2; mass known", "law-does-not-fit"),
    ("cubic", "two levels swapped", "law-does-not-fit"),
    ("quintic", "labels 1, 2, 3, ... for the forces", "law-does-not-fit"),
    ("combined", "the same force at every level", "law-does-not-fit"),
    ("cubic", "one level twice, once under another force", "law-does-not-fit"),
    ("coulomb", "half of a level's points from another level", "law-does-not-fit"),
    ("quintic", "frequencies of one level 2 % too high", "law-does-not-fit"),
    ("quintic", "a second mode in the band", "law-does-not-fit"),
    ("cubic", "a constant background left out", "law-does-not-fit"),
    ("combined", "law without the decisive term", "law-does-not-fit"),
    ("coulomb", "law without the decisive term", "law-does-not-fit"),
]
"""Case, tampering, and the code of a finding that must decide."""


@pytest.mark.parametrize(("name", "wrong", "code"), DOUBTED)
def test_one_thing_wrong_is_doubted(tmp_path: Path, name: str, wrong: str, code: str) -> None:
    outcome = judge(BY_NAME[wrong].make(name, QUICK).write(tmp_path))
    assert outcome.state in ("doubtful", "rejected")
    assert code in outcome.deciding


def test_noise_is_no_sweep(tmp_path: Path) -> None:
    outcome = judge(BY_NAME["noise taken as a swept sine"].make("cubic").write(tmp_path))
    assert outcome.state == "refused"
    assert "no sweep found in the force" in outcome.refusal


@pytest.mark.parametrize("name", ["combined", "coulomb", "cubic", "joint", "quintic"])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_nothing_wrong_is_not_doubted(tmp_path: Path, name: str, noise: float) -> None:
    outcome = judge(stepped(name, noise, every=QUICK).write(tmp_path))
    assert (outcome.state, outcome.deciding, outcome.refusal) == ("identified", (), "")
