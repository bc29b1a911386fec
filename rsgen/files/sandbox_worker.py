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
from datetime import datetime
from importlib import import_module
from itertools import islice
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError
from rsgen.common.process import READY, confine
from rsgen.files.address import find, select
from rsgen.files.tree import LARGEST_BYTES, MAX_NODES, Node, array_bytes, describe, facts, largest_bytes

__all__ = ["FORMATS", "main"]

FORMATS = {
    "mat": ("rsgen.files.matlab", "walk_matlab"),
    "hdf5": ("rsgen.files.hdf5", "walk_hdf5"),
    "npy": ("rsgen.files.npy", "walk_npy"),
    "npz": ("rsgen.files.npy", "walk_npz"),
    "uff": ("rsgen.files.uff", "walk_universal"),
    "lvm": ("rsgen.files.lvm", "walk_lvm"),
    "tdms": ("rsgen.files.tdms", "walk_tdms"),
    "xlsx": ("rsgen.files.xlsx", "walk_xlsx"),
    "wav": ("rsgen.files.wav", "walk_wav"),
}
_MEMORY_BYTES = 96 * 2**20
_COPIES = 3
_SECONDS = 1.0
_RATE = 20 * 2**20
"""Time to read a file: _SECONDS, and one more for each _RATE bytes."""
_TEXTS = {"lvm": (1.0, 2 * 2**20), "xlsx": (8.0, 2**19)}
"""The same of formats whose numbers are texts: a quarter of the 8 and 1.3 MB/s that good files reach; numbers
that repeat pack better than others, so that a small workbook may have as many as 32 MB of them."""

Walk = Callable[[BinaryIO, set[str] | None, int], Iterator[Node]]


def _sample(form: str) -> bytes:
    """Make a small file of a format, or nothing where the reader is rsgen's."""
    numbers = np.arange(3.0)
    file = io.BytesIO()
    if form == "mat":
        import scipy.io

        tree = {"a": {"b": numbers, "c": np.array([1, "x"], dtype=object)}, "d": 1j * numbers}
        opened: Any = file
        scipy.io.savemat(opened, tree, do_compression=True)
    elif form == "hdf5":
        import h5py

        with h5py.File(file, "w") as made:
            data = made.create_dataset("a/b", data=numbers, chunks=(2,), compression="gzip")
            data.attrs["units"] = "m"
    elif form == "npy":
        np.save(file, numbers)
    elif form == "npz":
        np.savez_compressed(file, a=numbers)
    elif form == "tdms":
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(file) as written:
            written.write_segment([ChannelObject("a", "b", numbers, {"wf_increment": 0.1})])
    elif form == "xlsx":
        from openpyxl import Workbook

        book = Workbook()
        book.active.append(["f [Hz]", "date"])
        book.active.append([1.0, datetime(2000, 1, 1)])
        book.save(file)
    return file.getvalue()


def _rehearse(form: str, walk: Walk) -> None:
    """Read a sample, so that everything is imported before no file can be opened any more."""
    sample = _sample(form)
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
    """Give the names at the root that the addresses begin with; None where all are needed."""
    if wanted is None or any(isinstance(address, int) for address in wanted):
        return None
    names = [str(address).split("/")[0] for address in wanted]
    # a bracket may be an index or a part of the name
    return {*names, *(name.split("[")[0] for name in names)}


def main() -> None:
    """Read the file on standard input as the order in the first argument says."""
    order = json.loads(sys.argv[1])
    module, name = FORMATS[order["format"]]
    walk: Walk = getattr(import_module(module), name)
    size = sys.stdin.buffer.seek(0, 2)
    sys.stdin.buffer.seek(0)
    largest = largest_bytes(size)
    _rehearse(order["format"], walk)
    seconds, rate = _TEXTS.get(order["format"], (_SECONDS, _RATE))
    confine(_MEMORY_BYTES + _COPIES * largest, seconds + size / rate)
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
            # what a reader says of its variables helps nobody
            internal = isinstance(fault, UnboundLocalError | AttributeError | TypeError | IndexError)
            internal = internal or (isinstance(fault, OSError) and fault.errno is not None)
            reason = "its parts do not fit together" if internal else " ".join(str(fault).split())[:160]
            raise MeasurementError(
                f"cannot be read as {order['format']}: {reason or type(fault).__name__}; it is damaged"
            ) from None
    except MeasurementError as fault:
        _say({"fault": str(fault)}, [])
