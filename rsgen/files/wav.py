"""Sound files (.wav): the channels of a recorder as fractions of full scale, and the sampling rate.

Source of the format: "Multimedia Programming Interface and Data Specifications 1.0" (IBM and Microsoft, 1991)
with WAVE_FORMAT_EXTENSIBLE, and EBU Tech 3306 (RF64) for files above 4 GB of declared size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import Node, array_bytes

_INTEGER, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_KINDS = {
    (_INTEGER, 8): "u1", (_INTEGER, 16): "<i2", (_INTEGER, 24): "u1", (_INTEGER, 32): "<i4",
    (_FLOAT, 32): "<f4", (_FLOAT, 64): "<f8",
}  # fmt: skip
"""How samples lie in the file, by their kind and bits; 24 bits are three bytes each."""
_MOST_CHUNKS = 1000
"""Parts of a file that are passed over: recorders write a few, with texts and markers."""
_MOST_CHANNELS = 4096
_UNKNOWN_SIZE = 0xFFFFFFFF
"""Size of the samples in a file of RF64, which says it elsewhere."""
_LONGEST_HEAD = 4096
"""Bytes that the description of the samples may have; it has 16 to 40."""


@dataclass(frozen=True, slots=True)
class _Form:
    kind: int
    channels: int
    rate: int
    bits: int

    @property
    def frame(self) -> int:
        """Bytes of one instant."""
        return self.channels * self.bits // 8

    @property
    def name(self) -> str:
        return f"{'float' if self.kind == _FLOAT else 'int' if self.bits > 8 else 'uint'}{self.bits}"


def _form(head: bytes) -> _Form:
    if len(head) < 16:
        raise MeasurementError(f"its description of the samples has {len(head)} bytes; 16 are needed")
    kind, channels, block = (int.from_bytes(head[place : place + 2], "little") for place in (0, 2, 12))
    rate, bits = int.from_bytes(head[4:8], "little"), int.from_bytes(head[14:16], "little")
    if kind == _EXTENSIBLE and len(head) >= 26:
        kind = int.from_bytes(head[24:26], "little")
    if (kind, bits) not in _KINDS:
        raise MeasurementError(
            f"samples of kind {kind} with {bits} bits; integers of 8, 16, 24 or 32 bits and floating point "
            "of 32 or 64 are read"
        )
    form = _Form(kind, channels, rate, bits)
    if not 1 <= channels <= _MOST_CHANNELS or block != form.frame:
        raise MeasurementError(
            f"{channels} channels of {bits} bits in {block} bytes, which do not fit together"
        )
    if rate < 1:
        raise MeasurementError("a sampling rate of 0; one above 0 Hz is needed")
    return form


def _samples(file: BinaryIO) -> tuple[_Form, int, int]:
    """Find what the samples are, where they begin and how many bytes they have, each size checked first."""
    size = file.seek(0, 2)
    file.seek(0)
    begin = file.read(12)
    if begin[:4] == b"RIFX":
        raise MeasurementError("its bytes are in the other order (RIFX); save it as an ordinary .wav file")
    if begin[:4] not in (b"RIFF", b"RF64") or begin[8:] != b"WAVE":
        raise MeasurementError("is no sound file: RIFF and WAVE are needed at its beginning")
    form, long = None, 0
    for _ in range(_MOST_CHUNKS):
        head = file.read(8)
        if len(head) < 8:
            raise MeasurementError("has no samples, so it is cut off; send it again")
        name, length = head[:4], int.from_bytes(head[4:], "little")
        length = long if name == b"data" and length == _UNKNOWN_SIZE and long else length
        if length > size - file.tell():
            part, left = name.decode("latin-1").strip(), size - file.tell()
            raise MeasurementError(
                f"declares {length} bytes of {part!r}; {left} are left, so it is cut off; send it again"
            )
        if name == b"data":
            if form is None:
                raise MeasurementError("its samples come before their description; it is damaged")
            return form, file.tell(), length
        body = file.read(length) if length <= _LONGEST_HEAD else b""
        if name == b"fmt ":
            form = _form(body)
        elif name == b"ds64":
            long = int.from_bytes(body[8:16], "little")
        # parts have an even number of bytes
        file.seek(length - len(body) + length % 2, 1)
    raise MeasurementError(f"more than {_MOST_CHUNKS} parts before its samples; it is damaged")


def _numbers(raw: NDArray[Any], form: _Form) -> NDArray[Any]:
    """Give samples (frames, channels) as fractions of full scale; floating point stays as it is."""
    if form.kind == _FLOAT:
        return raw
    if form.bits == 8:
        # without a sign, and zero in the middle
        return (raw.astype(np.float32) - 128) / np.float32(128)
    if form.bits == 24:
        # three bytes become the upper ones of four, so that the sign comes along
        wide = np.zeros((*raw.shape[:-1], 4), dtype="u1")
        wide[..., 1:] = raw
        return wide.view("<i4")[..., 0] / 2.0**31
    # 16 bits and a power of two fit into single precision
    return raw.astype(np.float32) / np.float32(2**15) if form.bits == 16 else raw / 2.0**31


def walk_wav(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a sound file: its channels channel_1, channel_2 ..., and its sampling rate, rate.

    Integers are divided by full scale, so that they lie between -1 and 1; what full scale stands for, the
    file does not say.

    Raises
    ------
    MeasurementError
        No sound file, a size beyond its end, samples of another kind, or none.
    """
    form, begin, length = _samples(file)
    frames = length // form.frame
    if not frames or length % form.frame:
        raise MeasurementError(
            f"{length} bytes of samples, {form.frame} each instant, which do not fit together; it is cut off"
        )
    array_bytes((frames, form.channels), np.dtype("f8"), 2 * largest)

    @cache
    def whole() -> NDArray[Any]:
        file.seek(begin)
        raw = np.frombuffer(file.read(length), dtype=_KINDS[form.kind, form.bits])
        return raw.reshape((frames, form.channels, 3) if form.bits == 24 else (frames, form.channels))

    def load(channel: int) -> NDArray[Any]:
        return _numbers(whole()[:, channel], form)

    yield Node(
        "rate", (), "float64", load=lambda: np.array(float(form.rate)), unit="Hz", remark="sampling rate"
    )
    scaled = f"{form.name}, 1 is full scale" if form.kind == _INTEGER else f"{form.name}, as written"
    source = "a sound file names no unit; write unit, and as factor what 1 in the file stands for"
    kind = "float32" if form.bits <= 16 or (form.kind, form.bits) == (_FLOAT, 32) else "float64"
    for number in range(form.channels):
        yield Node(
            f"channel_{number + 1}", (frames,), kind, load=partial(load, number), remark=scaled,
            unit_source=source, column=number + 1,
        )  # fmt: skip
