"""Workbooks with a sheet for each level: all are drafted, and called by the volts in their names."""

import numpy as np
import pytest

from rsgen.app.cli.inspect_command import proposal_text
from rsgen.cases.loading import load_case, read
from rsgen.common.errors import CaseError, MeasurementError
from tests.inspection.drafts import FREQUENCY, RECEPTANCE, drafted, is_receptance
from tests.surfaces import severities

VOLTS = {0.25: 1.0, 0.5: 1.8, 1.0: 3.2, 1.4: 4.4}
"""Forces [N] by the volts of the drive."""
TITLES = ("Frequency [Hz]", "Force [N]", "Displacement [m]", "Phase [deg]")


@pytest.fixture(scope="module")
def book(tmp_path_factory):
    """Write a workbook; return it and the tables of its draft without questions."""
    openpyxl = pytest.importorskip("openpyxl", reason="no openpyxl here: install rsgen[xlsx]")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for volts, force in VOLTS.items():
        sheet = book.create_sheet(f"{volts:g} V")
        # stepped downwards
        motion, forces = force * RECEPTANCE[::-1], np.full(len(FREQUENCY), force)
        columns = (FREQUENCY[::-1], forces, np.abs(motion), np.angle(motion, deg=True))
        for row in (TITLES, *np.transpose(columns).tolist()):
            sheet.append(list(row))
    background = book.create_sheet("Background")
    for row in (["Frequency [Hz]", "Noise [V]"], [1.0, 2.0], [2.0, 3.0]):
        background.append(row)
    path = tmp_path_factory.mktemp("book") / "book.xlsx"
    book.save(path)
    tables = proposal_text(drafted(path))
    confirmed = "\n".join(line.partition(" # TODO")[0] for line in tables.split("\n"))
    law = '[[element]]\nname = "all"\nforce = "k*x + c*v"\n'
    return path, f'schema = 1\nname = "book"\ntitle = "book"\n{law}{confirmed}\n'


@pytest.fixture
def draft(book):
    """Return a function that writes the draft with other texts, and tables behind it."""
    path, text = book

    def changed(*pairs, more=""):
        new = text
        for old, by in pairs:
            assert old in new
            new = new.replace(old, by)
        case = path.with_suffix(".toml")
        case.write_text(new + more, encoding="utf-8")
        return case

    return changed


LEVEL = 'name = "{level} V"'
HELD = '[identify]\nhold_out = ["1 V"]\n'


def test_sheets_with_the_same_titles_are_levels_called_by_their_names(draft, run_cli):
    case = draft(more=HELD)
    surface = read(load_case(case))
    assert np.unique(surface.label).tolist() == [*VOLTS]
    assert surface.levels == pytest.approx([*VOLTS.values()], rel=1e-3)
    assert is_receptance(surface)
    held = surface.held_out(load_case(case).observation.hold_out)
    assert set(surface.label[held]) == {1.0}
    assert run_cli("check", case).out.endswith("note: not read of book.xlsx: Background/*\n")
    lags = next(line for line in case.read_text(encoding="utf-8").splitlines() if "Phase [deg]" in line)
    of_first = [(f"* V/{title}", f"0.25 V/{title}") for title in TITLES]
    first = draft(*of_first, (LEVEL, ""), ('unit = "label"', ""))
    assert "not read of book.xlsx: 0.5 V/*, 1 V/*, 1.4 V/*, Background/*" in run_cli("check", first).out
    sizes = draft((lags, "phase_known = false"), ("phase_sense", "# phase_sense"))
    assert "not read of book.xlsx: */Phase [deg], Background/*" in run_cli("check", sizes).out


@pytest.mark.parametrize(("values", "fault"), [
    ("[0.25, 0.5, 1, 1.4]", ""), ('["0.25 V", "0.5 V", "1 V", "1.4 V"]', ""),
    # of labels in two units the numbers alone are in another order
    ('["250 mV", "0.5 V", "1 V", "1.4 V"]', "is in V"),
])  # fmt: skip
def test_labels_may_be_written_as_the_sheets_are_called(draft, values, fault):
    case = draft((LEVEL, f"values = {values}"))
    if fault:
        with pytest.raises(CaseError, match=fault):
            load_case(case)
    else:
        assert np.unique(read(load_case(case)).label).tolist() == [*VOLTS]


def test_volts_that_nothing_calls_a_level_lead_to_labels(draft):
    with pytest.raises(CaseError, match=r'unit = "label" under .* name = "\{level\} V"'):
        load_case(draft((LEVEL, ""), ('unit = "label"', ""), more=HELD))
    with pytest.raises(MeasurementError, match=r"'0.25 V': its name is not of the form"):
        read(load_case(draft((LEVEL, 'name = "{level} mV"'))))


@pytest.mark.parametrize(("values", "sentences"), [
    # sheets say it, whatever the forces
    ("[0.5, 0.25, 1, 1.4]", ["the level of 0.25 V is given as 0.5, but its name has another"]),
    # forces say it, where no sheet has the number; whole numbers may count the runs
    ("[1.5, 1.1, 0.6, 0.3]", ["the level of 0.3 was driven harder than that of 0.6"]),
    ("[4, 3, 2, 1]", []),
])  # fmt: skip
def test_labels_in_another_order_than_sheets_or_forces_are_a_doubt(draft, values, sentences):
    findings = read(load_case(draft((LEVEL, f"values = {values}")))).findings
    found = [one for one in findings if one.code == "levels-swapped"]
    falls = ["they fall as the labels rise" in str(one) for one in findings if one.code == "levels-disagree"]
    assert falls == [values != "[0.5, 0.25, 1, 1.4]"]
    assert [finding.severity for finding in found] == ["doubt"] * len(sentences)
    assert all(text in str(finding) for finding, text in zip(found, sentences, strict=True))


@pytest.mark.parametrize(("direction", "said"), [("up", "doubt"), ("down", None)])
def test_rows_that_descend_were_hardly_swept_up(draft, direction, said):
    surface = read(load_case(draft(more=f'[test.sweep]\ndirection = "{direction}"\n')))
    assert severities(surface).get("direction-from-branch") == said


def test_the_force_of_one_sheet_beside_responses_of_all_is_refused(draft):
    case = draft(('"* V/Force [N]"', '"0.25 V/Force [N]"'))
    with pytest.raises(CaseError, match=r"test.force: '0.25 V/Force \[N\]' is of one sheet, others are"):
        load_case(case)
