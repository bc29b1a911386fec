"""Sound files (.wav): the channels of a recorder as fractions of full scale, and the sampling rate.

scipy reads the samples. It returns fewer than the file declares where that is cut off, so sizes are compared
with the file before and with the samples after. Source of the format: "Multimedia Programming Interface and
Data Specifications 1.0" (IBM and Microsoft, 1991); EBU Tech 3306 (RF64) above 4 GB of declared size.
"""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from functools import partial
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import Node, array_bytes

_MAX_PARTS = 1000
_SIZE_IN_RF64 = 0xFFFFFFFF
"""Size of the samples in a file of RF64, whose part ds64 has the real one."""


def _sizes(file: BinaryIO) -> tuple[int, int, int]:
    """Return where the samples end, their bytes, and the bytes of one sample, compared with the file."""
    size = file.seek(0, 2)
    file.seek(0)
    if file.read(12)[:4] == b"RIFX":
        raise MeasurementError("its bytes are in the other order (RIFX); save it as an ordinary .wav file")
    channels = block = rate = bits = long = length = 0
    name = b""
    for _ in range(_MAX_PARTS):
        head = file.read(8)
        if len(head) < 8:
            raise MeasurementError("has no samples, so it is cut off; send it again")
        name, length = head[:4], int.from_bytes(head[4:], "little")
        length = long if name == b"data" and length == _SIZE_IN_RF64 and long else length
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
        elif name == b"ds64":
            long = int.from_bytes(body[8:16], "little")
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
