"""Lines of a text file, one by one or many at once: their lengths, their bytes and their encoding checked."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from typing import IO

from rsgen.common.errors import MeasurementError
from rsgen.files.data_files import MAX_TEXT_BYTES, Rewritten

__all__ = ["TextLines"]

MAX_LINE = 1_000_000
BLOCK = 1 << 18
"""Bytes read at once: thousands of lines, and little against the memory of a program."""


def _decoded(raw: bytes, encodings: Sequence[str]) -> str | None:
    """Decode a line by the first encoding that fits."""
    for encoding in encodings:
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            continue
    return None


class TextLines:
    """The lines of an open file, from where it stands.

    Parameters
    ----------
    file, name
        Opened by ``open_text``, and what messages call it.
    digest
        Takes up the bytes of every line.
    encoding
        "auto" for UTF-8, else Windows' Latin; or a name of Python's.
    """

    def __init__(self, file: IO[bytes], name: str, digest: hashlib._Hash, encoding: str = "auto") -> None:
        self.number = 0
        """Lines given so far."""
        self._file, self._name, self._digest = file, name, digest
        self._rewritten = isinstance(file, Rewritten)
        encoding = "utf-8" if self._rewritten else encoding
        self._encodings = ("utf-8", "cp1252") if encoding == "auto" else (encoding,)
        self._read = 0

    def lines(self) -> Iterator[tuple[int, str]]:
        """Give number and text of each line; a block that is taken between two of them is left out.

        Raises
        ------
        MeasurementError
            A line is too long, has a zero byte or a carriage return in it, or another encoding.
        """
        while raw := self._taken(self._file.readline(MAX_LINE + 1)):
            yield self._text(raw)

    def texts(self, block: bytes) -> Iterator[tuple[int, str]]:
        """Give number and text of each line of a block; raises as ``lines``."""
        return map(self._text, _split(block))

    def block(self) -> bytes:
        """Give whole lines of about ``BLOCK`` bytes, not yet counted; nothing at the end.

        Raises
        ------
        MeasurementError
            The file is longer than a text may be.
        """
        begin = self._file.read(BLOCK)
        if begin and not begin.endswith(b"\n"):
            begin += self._file.readline(MAX_LINE + 1)
        return self._taken(begin)

    def _taken(self, raw: bytes) -> bytes:
        self._read += len(raw)
        if self._read > MAX_TEXT_BYTES:
            raise self._too_long(self.number + 1)
        if not self._rewritten:
            self._digest.update(raw)
        return raw

    def _too_long(self, number: int) -> MeasurementError:
        return MeasurementError(
            f"{self._name}: line {number}: longer than {MAX_LINE} bytes; is it a text file?"
        )

    def _text(self, raw: bytes) -> tuple[int, str]:
        self.number += 1
        place = f"{self._name}: line {self.number}"
        if len(raw) > MAX_LINE:
            raise self._too_long(self.number)
        if self.number == 1:
            raw = raw.removeprefix(b"\xef\xbb\xbf")
        if b"\x00" in raw:
            raise MeasurementError(f"{place}: contains a zero byte; a text file is needed")
        text = _decoded(raw, self._encodings)
        if text is None:
            raise MeasurementError(
                f"{place}: not {' or '.join(self._encodings)}; save the file as UTF-8, or name its encoding "
                "in test.layout.encoding"
            )
        text = text.rstrip("\r\n")
        if "\r" in text:
            raise MeasurementError(f"{place}: a carriage return inside the line; end lines with \\n")
        return self.number, text


def _split(block: bytes) -> Iterable[bytes]:
    # bytes.splitlines would end lines at a carriage return, too
    *lines, last = block.split(b"\n")
    return [line + b"\n" for line in lines] + ([last] if last else [])
