"""Many rows of plain numbers at once, in compiled code; whatever else a row may hold is read line by line."""

from __future__ import annotations

import io
import re

import numpy as np

from rsgen.common.arrays import Array
from rsgen.files.text_cells import LONGEST_NUMBER

__all__ = ["PLAIN", "plain_rows"]

PLAIN = "0123456789eE+-.,;| \t\r\n"
"""Signs of rows of plain numbers. Without letters but e, and without underscores, a cell that Python or NumPy
converts is a plain number."""

_PLAIN = PLAIN.encode()
_LONG = re.compile(rb"[0-9eE+\-.]{%d}" % (LONGEST_NUMBER + 1))


def plain_rows(block: bytes, delimiter: str, decimal: str) -> Array | None:
    """Read rows of equally many plain finite numbers.

    Parameters
    ----------
    block
        Whole lines.
    delimiter
        Between two cells, or "whitespace".
    decimal
        "." or ",".

    Returns
    -------
    Array or None
        (lines, cells), as Python's float reads each cell. None where any line is something else: empty, of
        another number of cells, a cell empty, of words, too long or beyond the range of a double.
    """
    if block.translate(None, _PLAIN) or not block.strip():
        return None
    if decimal == ",":
        if b"." in block:
            return None
        block = block.replace(b",", b".")
    ends = np.flatnonzero(np.frombuffer(block, dtype=np.uint8) == ord("\n"))
    rows = len(ends) + (not block.endswith(b"\n"))
    lengths = np.diff(ends, prepend=-1, append=len(block))
    if lengths.max() > LONGEST_NUMBER and _LONG.search(block):
        return None
    try:
        values = np.loadtxt(
            io.BytesIO(block),
            delimiter=None if delimiter == "whitespace" else delimiter,
            comments=None,
            ndmin=2,
            encoding="ascii",
        )
    except ValueError:
        return None
    # NumPy passes over empty lines, which end a block of rows here, and ends a line at a carriage return
    return values if len(values) == rows and np.isfinite(values).all() else None
