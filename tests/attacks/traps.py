"""Files made to hurt a reader: small ones that declare, unpack to, refer to or repeat what is too much."""

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse
from numpy.random import Generator

from tests.attacks.good_files import arrays, good, power_of_ten, universal
from tests.attacks.texts import pick
from tests.attacks.traps_hdf5 import hdf5_declared, hdf5_outside, hdf5_tree, surface
from tests.attacks.traps_recorders import labview, sound, tdms, workbook

Trap = Callable[[Path, Generator], bytes]
LINES = (b"1" * 900_000, b"1," * 400_000, b"(" * 900_000, b" " * 900_000, b"[a" * 400_000, b"-" * 900_000)


def _npy_head(text: bytes, version: int = 1, declared: int | None = None) -> bytes:
    size = len(text) if declared is None else declared
    packed = struct.pack("<H" if version == 1 else "<I", size % 2 ** (16 if version == 1 else 32))
    return b"\x93NUMPY" + bytes([version, 0]) + packed + text


def long_number(folder: Path, rng: Generator) -> bytes:
    digits = b"7" * power_of_ten(rng, 2, 5.95)
    digits += bytes(rng.choice([b"", b"x", b"e5", b".5", b"e" + b"9" * 50]))
    return b"f,F,x\n1,2,3\n" + digits + b",2,3\n" + b"1,2,3\n" * 20


def long_lines(folder: Path, rng: Generator) -> bytes:
    line = pick(rng, LINES)[: power_of_ten(rng, 3, 5.9)]
    return b"\n".join([line] * min(8 * 10**6 // len(line), power_of_ten(rng, 0, 4))) + b"\n1,2,3\n"


def line_without_end(folder: Path, rng: Generator) -> bytes:
    return b"1.5 " * power_of_ten(rng, 5, 7.69 if rng.random() < 0.1 else 6.3)


def many_columns(folder: Path, rng: Generator) -> bytes:
    columns = power_of_ten(rng, 2, 4.3)
    row = b",".join([b"1.5"] * columns)
    rows = [row] * max(2, min(2000, 2 * 10**6 // len(row)))
    if rng.random() < 0.7:
        rows[-1] = row.replace(b"1.5", b"1x5", 1)
    return b"\n".join(rows) + b"\n"


def words_and_numbers(folder: Path, rng: Generator) -> bytes:
    rows = [b"1,2,3,4" if rng.random() < 0.5 else b"f,F,x,y" for _ in range(power_of_ten(rng, 1, 5))]
    return b"\n".join(rows) + b"\n"


def titles(folder: Path, rng: Generator) -> bytes:
    units = (b"m^999999999", b"m" * 50_000, b"(" * 9000, b"1/" * 5000 + b"s", b"kg**-1e9", b"10^400 m",
             b"\xff\xfe m")  # fmt: skip
    return b"f [Hz],F [N],x [" + pick(rng, units) + b"],y\n" + b"8.5,1,1e-3,1e-4\n" * 30


def other_encodings(folder: Path, rng: Generator) -> bytes:
    content = good("csv", folder)
    ends = [b"\r", b"\r\n", b"\n\r", b"\x0b", b"\xe2\x80\xa8"]
    ways: list[Callable[[], bytes]] = [
        lambda: content.decode().encode("utf-16"),
        lambda: b"\xff\xfe" + content,
        lambda: content.decode().encode("utf-32"),
        lambda: content.replace(b"\n", bytes(rng.choice(ends))),
        lambda: content.replace(b",", b"\x00" if rng.random() < 0.5 else "\u066b".encode()),
        lambda: b"\xef\xbb\xbf" + content.replace(b"1", "\u0661".encode()),
    ]
    return pick(rng, ways)()


def many_rows(folder: Path, rng: Generator) -> bytes:
    return b"1,2,3,4\n" * power_of_ten(rng, 4, 6.05)


def npy_head(folder: Path, rng: Generator) -> bytes:
    """A head that declares what is not there, is no literal, or nests without end."""
    shapes = ["(10**9,)", "(1000000000000,)", "(-1,)", "(0,)", "(2,)*40", "((((3,),),),)", "(True,)",
              "(1e9,)", "(" + "1," * 40 + ")", "(" + "9" * 5000 + ",)", "()"]  # fmt: skip
    kinds = ["'<f8'", "'|O'", "'|S100000000'", "'<U9'", "'>f8'", "'<f2'", "'|b1'", "'<M8[s]'", "'|V8'",
             "'<f16'", "[('f', '<f8', (1000000,))]", "[('f', '|O')]", "[" + "('a','<f8')," * 3 + "]",
             "'<c16'", "'f8,'*9", str([(f"c{n}", "<f8") for n in range(300)]),
             "(" * 90 + "1" + ")" * 90]  # fmt: skip
    kind, shape = pick(rng, kinds), pick(rng, shapes)
    order = "False" if rng.random() < 0.5 else "True"
    text = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}".encode()
    if rng.random() < 0.3:
        text = pick(rng, [b"(" * 60000, b"{'a':" * 3000, b"[" * 9999, b"-" * 60000, b"1" * 60000])
    return _npy_head(text, int(rng.choice([1, 2, 3, 9]))) + bytes(power_of_ten(rng, 0, 4))


def npy_padded(folder: Path, rng: Generator) -> bytes:
    """A head that is padded to, or declares, megabytes to gigabytes."""
    text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }" + b" " * power_of_ten(rng, 4, 6.9)
    return _npy_head(text, 2, None if rng.random() < 0.5 else 2**32 - 1) + bytes(32)


def npy_pickle(folder: Path, rng: Generator) -> bytes:
    text = b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }"
    return _npy_head(text) + b"\x80\x04cposix\nsystem\n(S'touch canary'\ntR." + bytes(power_of_ten(rng, 0, 6))


def archive(folder: Path, rng: Generator) -> bytes:
    """Members that unpack to gigabytes, many members, lies in the directory, other ways of packing."""
    file = io.BytesIO()
    kind = int(rng.integers(6))
    packing = int(rng.choice([zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_STORED]))
    head = _npy_head(b"{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }" + b" " * 6)
    with zipfile.ZipFile(file, "w", packing) as made:
        if kind == 0:
            blank = b" " * 60_000_000 if packing != zipfile.ZIP_STORED else b" " * 10**6
            made.writestr("f.npy", _npy_head(b"", 2, 2**31) + blank)
        elif kind == 1:
            count = power_of_ten(rng, 5, 7)
            shape = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({count},), }}\n".encode()
            made.writestr("f.npy", _npy_head(shape) + bytes(8 * count if packing else 10**5))
        elif kind == 2:
            for number in range(power_of_ten(rng, 2, 4)):
                made.writestr(f"{number}.npy", head + bytes(32))
        elif kind == 3:
            made.writestr("../../f.npy", head + bytes(32))
            made.writestr("/" * 3000 + ".npy", head + bytes(32))
            made.writestr("a\x1b[2J\u202e.npy", head + bytes(32))
        elif kind == 4:
            made.writestr("f.npy", good("npz", folder))
        else:
            for name, values in arrays().items():
                part = io.BytesIO()
                np.save(part, values)
                made.writestr(f"{name}.npy", part.getvalue())
    content = bytearray(file.getvalue())
    if rng.random() < 0.4:
        # the directory and the heads of the members say other sizes
        for mark, place in ((b"PK\x01\x02", 20), (b"PK\x03\x04", 18)):
            found = content.find(mark)
            if found >= 0:
                sizes = [int(rng.choice([0, 1, 2**31 - 1, 2**32 - 1, 10**6])) for _ in range(2)]
                content[found + place : found + place + 8] = struct.pack("<II", *sizes)
    return bytes(content)


def matlab(folder: Path, rng: Generator) -> bytes:
    deep: Any = np.ones(3)
    for _ in range(power_of_ten(rng, 0.5, 2)):
        deep = {"s": deep}
    kind = int(rng.integers(7))
    tree: dict[str, Any] = [
        lambda: {"f": np.zeros((1, power_of_ten(rng, 5, 7.3)))},
        lambda: {"f": deep},
        lambda: {"f": np.array([np.ones(2)] * power_of_ten(rng, 2, 4), dtype=object)},
        lambda: {"n" * 31: np.ones(2), "f": "text" * power_of_ten(rng, 0, 5), "t": np.array([])},
        lambda: {"f": scipy.sparse.eye(power_of_ten(rng, 1, 5)), "t": np.zeros((2, 3, 4, 5))},
        lambda: {f"v{number}": np.ones(1) for number in range(power_of_ten(rng, 1, 3.5))},
        lambda: {"f": np.array([True, False]), "t": np.array([1, 2], "i8"), "x": 1j * np.ones(2)},
    ][kind]()
    file: Any = io.BytesIO()
    scipy.io.savemat(file, tree, do_compression=bool(kind == 0 or rng.random() < 0.5), format="5")
    return bytes(file.getvalue())


def matlab_element(folder: Path, rng: Generator) -> bytes:
    """A variable whose dimensions, class, size or name are others than what follows."""
    rows = int(rng.choice([0, 1, -1, 2**31 - 1, 10**6]))
    name = b"f" * int(rng.choice([0, 1, 4, 300]))
    flags = struct.pack("<IIII", 6, 8, int(rng.integers(0, 20)) | int(rng.choice([0, 0x800, 0x200])) << 0, 0)
    sides = int(rng.choice([1, 2, 3, 33]))
    place = struct.pack("<II", 5, 4 * sides) + struct.pack("<i", rows) * sides + bytes(4 * (sides % 2))
    called = struct.pack("<II", 1, len(name)) + name + bytes(-len(name) % 8)
    numbers = struct.pack("<II", int(rng.integers(1, 16)), int(rng.choice([8, 24, 2**31, 2**32 - 1])))
    inner = flags + place + called + numbers + bytes(24)
    element = struct.pack("<II", 14, int(rng.choice([len(inner), 2**32 - 1, 0]))) + inner
    if rng.random() < 0.5:
        packed = zlib.compress(element + bytes(power_of_ten(rng, 0, 7)))
        element = struct.pack("<II", 15, len(packed)) + packed
    head = b"MATLAB 5.0 MAT-file".ljust(124) + bytes(rng.choice([b"\x00\x01IM", b"\x01\x00MI"]))
    return head + element


def universal_counts(folder: Path, rng: Generator) -> bytes:
    numbers = arrays()["u"][:60]
    keys: dict[str, Any] = {}
    for key, values in {
        "count": (0, 59, 61, 10**9, -5), "kind": (0, 2, 4, 5, 6, 9), "even": (0, 1, 7),
        "step": (0.0, -1.0, 1e300, 1e-300), "start": (1e300, -1e9), "function": (0, 1, 2, 4, 12, 99),
    }.items():  # fmt: skip
        if rng.random() < 0.35:
            keys[key] = pick(rng, values)
    if rng.random() < 0.3:
        rows = [["1" * 4000], ["1e999"], ["nan"], ["1.0" * 800], ["- - -"], [" " * 4000] * 500]
        keys["rows"] = pick(rng, rows)
    content = universal(numbers, **keys) * int(rng.choice([1, 1, 2000]))
    return content[: -int(rng.integers(1, 200))] if rng.random() < 0.4 else content


def universal_binary(folder: Path, rng: Generator) -> bytes:
    count = int(rng.choice([0, 3, 4, 10**6, 10**9]))
    size = int(rng.choice([0, 12, 24, 10**9, 10**15]))
    head = universal(np.empty(0), count=count, kind=int(rng.choice([2, 4, 6]))).split(b"\n")[2:13]
    order, kind = int(rng.choice([1, 2, 7])), int(rng.choice([11, 0, 99]))
    first = f"    58b{order:6d}{2:6d}{kind:12d}{size:12d}" + f"{0:12d}" * 4
    return b"    -1\n" + first.encode() + b"\n" + b"\n".join(head) + b"\n" + rng.bytes(24) + b"\n    -1\n"


def universal_sets(folder: Path, rng: Generator) -> bytes:
    """Other data sets by the thousand, without an end, with long names; units without sense."""
    end = b"    -1\n"
    other = end + b"   151\n" + b"anything\n" * int(rng.integers(0, 5)) + end
    units = pick(rng, [b"1.0D+00", b"0", b"nan", b"1e999", b"-1", b"9" * 4000])
    system = end + b"   164\n         9unit          2\n" + units + b" 1.0D+00\n0.0\n" + end
    content = other * power_of_ten(rng, 0, 4) + system + universal(arrays()["u"][:20])
    return content + (end if rng.random() < 0.3 else b"")


TRAPS: dict[str, tuple[Trap, ...]] = {
    "csv": (
        long_number, long_lines, line_without_end, many_columns, words_and_numbers, titles, other_encodings,
        many_rows,
    ),
    "npy": (npy_head, npy_padded, npy_pickle),
    "npz": (archive,),
    "mat": (matlab, matlab_element),
    "hdf5": (hdf5_declared, hdf5_outside, hdf5_tree),
    "uff": (universal_counts, universal_binary, universal_sets),
    "surface": (surface,),
    "lvm": (labview,),
    "wav": (sound,),
    "tdms": (tdms,),
    "xlsx": (workbook,),
}  # fmt: skip
"""Files of each format that are traps from the beginning."""
