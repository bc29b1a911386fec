"""The process that opens binary files: it limits itself, reads from standard input, answers with raw numbers.

Readers of binary formats are large programs in C that were not written for hostile files. So they run here,
in a separate process that can open no further file, write none, start nothing and whose memory and time are
limited. What comes back is a line of JSON and bytes of numbers: nothing that could be executed.
"""

from __future__ import annotations

import codecs
import io
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from importlib import import_module
from itertools import islice
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError
from rsgen.common.process import READER_BYTES, READY, confine
from rsgen.files.data_files import FORMATS
from rsgen.files.tree import (
    LARGEST_BYTES,
    MAX_NODES,
    Node,
    array_bytes,
    describe,
    facts,
    find,
    largest_bytes,
    select,
)

_COPIES = 3
Walk = Callable[[BinaryIO, set[str] | None, int], Iterator[Node]]


def _rehearse(walk: Walk, sample: bytes) -> None:
    """Read a sample, so that everything is imported before no file can be opened any more."""
    if sample:
        for node in walk(io.BytesIO(sample), None, LARGEST_BYTES):
            describe(node)
    # names in files may come in any of these, and Python loads each when it is first met
    for name in ("ascii", "latin-1", "cp437", "cp1252", "utf-16", "utf-16-le", "utf-32", "utf-8-sig"):
        codecs.lookup(name)
    json.dumps(facts(np.arange(3.0)))


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


def _channels(nodes: list[Node], wanted: list[int | str], largest: int) -> None:
    header: list[dict[str, Any]] = []
    arrays: list[NDArray[Any]] = []
    total = 0
    loaded: dict[str, NDArray[Any]] = {}
    for number, address in enumerate(wanted):
        found, index = find(nodes, address)
        for node in found:
            if node.path not in loaded:
                loaded[node.path] = node.load()
            values = _portable(select(loaded[node.path], index, node.path))
            total += array_bytes(values.shape, values.dtype, largest)
            if total > 2 * largest:
                raise MeasurementError(
                    f"more than {2 * largest} bytes are asked for; fewer channels are needed"
                )
            header.append(
                {
                    "wanted": number,
                    "path": node.path,
                    "dtype": values.dtype.str,
                    "shape": list(values.shape),
                    "unit": node.unit,
                    "unit_source": node.unit_source,
                    "scale": node.scale,
                    "row": node.row,
                }
            )
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
    row = FORMATS[order["format"]]
    module = import_module(f"rsgen.files.{row.module}")
    walk: Walk = getattr(module, row.walk)
    size = sys.stdin.buffer.seek(0, 2)
    sys.stdin.buffer.seek(0)
    largest = largest_bytes(size)
    _rehearse(walk, getattr(module, row.sample)() if row.sample else b"")
    confine(READER_BYTES + _COPIES * largest, row.seconds + size / row.rate)
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    wanted = order["wanted"]
    try:
        try:
            nodes = list(islice(walk(sys.stdin.buffer, _heads(wanted), largest), MAX_NODES + 1))
            if not nodes:
                raise MeasurementError("holds nothing; arrays of numbers are needed")
            if len(nodes) > MAX_NODES:
                raise MeasurementError(f"more than {MAX_NODES} arrays; at most that many are listed")
            if wanted is None:
                _say({"entries": [asdict(describe(node)) for node in nodes]}, [])
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
            reason = "its parts do not fit together" if internal else " ".join(str(fault).split())[:160]
            raise MeasurementError(
                f"cannot be read as {order['format']}: {reason or type(fault).__name__}; it is damaged"
            ) from None
    except MeasurementError as fault:
        _say({"fault": str(fault)}, [])
