"""Rows that are read many at once are what they are line by line: numbers, lines, blocks and faults."""

from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsgen.common.errors import MeasurementError
from rsgen.files import Layout
from rsgen.files import text_columns as text_lines
from rsgen.files.text_columns import Columns, read_columns

NUMBERS = st.floats(allow_nan=False, allow_infinity=False).map(repr) | st.sampled_from(
    ["0", "-0", "+1.", ".5", "1E3", "007", " 2 ", "\t3", "1e-400", "4.9e-324", "9" * 30]
)
ODD = (
    ["", " ", "nan", "NA", "-", "1e999", "1,5", "1.5.5", "e5", "+-1", "0x1", "1_0", "word", "9" * 401,
     "0" * 401, "1.5", "1 2", '"1"', "1\r2", "\x00", "-1-1", "2024-01-02", "#", "%1"]
)  # fmt: skip
"""Cells that are no plain numbers, or look like ones."""
OTHERS = st.sampled_from(ODD)


@st.composite
def tables(draw: st.DrawFn) -> tuple[bytes, Layout]:
    """Draw a file of two columns, most rows of it plain, and its layout."""
    delimiter = draw(st.sampled_from([",", ";", "\t", "|", "whitespace"]))
    decimal = draw(st.sampled_from([".", ","])) if delimiter != "," else "."
    between = " " if delimiter == "whitespace" else delimiter
    cells = st.one_of(*[NUMBERS] * 12, OTHERS)
    row = st.tuples(cells, cells).map(between.join)
    rows = draw(st.lists(st.one_of(*[row] * 8, st.sampled_from(["", "  ", "# note", "1", "1;2;3", "a;b"]))))
    if decimal == ",":
        rows = [row.replace(".", ",") for row in rows]
    end = draw(st.sampled_from(["\n", "\r\n"]))
    text = end.join([f"f{between}x", f"1{between}2", *rows]) + draw(st.sampled_from(["", end]))
    comments = draw(st.sampled_from([("#",), ("-",), ("#", "%")]))
    return text.encode(), Layout(delimiter, decimal, comments)


def found(path: Path, layout: Layout, bytes_at_once: int, plain: bool) -> Columns | str:
    """Read both columns in blocks of some size, or line by line; a fault as its sentence."""
    with patch.object(text_lines, "BLOCK_BYTES", bytes_at_once):
        try:
            if plain:
                return read_columns(path, layout, [2, 1])
            with patch("rsgen.files.text_columns.plain_rows", lambda *_: None):
                return read_columns(path, layout, [2, 1])
        except MeasurementError as fault:
            return str(fault)


@given(table=tables(), size=st.sampled_from([1, 7, 64, 1 << 18]))
def test_blocks_change_nothing(table, size):
    content, layout = table
    equal_however_read(content, layout, size)


@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", ","), ("|", "."), ("whitespace", ",")],
)
@pytest.mark.parametrize("cell", ODD)
def test_one_odd_cell_changes_nothing(cell, delimiter, decimal):
    between = " " if delimiter == "whitespace" else delimiter
    for column in (0, 1):
        rows = [["1", "2"], ["3", "4"], ["5", "6"], ["7", "8"]]
        rows[2][column] = cell
        content = "".join(between.join(row) + "\n" for row in rows).encode()
        equal_however_read(content, Layout(delimiter, decimal), 1 << 18)


def equal_however_read(content: bytes, layout: Layout, size: int) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes(content)
        once, slowly = (found(path, layout, size, plain) for plain in (True, False))
    if isinstance(once, str) or isinstance(slowly, str):
        assert once == slowly
        return
    assert once.values.tobytes() == slowly.values.tobytes()
    for name in ("line", "block"):
        np.testing.assert_array_equal(getattr(once, name), getattr(slowly, name))
    assert [getattr(once, name) for name in ("names", "words", "spans", "ended")] == [
        getattr(slowly, name) for name in ("names", "words", "spans", "ended")
    ]
