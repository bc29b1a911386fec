"""Headers of spreadsheets as laboratories write them: real and imaginary parts, quantity over unit."""

import time
from pathlib import Path

import numpy as np
import pytest

from rsgen.files.inspection.proposal import propose
from rsgen.files.tree import Contents, Entry
from tests.inspection.drafts import FREQUENCY, RECEPTANCE, is_receptance, read_draft, write_table

MILLI = 1e3 * RECEPTANCE
"""Displacement over force in millimetres."""


@pytest.mark.slow
@pytest.mark.parametrize(("real", "imaginary"), [
    ("Re [mm]", "Im [mm]"), ("real_mm", "imag_mm"), ("Real (mm)", "Imaginary (mm)"),
    ("x_re_mm", "x_im_mm"), ("Re(x) [mm]", "Im(x) [mm]"), ("Re{X} [mm]", "Im{X} [mm]"),
    ("xRe [mm]", "xIm [mm]"), ("ReX/mm", "ImX/mm"), ("Realteil [mm]", "Imaginärteil [mm]"),
    ("disp real part (mm)", "disp imag part (mm)"), ("x.r [mm]", "x.i [mm]"),
    ("In-phase (mm)", "Quadrature (mm)"),
])  # fmt: skip
@pytest.mark.parametrize("order", [1, -1])
def test_real_and_imaginary_part_of_the_response(tmp_path, real, imaginary, order):
    head = ",".join(["f [Hz]", "F [N]", *[real, imaginary][::order]])
    parts = [MILLI.real, MILLI.imag][::order]
    path = write_table(tmp_path / "a.csv", head, lambda level: [level, *(level * part for part in parts)])
    tables, surface, _ = read_draft(path)
    assert (tables["response"]["real"], tables["response"]["imaginary"]) == (real, imaginary)
    assert is_receptance(surface)


@pytest.mark.parametrize("titles", [
    ("x@{}N [mm]", "phi@{}N [deg]"),
    ("x_{}N_mm", "phase_{}N_deg"),
    ("Re {} N [mm]", "Im {} N [mm]"),
    ("x_re_mm F={}N", "x_im_mm F={}N"),
])  # fmt: skip
def test_levels_side_by_side_are_read(tmp_path, titles):
    in_parts = "im" in titles[1].casefold()
    parts = (MILLI.real, MILLI.imag) if in_parts else (np.abs(MILLI), np.angle(MILLI, deg=True))
    columns = {"f [Hz]": FREQUENCY}
    for level in ("5", "1", "2.5"):
        columns[titles[0].format(level)] = float(level) * parts[0]
        columns[titles[1].format(level)] = (float(level) if in_parts else 1.0) * parts[1]
    path = tmp_path / "a.csv"
    rows = [";".join(f"{value:.9g}" for value in row) for row in np.transpose([*columns.values()])]
    # a level that ends earlier leaves its cells empty
    rows[-1] = ";".join([*rows[-1].split(";")[:-2], "", ""])
    path.write_text("\n".join([";".join(columns), *rows, ""]), encoding="utf-8")
    tables, surface, _ = read_draft(path)
    assert tables["level"] == {"values": ["5 N", "1 N", "2.5 N"]}
    assert surface.levels.tolist() == [1.0, 2.5, 5.0]
    count = len(FREQUENCY)
    assert [int(np.sum(surface.level == level)) for level in surface.levels] == [count, count - 1, count]
    assert is_receptance(surface)


@pytest.mark.slow
@pytest.mark.parametrize("title", [
    "H{} x", "phase {}", pytest.param("acc {}", marks=pytest.mark.thorough),
    pytest.param("base acc {}", marks=pytest.mark.thorough),
])  # fmt: skip
def test_a_draft_of_thousands_of_columns_takes_no_time(title):
    names = ["freq", *(title.format(number) for number in range(9000)), "acc tip", "acc root"]
    entries = tuple(Entry(name, (20,), "float64", low=0.0, high=1.0) for name in names)
    begun = time.process_time()
    assert propose(Contents(Path("a.csv"), "csv", entries)) is not None
    # each compared with each: 10 s
    assert time.process_time() - begun < 5
