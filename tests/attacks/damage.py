"""Damage to the bytes of a file, as transfers, disks, editors and strangers do it."""

import io
import struct
import zipfile
import zlib
from collections.abc import Callable

import h5py
from numpy.random import Generator

from tests.attacks.texts import pick

Damage = Callable[[bytes, Generator], bytes]
EXTREMES = (0, 1, -1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, -(2**63))
HEAD = 2048  # most of what a format declares stands before this byte


def _place(content: bytes, rng: Generator) -> int:
    """A byte, as often in the head as anywhere."""
    most = len(content) if rng.random() < 0.5 else min(len(content), HEAD)
    return int(rng.integers(0, max(1, most)))


def other_bytes(content: bytes, rng: Generator) -> bytes:
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 12))):
        changed[_place(content, rng)] = int(rng.integers(0, 256))
    return bytes(changed)


def cut_off(content: bytes, rng: Generator) -> bytes:
    return content[: _place(content, rng)]


def beginning_missing(content: bytes, rng: Generator) -> bytes:
    return content[_place(content, rng) :]


def inserted(content: bytes, rng: Generator) -> bytes:
    place = _place(content, rng)
    return content[:place] + rng.bytes(int(rng.integers(1, 64))) + content[place:]


def removed(content: bytes, rng: Generator) -> bytes:
    place = _place(content, rng)
    return content[:place] + content[place + int(rng.integers(1, 64)) :]


def zeros(content: bytes, rng: Generator) -> bytes:
    place, size = _place(content, rng), int(rng.integers(1, 512))
    return content[:place] + bytes(len(content[place : place + size])) + content[place + size :]


def doubled(content: bytes, rng: Generator) -> bytes:
    place, size = _place(content, rng), int(rng.integers(1, 512))
    return content[: place + size] + content[place:]


def exchanged(content: bytes, rng: Generator) -> bytes:
    a, b = sorted(_place(content, rng) for _ in range(2))
    size = min(int(rng.integers(1, 256)), max(1, b - a))
    first, second = content[a : a + size], content[b : b + size]
    return content[:a] + second + content[a + size : b] + first + content[b + size :]


def extreme_number(content: bytes, rng: Generator) -> bytes:
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        width, order = int(rng.choice([2, 4, 8])), str(rng.choice(["<", ">"]))
        value = pick(rng, EXTREMES) % 2 ** (8 * width)
        place = _place(content, rng)
        changed[place : place + width] = struct.pack(order + {2: "H", 4: "I", 8: "Q"}[width], value)
    return bytes(changed)


def extreme_digits(content: bytes, rng: Generator) -> bytes:
    places = [place for place, byte in enumerate(content[: 4 * HEAD]) if 48 <= byte < 58]
    if not places:
        return other_bytes(content, rng)
    place = pick(rng, places)
    numbers = [b"-1", b"1e999", b"9" * 40, b"0" * 5000, b"9" * 200_000, b"nan", b"0x10", b"1_0"]
    return content[:place] + pick(rng, numbers) + content[place + 1 :]


DAMAGE: tuple[Damage, ...] = (
    other_bytes, cut_off, beginning_missing, inserted, removed, zeros, doubled, exchanged,
    extreme_number, extreme_digits,
)  # fmt: skip


def _flipped(content: bytes, spans: list[tuple[int, int]], rng: Generator) -> bytes:
    start, size = pick(rng, spans)
    changed = bytearray(content)
    changed[start + int(rng.integers(size))] ^= 1 << int(rng.integers(0, 8))
    return bytes(changed)


def in_archive(content: bytes, rng: Generator) -> bytes:
    """A bit in the packed numbers of a .npz archive, which CRC-32 guards."""
    spans = []
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.infolist():
            names = struct.unpack("<HH", content[member.header_offset + 26 : member.header_offset + 30])
            spans.append((member.header_offset + 30 + sum(names), member.compress_size))
    return _flipped(content, spans, rng)


def _variables(content: bytes) -> list[tuple[int, int]]:
    """Start and size of every packed variable of a MAT file."""
    spans, place = [], 128
    while place < len(content):
        kind, size = struct.unpack("<II", content[place : place + 8])
        assert kind == 15
        spans.append((place + 8, size))
        place += 8 + size
    return spans


def in_variable(content: bytes, rng: Generator) -> bytes:
    """A bit in a packed variable of a MAT file, which Adler-32 guards."""
    return _flipped(content, _variables(content), rng)


def in_chunk(content: bytes, rng: Generator) -> bytes:
    """A bit in a chunk of HDF5, which Fletcher-32 guards."""
    spans = []
    with h5py.File(io.BytesIO(content), "r") as file:
        for data in file.values():
            if isinstance(data, h5py.Dataset) and data.fletcher32:
                chunks = (data.id.get_chunk_info(number) for number in range(data.id.get_num_chunks()))
                spans += [(chunk.byte_offset, chunk.size) for chunk in chunks]
    return _flipped(content, spans, rng)


def false_checksum(content: bytes, rng: Generator) -> bytes:
    """The numbers of a packed variable are others, packed well, with the check of the old ones behind."""
    parts = [content[start : start + size] for start, size in _variables(content)]
    number = int(rng.integers(len(parts)))
    inner = bytearray(zlib.decompress(parts[number]))
    inner[-1 - int(rng.integers(min(8, len(inner) // 2)))] ^= 0x10
    parts[number] = zlib.compress(bytes(inner))[:-4] + parts[number][-4:]
    return content[:128] + b"".join(struct.pack("<II", 15, len(part)) + part for part in parts)


CHECKED: dict[str, tuple[Damage, ...]] = {
    "npz": (in_archive,), "mat": (in_variable, false_checksum), "hdf5": (in_chunk,),
}  # fmt: skip
"""Damage to parts that a checksum of the format guards: never may other numbers come of it."""
