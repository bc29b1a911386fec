"""The [test] table of a measured case: units become factors, the data file stays inside its folder."""

import pytest

from rsgen.cases import load_case
from rsgen.common.errors import CaseError
from tests.case_files import MEASURED, write_small

CASE = {
    **MEASURED, "test.file": "d.csv", "test.frequency": {"column": 1}, "test.force": {"amplitude": 2},
    "test.response": {"quantity": "displacement", "real": 3, "imaginary": 4, "phase_sense": "lead"},
}  # fmt: skip


def case(folder, **changes):
    """Load the case with changes by the last two parts of their key: response_unit is test.response.unit."""
    return load_case(
        write_small(folder, "case", CASE | {f"test.{k.replace('_', '.')}": v for k, v in changes.items()})
    )


def test_without_a_scale_any_unit_will_do(tmp_path):
    with pytest.raises(CaseError, match=r"test\.force"):
        case(tmp_path, force_unit="V")
    changes = CASE | {"test.force.unit": "V", "identify": {"calibrated": False}}
    relative = load_case(write_small(tmp_path, "case", changes))
    assert relative.test.factor("force") == 1.0
    assert not relative.model.observation.calibrated


def test_data_folders(tmp_path, monkeypatch):
    monkeypatch.delenv("RSGEN_DATA", raising=False)
    elsewhere = tmp_path / "laboratory"
    elsewhere.mkdir()
    assert case(tmp_path).test.file == tmp_path / "d.csv"
    monkeypatch.setenv("RSGEN_DATA", str(elsewhere))
    (tmp_path / "d.csv").write_text("")
    assert case(tmp_path).test.file == tmp_path / "d.csv"
    (elsewhere / "d.csv").write_text("")
    assert case(tmp_path).test.file == elsewhere / "d.csv"
    assert load_case(tmp_path / "case.toml", data=tmp_path).test.file == tmp_path / "d.csv"
