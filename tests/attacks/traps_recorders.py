"""Traps in the files of recorders: LabVIEW's text and TDMS, Excel workbooks, sound files."""

import io
import struct
import zipfile
from pathlib import Path

from numpy.random import Generator

from tests.attacks.good_files import good, power_of_ten

_SIZES = (0, 1, 2, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1)
_SHEET = b'<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>'
CELL = b'<row r="%d"><c r="%s"><v>1</v></c></row>'


def labview(folder: Path, rng: Generator) -> bytes:
    """Segments and columns by the thousand, heads without an end, special blocks, other separators."""
    text = good("lvm", folder)
    head, _, rows = text.partition(b"X_Value")
    kind = int(rng.integers(6))
    if kind == 0:
        return text + b"Channels\t1\n***End_of_Header***\t\nX_Value\ta\n1\t2\n" * power_of_ten(rng, 1, 4.3)
    if kind == 1:
        return head + b"X_Value" + b"\ta" * power_of_ten(rng, 1, 5) + b"\n" + b"1\t" * power_of_ten(rng, 1, 5)
    if kind == 2:
        return head + b"***Start_Special***\n" * power_of_ten(rng, 1, 5) + b"X_Value" + rows
    if kind == 3:
        return text.replace(b"\t", bytes(rng.choice([b";", b",", b" ", b"", b"\x00"])))
    if kind == 4:
        return head + b"X_Value\ta\n" + b"7" * power_of_ten(rng, 3, 6) + b"\t1\n"
    return head + b"X_Value\ta\n" + b"\t\n\n1e999\tnan\n-\t1,5\n" * power_of_ten(rng, 1, 5)


def sound(folder: Path, rng: Generator) -> bytes:
    """Sizes, channels, bits and rates that do not fit the samples; parts by the thousand."""
    words = [int(rng.choice(_SIZES)) for _ in range(4)]
    kind, bits = int(rng.choice([0, 1, 3, 85, 0xFFFE])), int(rng.choice([0, 1, 8, 16, 24, 32, 64, 65535]))
    form = struct.pack("<HHIIHH", kind, words[0] % 2**16, words[1], words[2], words[3] % 2**16, bits)
    form += bytes(int(rng.choice([0, 2, 24, 5000])))
    parts = b"LIST" + struct.pack("<I", int(rng.choice(_SIZES)))
    begin = bytes(rng.choice([b"RIFF", b"RF64", b"RIFX"]))
    begin += struct.pack("<I", int(rng.choice(_SIZES))) + b"WAVE"
    size = struct.pack("<I", int(rng.choice([*_SIZES, 64])))
    other = parts * int(rng.choice([0, 1, 5000]))
    return begin + other + b"fmt " + struct.pack("<I", len(form)) + form + b"data" + size + rng.bytes(64)


def tdms(folder: Path, rng: Generator) -> bytes:
    """A good file in which some words of four and eight bytes in the heads of segments are extreme."""
    content = bytearray(good("tdms", folder))
    for _ in range(int(rng.integers(1, 4))):
        width = int(rng.choice([4, 8]))
        value = int(rng.choice([0, 1, 2**31 - 1, 2**32 - 1, 10**6])) * (2**31 if width == 8 else 1)
        place = int(rng.integers(4, 400))
        content[place : place + width] = (value % 2 ** (8 * width)).to_bytes(width, "little")
    return bytes(content) * int(rng.choice([1, 1, 300]))


def workbook(folder: Path, rng: Generator) -> bytes:
    """Sheets of blanks, of far cells, of rows and texts by the hundred thousand, of entities, or cut off."""
    kind, count = int(rng.integers(7)), power_of_ten(rng, 3, 5.5)
    body = [
        b" " * power_of_ten(rng, 6, 8), CELL % (int(rng.choice([10**5, 2**20, 10**15])), b"A1"),
        b"".join(CELL % (n, b"XFD%d" % n) for n in range(1, min(count, 20_000))),
        b"".join(CELL % (n, b"A%d" % n) for n in range(1, count)),
        b"<row><c><v>" + b"7" * count + b"</v></c></row>", b"<row>" * min(count, 50_000),
        b'<row r="-1"><c r="1A" t="s"><v>99999</v></c><c t="b"><v>x</v></c><c t="d"><v>?</v></c></row>',
    ][kind]  # fmt: skip
    return with_sheet(folder, body)


def with_sheet(
    folder: Path, body: bytes, before: bytes = b"", end: bytes = b"</sheetData></worksheet>"
) -> bytes:
    """Put rows, as XML, in place of those of the first sheet of a good workbook."""
    changed = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(good("xlsx", folder))) as old,
        zipfile.ZipFile(changed, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name in old.namelist():
            sheet = name.endswith("sheet1.xml")
            new.writestr(name, before + _SHEET + body + end if sheet else old.read(name))
    return changed.getvalue()
