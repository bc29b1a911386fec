"""Files that earlier versions wrote are read, say the same, and compare: docs/stability.md.

``tests/stability/NUMBER-NAME`` has cases with their results, written by the version that brought NAME within
the schema NUMBER. A file there is never renewed.
"""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

import rsgen
from rsgen.app.cli.diff_command import compare_results, is_worse
from rsgen.cases.case import CaseDocument
from rsgen.common.errors import CaseError, MeasurementError
from rsgen.common.finding import Finding, Quantity
from rsgen.data.surface.response_surface import SURFACE_SCHEMA
from rsgen.files.files_to_surface import read_measurement
from rsgen.report.page import write_index
from rsgen.report.result_json import SCHEMA, read_results
from tests.samples import write_result

HERE = Path(__file__).parent / "stability"
VERSIONS = sorted(path.name for path in HERE.iterdir())
SMALL, TABLE = "small", "csv-table"
RESULTS = [(version, path.name) for version in VERSIONS for path in sorted((HERE / version).iterdir())]


def test_files_of_every_schema_are_kept():
    numbers = {int(version.split("-")[0]) for version in VERSIONS}
    (of_cases,) = CaseDocument.model_fields["schema_version"].annotation.__args__
    for current in (SCHEMA, SURFACE_SCHEMA, of_cases):
        assert set(range(1, current + 1)) <= numbers


@pytest.mark.slow
@pytest.mark.parametrize(("version", "case"), RESULTS)
@pytest.mark.usefixtures("read_here")
def test_an_earlier_surface_is_read(version, case):
    surface = rsgen.load_surface(HERE / version / case / "surface.h5")
    counts = json.loads((HERE / version / case / "result.json").read_text(encoding="utf-8"))["surface"]
    assert (len(surface), np.count_nonzero(surface.settled)) == (counts["points"], counts["settled"])
    assert (surface.control, surface.phase_known, surface.level_unit) == ("force", True, "N")
    assert surface.levels.tolist() == ([2.0, 8.0] if case == SMALL else [1.0, 3.0, 6.0])


@pytest.mark.parametrize(("version", "case"), RESULTS)
def test_an_earlier_case_means_the_same(version, case):
    loaded = rsgen.load_case(HERE / version / case / "case.toml")
    assert loaded.name == case
    if case == TABLE:
        surface = read_measurement(loaded.test)
        earlier = rsgen.load_surface(HERE / version / case / "surface.h5")
        np.testing.assert_allclose(surface.harmonics[:, 1], earlier.harmonics[:, 1], rtol=1e-12)
    else:
        assert loaded.oscillator.mass == 1.5
        assert dict(loaded.truth) == {"m": 1.5, "k1": 6000.0, "kn1": 4e5, "c1": 4.0}
        assert dict(loaded.accept) == {"m": 0.01, "k1": 0.01, "kn1": 0.1, "c1": 0.05}
        assert loaded.test.noise_relative == 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_earlier_results_have_their_verdict_and_stand_in_the_index(version, tmp_path):
    states = {entry.folder.name: entry.verdict["state"] for entry in read_results(HERE / version)}
    expected = {SMALL: "accepted", TABLE: "identified"}
    assert states == {place.name: expected[place.name] for place in (HERE / version).iterdir()}
    shutil.copytree(HERE / version, tmp_path / "out")
    write_index(tmp_path / "out")
    assert "A small test of a hardening spring" in (tmp_path / "out" / "index.html").read_text("utf-8")


@pytest.mark.parametrize("version", VERSIONS[1:])
def test_earlier_results_compare_with_later_ones(version):
    small, _ = compare_results(HERE / VERSIONS[0] / SMALL, HERE / version / SMALL)
    assert {row.name for row in small} == {"m", "k1", "kn1", "c1"}
    assert not is_worse(small)
    assert [fit.verdict.state for fit in small.fits] == ["accepted", "accepted"]


def test_a_number_that_is_not_known_is_refused_by_name(tmp_path):
    folder = HERE / VERSIONS[-1] / SMALL
    text = (folder / "case.toml").read_text(encoding="utf-8")
    (tmp_path / "case.toml").write_text(text.replace("schema = 1", "schema = 7"), encoding="utf-8")
    with pytest.raises(CaseError, match=r"schema: is 7; 1 is needed"):
        rsgen.load_case(tmp_path / "case.toml")
    shutil.copy(folder / "surface.h5", tmp_path)
    with h5py.File(tmp_path / "surface.h5", "r+") as file:
        file.attrs["schema"] = 7
    with pytest.raises(MeasurementError, match=r"surface\.h5: is of schema 7; 1 is needed"):
        rsgen.load_surface(tmp_path / "surface.h5")
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    write_result(tmp_path, result | {"schema": 7})
    assert read_results(tmp_path) == []


def test_a_doubt_of_schema_1_stands_under_the_code_of_today(tmp_path):
    folder = HERE / "1-verdict" / SMALL
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    doubt = Finding("run-set-aside", "doubt", numbers={"level": Quantity(2.0, "N"), "aside": 20.0}).to_dict()
    words = {"sentences": ["This run disagrees."], "next_steps": [""], "headline": "Doubtful"}
    result["verdict"] = {"state": "doubtful", "decided_by": [doubt], **words}
    place = write_result(tmp_path, result)
    (entry,) = read_results(tmp_path)
    assert [decided["code"] for decided in entry.verdict["decided_by"]] == ["points-excluded"]
    small, _ = compare_results(folder, place)
    assert [finding.code for finding in small.fits[1].verdict.decided_by] == ["points-excluded"]
    assert is_worse(small)
