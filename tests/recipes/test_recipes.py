"""The recipes of docs/architecture.md, followed in a copy of the checkout: what they add works for a user."""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from docs._extension.snippets import ROOT, find_snippets
from tests.faults.scratch import Scratch
from tests.programs import python

PAGE = ROOT / "docs" / "architecture.md"
PLACE = re.compile(r"# (?P<file>\S+), (?P<how>below|in place of|new|at its end)(?:: (?P<line>.+))?")

USER = """
import json
from pathlib import Path
import numpy as np
import rsgen as rs
from rsgen.cases.case import case_schema
from rsgen.report.sentences import next_step
from tests.case_files import MEASURED, write_small

# response held at three amplitudes of a septic spring: the force follows from the balance of one harmonic
f = np.tile(np.linspace(8.0, 12.0, 18), 3)
X = np.repeat([1e-3, 2e-3, 3e-3], 18)
omega = 2 * np.pi * f
F = X * (5920 + 35 / 64 * 2e18 * X**6 - 1.5 * omega**2 + 7.5j * omega)
table = np.array([f, F.real, F.imag, X, 0 * X])
with open("held.flt", "wb") as file:
    file.write(b"FLT1" + np.array(table.shape, dtype="<u4").tobytes() + table.tobytes())
lead = {"phase_sense": "lead"}
write_small(Path(), "held", MEASURED | {
    "element": [{"name": "spring", "law": "septic-spring"}, {"name": "damper", "force": "c*v"}],
    "test.file": "held.flt", "test.format": "flt", "test.control": "response", "test.humidity": 0.4,
    "test.frequency": {"column": 1}, "test.force": {"real": 2, "imaginary": 3, **lead},
    "test.response": {"quantity": "displacement", "real": 4, "imaginary": 5, **lead},
    "test.level": {"column": 4}, "identify": {"background": "curved"},
})
case = rs.load_case("held.toml")
surface = rs.read("held.toml")
found = rs.identify(surface, case.model)
drawing = rs.figures.draw_amplitudes(surface)
print(json.dumps({
    "laws": list(rs.laws.names),
    "stiffness": str(rs.derive(rs.laws["septic-spring"]).stiffness),
    "values": {one.name: one.value for one in found.refined},
    "points": len(surface),
    "humidity": case.test.humidity,
    "schema": case_schema(),
    "background": [one.name for one in found.background.estimates],
    "sentences": [rs.sentence(one) for one in found.findings],
    "steps": [next_step(one) for one in found.findings if one.code == "points-few"],
    "drawn": drawing.alternative,
    "bytes": len(drawing.render("svg")),
}))
"""


def follow(block: str, root: Path) -> None:
    first, _, body = block.partition("\n")
    place = PLACE.fullmatch(first)
    assert place is not None, first
    file = root / place["file"]
    if place["how"] == "new":
        assert not file.exists(), first
        file.write_text(body, encoding="utf-8")
        return
    text = file.read_text(encoding="utf-8")
    if place["how"] == "at its end":
        file.write_text(f"{text}\n\n{body}", encoding="utf-8")
        return
    lines = text.split("\n")
    found = [number for number, line in enumerate(lines) if line.strip() == place["line"]]
    assert len(found) == 1, f"{first}: {len(found)} lines"
    above = found[0] + (place["how"] == "below")
    lines[above : found[0] + 1] = body.rstrip("\n").split("\n")
    file.write_text("\n".join(lines), encoding="utf-8")


def run(root: Path, *words: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(root), "RSGEN_CACHE": str(root.parent / "caches")}
    done = python(*words, cwd=root.parent, env=environment, timeout=None)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    """A copy with all additions of the page."""
    copy = Scratch.of(ROOT, tmp_path_factory.mktemp("recipes"))
    for block in find_snippets(PAGE.read_text(encoding="utf-8")):
        if block.kind in ("py", "ini"):
            follow(block.text, copy.root)
    copy.caches.mkdir(mode=0o700)
    return copy


@pytest.fixture(scope="module")
def seen(scratch):
    answer: dict[str, Any] = json.loads(run(scratch.root, "-c", USER))
    return answer


def test_every_addition_is_seen_by_a_user(seen):
    assert "septic-spring" in seen["laws"]
    assert "35" in seen["stiffness"]
    assert seen["values"] == pytest.approx({"k": 5920, "k7": 2e18, "c": 7.5, "m": 1.5}, rel=0.1)
    assert (seen["points"], seen["humidity"], len(seen["steps"])) == (54, 0.4, 1)
    for said in ("'flt'", "'humidity': {'description': 'Of the air; 1 is saturated.'"):
        assert said in str(seen["schema"])
    assert "b2_re" in seen["background"]
    assert "54 points are few to tell one law from another" in seen["sentences"]
    assert seen["drawn"].startswith("Amplitude [m] over Frequency [Hz]: line: ")
    assert seen["bytes"] > 1000


def test_a_command_is_listed_and_runs(scratch, seen):
    assert "How many points a measured test has." in run(scratch.root, "-m", "rsgen", "--help")
    assert run(scratch.root, "-m", "rsgen", "count", "held.toml") == "54 points\n"


COMPLETE = (
    "tests/law/test_law.py::test_the_library_is_a_mapping_that_iterates_over_laws",
    "tests/ranking/test_ranking.py::test_every_law_of_the_library_takes_part",
    "tests/attacks/test_readers.py::test_every_format_is_attacked",
    "tests/attacks/test_readers.py::test_good_files_are_read[flt]",
    "tests/report/test_wording.py::test_every_sentence_can_be_said[1.0]",
    "tests/report/test_wording.py::test_every_next_step_is_one_full_sentence",
    "tests/figures/test_figures.py::test_drawing_is_whole[amplitudes]",
    "tests/cli/test_cli.py::test_every_command_has_an_example[count]",
)
"""Tests of all laws, formats, findings, figures and commands; the page names what else they ask for."""


@pytest.mark.thorough
def test_the_tests_of_completeness_pass(scratch):
    ran = scratch.run(COMPLETE)
    assert ran.failed == ()
    assert ran.broken == ""
