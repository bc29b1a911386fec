"""Open a binary file in a separate process that can be killed, and take nothing but numbers from it.

Readers of binary formats are large programs in C that were not written for hostile files. So they run in a
process that can open no further file, write none, start nothing and whose memory and time are limited. What
comes back is a line of JSON and bytes of numbers: nothing that could be executed.

Limits: size of arrays, their number and depth in ``tree`` (``LARGEST_BYTES``, ``largest_bytes``,
``MAX_NODES``, ``MAX_CHANNELS``, ``MAX_DEPTH``); texts and the time of a format in ``data_files``
(``MAX_TEXT_BYTES``, ``Format.seconds``, ``Format.rate``); the wait for an answer here; memory and size of an
answer in ``common/process``. The time of a format is one of work, and ends the process itself where the
system can count that; the wait is one of the clock, and ends it everywhere.
"""

from __future__ import annotations

import codecs
import io
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError, one_line, printable, shown_path
from rsgen.common.process import (
    MAX_ANSWER_BYTES,
    MEMORY_STATUS,
    READER_BYTES,
    command,
    confine,
    environment,
)
from rsgen.files import tree
from rsgen.files.data_files import FORMATS, SURFACE_FILE, check_digest, open_regular

WAIT_SECONDS = 60.0
WAIT_RATE = 2 * 2**20
"""Time to wait for an answer, on a busy machine as well: WAIT_SECONDS, and one more for each WAIT_RATE bytes,
or the rate of the format if that is lower."""
_SAID = ("path", "unit", "unit_source", "scale")
"""Texts that come with the numbers of an array."""
_READERS = {**FORMATS, SURFACE_FILE.name: SURFACE_FILE}
_DTYPES = ("<f4", "<f8", "<c8", "<c16", "|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f2")


class _Process:
    """A reading process and the clock that ends it after ``seconds``."""

    def __init__(self, file: IO[bytes], name: str, order: dict[str, Any], seconds: float) -> None:
        self.name = name
        self.seconds = seconds
        self.late = False
        # trusted words, as S603 asks: the order is JSON, the file is standard input
        self.process = subprocess.Popen(  # noqa: S603
            command(__name__, json.dumps(order)),
            stdin=file,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment(),
        )
        self.clock = threading.Timer(seconds, self.end)
        self.clock.daemon = True
        self.clock.start()

    def end(self) -> None:
        self.late = True
        self.process.kill()

    def __enter__(self) -> _Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.clock.cancel()
        self.process.kill()
        self.process.wait()
        if self.process.stdout:
            self.process.stdout.close()

    def broken(self) -> MeasurementError:
        """Say why no answer came."""
        if self.late:
            return MeasurementError(
                f"{self.name}: reading was ended after {self.seconds:.1f} s: it is damaged, or this "
                "computer is busy; try again, or export it as text"
            )
        try:
            code = self.process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            code = 0
        if code == -getattr(signal, "SIGXCPU", 0):
            return MeasurementError(
                f"{self.name}: takes more time than a file of its size may: it is damaged, or holds very "
                "many arrays; export those of the test alone"
            )
        return MeasurementError(
            f"{self.name}: the reading process broke down (code {code}), so the file is damaged or hostile; "
            "a file that MATLAB, h5py or the measuring system itself opens is needed"
        )

    def line(self) -> bytes:
        stream = self.process.stdout
        line = stream.readline(MAX_ANSWER_BYTES) if stream else b""
        if not line.endswith(b"\n"):
            raise self.broken()
        return line

    def answer(self) -> dict[str, Any]:
        try:
            header = json.loads(self.line())
        except (ValueError, RecursionError):
            raise self.broken() from None
        if not isinstance(header, dict):
            raise self.broken()
        if "fault" in header:
            raise MeasurementError(f"{self.name}: {printable(str(header['fault']))}")
        return header

    def array(self, shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
        values = np.empty(shape, dtype=dtype)
        if not values.size:
            return values
        view = values.reshape(-1).view(np.uint8).data
        done = 0
        while done < len(view):
            # typing.IO does not declare readinto, which every pipe has
            part = self.process.stdout.readinto(view[done:]) if self.process.stdout else 0  # type: ignore[attr-defined]
            if not part:
                raise self.broken()
            done += part
        return values


def reading_fault() -> str | None:
    """Say what this system does not limit while a binary file is read; None where every limit holds."""
    if not find_spec("resource"):
        # as on Windows
        return "nothing but the time"
    return None if Path(MEMORY_STATUS).exists() else "everything but the memory"


def _check_extra(name: str, form: str) -> None:
    """Refuse a format whose package is not installed."""
    row = _READERS[form]
    if row.package and not find_spec(row.package):
        raise MeasurementError(
            f"{name}: {row.plural} are read by {row.package}, which is not installed: "
            f"python -m pip install {row.package}; or export the file as text"
        )


def _seconds(size: int, form: str) -> float:
    return WAIT_SECONDS + size / min(WAIT_RATE, _READERS[form].rate)


@contextmanager
def _reading(
    path: Path, form: str, wanted: list[int | str] | None, sha256: str | None = None
) -> Iterator[tuple[_Process, dict[str, Any], int]]:
    """Start the process that reads a file; give it, the header of its answer and the size of the file."""
    name = shown_path(path)
    _check_extra(name, form)
    with open_regular(path, tree.LARGEST_BYTES) as file:
        size = file.seek(0, 2)
        file.seek(0)
        check_digest(file, name, sha256)
        with _Process(file, name, {"format": form, "wanted": wanted}, _seconds(size, form)) as process:
            try:
                yield process, process.answer(), size
            except (KeyError, TypeError, ValueError, IndexError):
                # an answer of another form than the program's: the file has taken it over
                raise process.broken() from None


def read_binary(
    path: Path, form: str, wanted: Sequence[int | str], sha256: str | None = None
) -> list[list[tree.StoredArray]]:
    """Read channels of a binary file in a separate process.

    Parameters
    ----------
    path, form
        The file and its format.
    wanted
        Addresses in its tree.
    sha256
        What the file must hash to, if known.

    Returns
    -------
    For each address the arrays that it means: one, or with wildcards several.

    Raises
    ------
    MeasurementError
        Missing, too large, damaged, not what it says to be, an address that is not there; the reading process
        broke down or took too long.
    """
    channels: list[list[tree.StoredArray]] = [[] for _ in wanted]
    with _reading(path, form, list(wanted), sha256) as (process, header, size):
        most = 2 * tree.largest_bytes(size)
        for item in header["arrays"]:
            shape = tuple(int(length) for length in item["shape"])
            if item["dtype"] not in _DTYPES:
                raise process.broken()
            most -= tree.array_bytes(shape, np.dtype(item["dtype"]), most)
            values = process.array(shape, item["dtype"])
            texts = {key: str(item[key]) for key in _SAID}
            channel = tree.StoredArray(values=values, row=int(item["row"]), **texts)
            channels[int(item["wanted"])].append(channel)
    return channels


def list_binary(path: Path, form: str) -> tree.Contents:
    """List what a binary file holds.

    Raises
    ------
    MeasurementError
        As ``read_binary``.
    """
    # imported here, for reading alone needs no checks of entries
    from pydantic import TypeAdapter

    with _reading(path, form, None) as (_, header, _):
        entries = TypeAdapter(tuple[tree.Entry, ...]).validate_python(header["entries"])
    return tree.Contents(path, form, entries)


# ----------------------------------------------------------------------------
# The process that reads: it limits itself, reads from standard input, answers with raw numbers.

_COPIES = 3
Walk = Callable[[BinaryIO, set[str] | None, int], Iterator[tree.Node]]


def _rehearse(walk: Walk, sample: bytes) -> None:
    """Read a sample, so that everything is imported before no file can be opened any more."""
    if sample:
        for node in walk(io.BytesIO(sample), None, tree.LARGEST_BYTES):
            tree.describe(node)
    # names in files may come in any of these, and Python loads each when it is first met
    for name in ("ascii", "latin-1", "cp437", "cp1252", "utf-16", "utf-16-le", "utf-32", "utf-8-sig"):
        codecs.lookup(name)
    json.dumps(tree.facts(np.arange(3.0)))


def _say(header: dict[str, Any], arrays: list[NDArray[Any]]) -> None:
    out = sys.stdout.buffer
    out.write(json.dumps(header, allow_nan=False).encode("ascii") + b"\n")
    for values in arrays:
        if values.size:
            out.write(values.reshape(-1).view(np.uint8).data)
    out.flush()


def _portable(values: NDArray[Any]) -> NDArray[Any]:
    """Little-endian, contiguous, as numbers: what the header declares."""
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))


def _channels(nodes: list[tree.Node], wanted: list[int | str], largest: int) -> None:
    header: list[dict[str, Any]] = []
    arrays: list[NDArray[Any]] = []
    total = 0
    loaded: dict[str, NDArray[Any]] = {}
    for number, address in enumerate(wanted):
        found, index = tree.find(nodes, address)
        for node in found:
            if node.path not in loaded:
                loaded[node.path] = node.load()
            values = _portable(tree.select(loaded[node.path], index, node.path))
            total += tree.array_bytes(values.shape, values.dtype, largest)
            if total > 2 * largest:
                raise MeasurementError(
                    f"more than {2 * largest} bytes are asked for; fewer channels are needed"
                )
            item = {"wanted": number, "dtype": values.dtype.str, "shape": list(values.shape)}
            header.append(item | {key: getattr(node, key) for key in (*_SAID, "row")})
            arrays.append(values)
    _say({"arrays": header}, arrays)


def _heads(wanted: list[int | str] | None) -> set[str] | None:
    """Return the names at the root with which the addresses begin; None where all are needed."""
    if wanted is None or any(isinstance(address, int) for address in wanted):
        return None
    names = [str(address).split("/")[0] for address in wanted]
    # a bracket may be an index or a part of the name
    return {*names, *(name.split("[")[0] for name in names)}


def main() -> None:
    """Read the file on standard input as the order in the first argument says."""
    order = json.loads(sys.argv[1])
    row = _READERS[order["format"]]
    module = import_module(f"rsgen.files.{row.module}")
    walk: Walk = getattr(module, row.walk)
    size = sys.stdin.buffer.seek(0, 2)
    sys.stdin.buffer.seek(0)
    largest = tree.largest_bytes(size)
    _rehearse(walk, getattr(module, row.sample)() if row.sample else b"")
    confine(READER_BYTES + _COPIES * largest, row.seconds + size / row.rate)
    wanted = order["wanted"]
    try:
        try:
            nodes = list(islice(walk(sys.stdin.buffer, _heads(wanted), largest), tree.MAX_NODES + 1))
            if not nodes:
                raise MeasurementError("holds nothing; arrays of numbers are needed")
            if len(nodes) > tree.MAX_NODES:
                raise MeasurementError(f"more than {tree.MAX_NODES} arrays; at most that many are listed")
            if wanted is None:
                _say({"entries": [asdict(tree.describe(node)) for node in nodes]}, [])
            else:
                _channels(nodes, wanted, largest)
        except MemoryError:
            raise MeasurementError("needs more memory than a file of its size may; it is damaged") from None
        except MeasurementError:
            raise
        except Exception as fault:
            # messages about variables of a reader do not help a user
            internal = isinstance(fault, UnboundLocalError | AttributeError | TypeError | IndexError)
            internal = internal or (isinstance(fault, OSError) and fault.errno is not None)
            reason = "its parts do not fit together" if internal else one_line(fault)[:160]
            raise MeasurementError(
                f"cannot be read as {order['format']}: {reason or type(fault).__name__}; it is damaged"
            ) from None
    except MeasurementError as fault:
        _say({"fault": str(fault)}, [])
