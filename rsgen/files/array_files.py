"""Files that numpy and scipy read: .npy and .npz, MATLAB up to version 7, and sounds (.wav), without pickles.

Sizes that a file declares are compared with the file before anything is read.
"""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np
import scipy.io
from numpy.lib import format as npy
from numpy.typing import NDArray
from scipy.io import wavfile
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

from rsgen.common.errors import MeasurementError, one_line
from rsgen.files.tree import MAX_DEPTH, Node, array_bytes, is_wanted, open_archive


def sample_npy() -> bytes:
    """Make a small .npy file."""
    file = io.BytesIO()
    np.save(file, np.arange(3.0))
    return file.getvalue()


def sample_npz() -> bytes:
    """Make a small .npz archive."""
    file = io.BytesIO()
    np.savez_compressed(file, a=np.arange(3.0))
    return file.getvalue()


def _nodes(path: str, content: bytes, largest: int) -> Iterator[Node]:
    """Read an array: one node, or one for each field of a structured array.

    ``read_array`` is the part of ``numpy.load`` that takes no file for a pickle or an archive. It parses no
    header above 10 000 bytes, and memory for the array is limited in this process.
    """
    file = io.BytesIO(content)
    try:
        values = npy.read_array(file, allow_pickle=False)
    except Exception as fault:  # the header is read as Python text, so any fault of a parser may come
        raise MeasurementError(f"is no whole .npy array of numbers: {one_line(fault)[:160]}") from None
    if file.read(1):
        raise MeasurementError("holds more than its header declares; the file is damaged")
    names = values.dtype.names
    for place, array in [(path, values)] if names is None else [(f"{path}/{n}", values[n]) for n in names]:
        array_bytes(array.shape, array.dtype, largest)
        yield Node(place, array.shape, array.dtype.name, load=partial(np.asarray, array))


def walk_npy(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a .npy file: one array called "array", or the fields of a structured one below it."""
    yield from _nodes("array", file.read(), largest)


def walk_npz(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a .npz archive: its arrays by their names."""
    with open_archive(file, largest) as archive:
        for member in archive.infolist():
            path, ending = member.filename[:-4], member.filename[-4:]
            if ending != ".npy":
                continue
            try:
                # read as a whole: only at its end an archive compares the CRC-32 of a member
                yield from _nodes(path, archive.read(member), largest)
            except Exception as fault:
                yield Node.refused(path, one_line(fault)[:160])


# ----------------------------------------------------------------------------
# MATLAB files up to version 7: variables, structs and cells as a tree of arrays.

_WIDTHS = {
    "double": "f8", "single": "f4", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "logical": "u1",
}  # fmt: skip
_NOT_READ = "is no array of numbers; structs, cells and numbers are read, nothing else"


def sample_matlab() -> bytes:
    """Make a small file."""
    numbers = np.arange(3.0)
    file: Any = io.BytesIO()
    tree = {"a": {"b": numbers, "c": np.array([1, "x"], dtype=object)}, "d": 1j * numbers}
    scipy.io.savemat(file, tree, do_compression=True)
    made: bytes = file.getvalue()
    return made


def _children(value: NDArray[Any], path: str) -> Iterator[tuple[str, Any]]:
    """Return path and value of each member of a struct or cell; struct arrays are numbered from 1."""
    flat = value.ravel(order="F")
    for number, element in enumerate(flat, start=1):
        base = path if len(flat) == 1 and value.dtype.names else f"{path}/{number}"
        if value.dtype.names:
            for name in value.dtype.names:
                yield f"{base}/{name}", element[name]
        else:
            yield base, element


def _is_text(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "US"


def _walk(value: Any, path: str, depth: int) -> Iterator[Node]:
    known = isinstance(value, np.ndarray)
    if not known or isinstance(value, MatlabObject | MatlabOpaque | MatlabFunction):
        yield Node.refused(path, _NOT_READ)
    elif value.dtype.names or value.dtype == object:
        if depth >= MAX_DEPTH:
            yield Node.refused(path, f"is nested more than {MAX_DEPTH} deep", value.shape)
            return
        if not value.dtype.names and value.size and all(_is_text(member) for member in value.flat):
            texts = [str(member.ravel()[0]) if member.size else "" for member in value.ravel(order="F")]
            yield Node.text(path, ", ".join(texts), value.shape)
            return
        for inner, child in _children(value, path):
            yield from _walk(child, inner, depth + 1)
    elif value.dtype.kind in "US":
        rows = [str(row).rstrip() for row in value.ravel()]
        yield Node.text(path, ", ".join(rows), value.shape)
    elif value.dtype.kind in "fiubc":
        yield Node(path, value.shape, value.dtype.name, load=lambda: value)
    else:
        yield Node.refused(path, _NOT_READ, value.shape)


def _check_sizes(
    file: BinaryIO, heads: set[str] | None, largest: int
) -> tuple[list[str], list[tuple[str, tuple[int, ...]]]]:
    """Check the sizes of the wanted variables; return their names, and name and shape of the others."""
    wanted = []
    others = []
    opened: Any = file
    for name, shape, kind in scipy.io.whosmat(opened):
        if name.startswith("__"):
            # MATLAB's names
            continue
        if not is_wanted(name, heads):
            others.append((name, tuple(map(int, shape))))
            continue
        try:
            array_bytes(tuple(map(int, shape)), np.dtype(_WIDTHS.get(kind, "f8")), largest)
        except MeasurementError as fault:
            raise MeasurementError(f"variable {name[:60]!r} {fault}") from None
        wanted.append(name)
    file.seek(0)
    return wanted, others


def walk_matlab(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through the variables of a MAT file of version 4 to 7.

    Raises
    ------
    MeasurementError
        No MAT file, damaged, or a declared size is too large.
    """
    names, others = _check_sizes(file, heads, largest)
    opened: Any = file
    loaded = scipy.io.loadmat(opened, variable_names=names, chars_as_strings=True, struct_as_record=True)
    # in the order of the file
    for name in names:
        yield from _walk(loaded.pop(name, None), name, 0)
    for name, shape in others:
        yield Node(name, shape, "unread")


# ----------------------------------------------------------------------------
# Sound files: the channels of a recorder as fractions of full scale, and the sampling rate.
#
# scipy returns fewer samples than the file declares where that is cut off, so sizes are compared with the
# samples after, too. Source of the format: "Multimedia Programming Interface and Data Specifications 1.0"
# (IBM and Microsoft, 1991).

_MAX_PARTS = 1000


def _sizes(file: BinaryIO) -> tuple[int, int, int]:
    """Return where the samples end, their bytes, and the bytes of one sample, compared with the file."""
    size = file.seek(0, 2)
    file.seek(0)
    if file.read(12)[:4] != b"RIFF":
        raise MeasurementError("is no ordinary sound file (RIFF); save it as a .wav file")
    channels = block = rate = bits = length = 0
    name = b""
    for _ in range(_MAX_PARTS):
        head = file.read(8)
        if len(head) < 8:
            raise MeasurementError("has no samples, so it is cut off; send it again")
        name, length = head[:4], int.from_bytes(head[4:], "little")
        if length > (rest := size - file.tell()):
            raise MeasurementError(
                f"declares {length} bytes of {name.decode('latin-1').strip()!r}; {rest} are left, so it is "
                "cut off; send it again"
            )
        if name == b"data":
            break
        body = file.read(length + length % 2)
        if name == b"fmt " and len(body) >= 16:
            _, channels, rate, _, block, bits = struct.unpack("<HHIIHH", body[:16])
    if name != b"data":
        raise MeasurementError(f"more than {_MAX_PARTS} parts before its samples; it is damaged")
    if not (channels and bits) or block != channels * -(-bits // 8):
        raise MeasurementError(
            f"{channels} channels of {bits} bits in {block} bytes, which do not fit together"
        )
    if not rate:
        raise MeasurementError("a sampling rate of 0; one above 0 Hz is needed")
    if not length or length % block:
        raise MeasurementError(
            f"{length} bytes of samples, {block} each instant, which do not fit together; it is cut off"
        )
    return file.tell() + length, length, block // channels


def _numbers(samples: NDArray[Any]) -> NDArray[Any]:
    """Return samples as fractions of full scale; floating point stays as it is."""
    if samples.dtype.kind == "f":
        return samples
    if samples.dtype == np.uint8:
        # without a sign, and zero in the middle
        return (samples.astype(np.float32) - 128) / np.float32(128)
    # scipy shifts 24 bits to the upper ones of 32; 16 bits and a power of two fit into single precision
    full_scale = 2.0 ** (8 * samples.itemsize - 1)
    return np.asarray(samples / (np.float32(full_scale) if samples.itemsize == 2 else full_scale))


def walk_wav(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a sound file: its channels channel_1, channel_2 ..., and its sampling rate, rate.

    Integers are divided by full scale, so that they lie between -1 and 1; what full scale stands for, the
    file does not say.

    Raises
    ------
    MeasurementError
        No sound file, sizes that do not fit the file, samples of a kind that scipy does not read, or none.
    """
    end, length, width = _sizes(file)
    array_bytes((length // width,), np.dtype("f8"), 2 * largest)
    file.seek(0)
    try:
        with warnings.catch_warnings():
            # parts with texts and markers are passed over
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            rate, samples = wavfile.read(io.BytesIO(file.read(end)))
    except ValueError as fault:
        raise MeasurementError(f"is no sound file that is read: {str(fault)[:160]}") from None
    if samples.size * width != length:
        raise MeasurementError(f"declares {length} bytes of samples; {samples.size * width} were read")
    yield Node("rate", (), "float64", load=partial(np.array, float(rate)), unit="Hz", remark="sampling rate")
    kind = {"f": "float", "u": "uint", "i": "int"}[samples.dtype.kind] + str(8 * width)
    scaled = f"{kind}, as written" if samples.dtype.kind == "f" else f"{kind}, 1 is full scale"
    source = "a sound file names no unit; write unit, and as factor what 1 in the file stands for"
    for number, channel in enumerate(samples.reshape(len(samples), -1).T, start=1):
        yield Node(
            f"channel_{number}", channel.shape, _numbers(channel[:0]).dtype.name,
            load=partial(_numbers, channel), remark=scaled, unit_source=source, column=number,
        )  # fmt: skip
