"""What the page of verdicts is made of: codes of tampered tests, and the campaign of random tests."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import campaign
from benchmarks.tampered_measurements import OF_CASE
from rsgen.report.wording.sentences import CODES
from tests.verdict.tampering import TAMPERINGS, UNSEEN

LAW = "hardening"
"""Linear in all its parameters: a test of it takes a tenth of a second."""


def test_a_tampered_test_asks_for_findings_that_there_are() -> None:
    entries = [*TAMPERINGS, *UNSEEN, *(entry for entries in OF_CASE.values() for entry in entries)]
    assert {code for entry in entries for code in entry.right} <= set(CODES)
    assert {entry.corrected for entry in entries} - {""} <= set(CODES)


def test_a_kind_and_a_seed_are_one_test() -> None:
    one, same, other = (campaign.draw(seed) for seed in (9, 9, 10))
    assert (one.truth, one.test.seed) == (same.truth, same.test.seed)
    assert one.truth != other.truth


@pytest.mark.parametrize(("kind", "extra"), [("too many", "fitted"), ("missing", "truth")])
def test_a_term_more_or_less_is_in_one_of_the_two_laws(kind: str, extra: str) -> None:
    row = campaign.run(kind, 3, [LAW])
    laws = {"fitted": row.drawn.fitted, "truth": row.drawn.truth.law}
    assert [name for name, law in laws.items() if "more*" in law] == [extra]
    assert {"k", "m"} <= set(row.deviation)
    assert not row.wrong


def test_a_calm_result_far_from_the_truth_is_wrong_unless_it_is_doubted() -> None:
    row = campaign.run("right", 3, [LAW])
    assert row.identified
    assert not row.wrong
    far = replace(row, deviation={**row.deviation, "k3": -4.1})
    assert far.wrong
    assert not replace(far, state="doubtful").wrong
    assert not far.stated
    assert replace(far, codes=far.codes | {"mirror-image-fits"}).stated


def test_the_section_says_seeds_and_counts_each_kind() -> None:
    rows = [campaign.run(kind, seed, [LAW]) for kind in ("right", "wrong mass") for seed in (3, 4)]
    far = replace(rows[0], deviation={"k": 9.0}, covered={"k": False})
    text = "\n".join(campaign.section([far, *rows[1:]]))
    assert text.startswith(campaign.HEADING)
    assert "Seeds 3 to 4 of each kind" in text
    assert "| right | " in text
    assert "| wrong mass | " in text
    assert "| two levels | " not in text
    cells = [line.split(" | ") for line in text.splitlines() if line.startswith(("| right", "| wrong"))]
    assert sum(int(row[2]) for row in cells) == 4
    assert [int(row[6]) for row in cells if row[0] == "| right"].count(1) == 1
    assert "0 of 4 beyond" in text


def test_writing_renews_one_section_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "verdicts.md"
    others = "# Verdicts\n\nHead.\n\n## One thing wrong\n\nTable.\n"
    page.write_text(others, encoding="utf-8")
    monkeypatch.setattr(campaign, "REPORT", page)
    arguments = ["campaign", "--kind", "right", "--law", LAW, "--tests", "1", "--write"]
    for seed in ("3", "4"):
        monkeypatch.setattr(sys, "argv", [*arguments, "--seed", seed])
        campaign.main()
    text = page.read_text(encoding="utf-8")
    assert text.startswith(others)
    assert text.count(campaign.HEADING) == 1
    assert "Seed 4 of each kind" in text


@pytest.mark.parametrize("after", ["", "## Nothing wrong\n\nTable.\n"])
def test_a_section_stays_where_it_is(after: str) -> None:
    before = "# Verdicts\n\nHead.\n\n"
    old, new = f"{campaign.HEADING}\n\nOld.\n", [campaign.HEADING, "", "New."]
    text = campaign.renewed("\n".join(filter(None, [before + old, after])), new)
    assert text == "\n".join(filter(None, [f"{before}{campaign.HEADING}\n\nNew.\n", after]))
    assert campaign.renewed(text, new) == text
