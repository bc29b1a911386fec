"""HDF5 files, MATLAB 7.3 among them: groups and datasets as a tree of arrays; nothing outside the file."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import MAX_CHANNELS, MAX_DEPTH, MAX_NODES, Node, array_bytes, is_wanted

_UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
# MATLAB keeps there what cells and struct arrays refer to; it is met by following these references
_HIDDEN = ("#refs#", "#subsystem#")


def sample_hdf5() -> bytes:
    """Make a small file."""
    file = io.BytesIO()
    with h5py.File(file, "w") as made:
        data = made.create_dataset("a/b", data=np.arange(3.0), chunks=(2,), compression="gzip")
        data.attrs["units"] = "m"
    return file.getvalue()


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.ravel()[0]
    if isinstance(value, bytes):
        value = value.decode("utf-8", "replace")
    return value[:40] if isinstance(value, str) else ""


def _attribute(item: h5py.Dataset, name: str) -> Any:
    # an attribute may declare any size; text and small numbers are all that is looked at
    if name not in item.attrs:
        return None
    found = item.attrs.get_id(name)
    return item.attrs[name] if found.get_storage_size() <= 4096 else None


def _complex(dtype: np.dtype[Any]) -> np.dtype[Any] | None:
    """Return the complex type of pairs of two floats, as MATLAB and others write it; None for other types."""
    if dtype.names not in (("real", "imag"), ("r", "i"), ("re", "im")):
        return None
    parts = {dtype[name] for name in dtype.names}
    return np.dtype(f"c{dtype.itemsize}") if parts in ({np.dtype("f4")}, {np.dtype("f8")}) else None


class _Walk:
    def __init__(self, file: h5py.File, heads: set[str] | None, largest: int) -> None:
        self.file = file
        self.heads = heads
        self.largest = largest
        self.count = 0

    def met(self) -> None:
        """Count a link: empty groups without end give no node that could be counted."""
        self.count += 1
        if self.count > MAX_NODES:
            raise MeasurementError(f"more than {MAX_NODES} arrays; at most that many are listed")

    def group(self, group: h5py.Group, path: str, above: tuple[Any, ...]) -> Iterator[Node]:
        info = h5py.h5o.get_info(group.id)
        here = (info.fileno, info.addr)
        if here in above:
            yield Node.refused(path, "contains itself; a tree without loops is needed")
            return
        if len(above) >= MAX_DEPTH:
            yield Node.refused(path, f"is nested more than {MAX_DEPTH} deep")
            return
        for name in group:
            if not path and name in _HIDDEN:
                continue
            if not path and not is_wanted(name, self.heads):
                yield Node(name, dtype="unread")
                continue
            yield from self.member(group, name, f"{path}/{name}" if path else name, (*above, here))

    def member(self, group: h5py.Group, name: str, path: str, above: tuple[Any, ...]) -> Iterator[Node]:
        self.met()
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            yield Node.refused(path, "is a link to another file; what lies in the file itself is read")
        elif not isinstance(link, h5py.HardLink):
            yield Node.refused(path, "is a soft link; name what it leads to")
        else:
            yield from self.item(group[name], path, above)

    def item(self, item: Any, path: str, above: tuple[Any, ...]) -> Iterator[Node]:
        if isinstance(item, h5py.Group):
            yield from self.group(item, path, above)
        elif isinstance(item, h5py.Dataset):
            yield from self.dataset(item, path, above)
        else:
            yield Node.refused(path, "is neither group nor dataset; arrays of numbers are read")

    def dataset(self, data: h5py.Dataset, path: str, above: tuple[Any, ...]) -> Iterator[Node]:
        shape = tuple(map(int, data.shape)) if data.shape is not None else (0,)
        if data.external:
            yield Node.refused(path, "is stored in another file; what lies in the file itself is read", shape)
        elif data.is_virtual:
            yield Node.refused(path, "is a virtual dataset, put together from files; copy it into one", shape)
        elif h5py.check_ref_dtype(data.dtype) is h5py.Reference:
            yield from self.references(data, path, shape, above)
        elif h5py.check_string_dtype(data.dtype) or _text(_attribute(data, "MATLAB_class")) == "char":
            yield Node.refused(path, "is a text; numbers are needed", shape)
        else:
            yield self.numbers(data, path, shape)

    def references(
        self, data: h5py.Dataset, path: str, shape: tuple[int, ...], above: tuple[Any, ...]
    ) -> Iterator[Node]:
        """Follow the references of a MATLAB cell or struct array, inside the file only."""
        try:
            array_bytes(shape, np.dtype("u8"), 8 * MAX_CHANNELS)
        except MeasurementError:
            yield Node.refused(path, f"holds more than {MAX_CHANNELS} references", shape)
            return
        if len(above) >= MAX_DEPTH:
            yield Node.refused(path, f"is nested more than {MAX_DEPTH} deep")
            return
        found = data[()]
        # a single one comes alone, without an array about it
        for number, reference in enumerate(found.flat if shape else [found], start=1):
            self.met()
            target = self.file[reference] if reference else None
            if target is not None:
                yield from self.item(target, f"{path}/{number}", (*above, None))

    def numbers(self, data: h5py.Dataset, path: str, shape: tuple[int, ...]) -> Node:
        pair = _complex(data.dtype)
        dtype = pair or data.dtype
        matlab = "MATLAB_class" in data.attrs
        if data.shape is None or _attribute(data, "MATLAB_empty") is not None:
            return Node.refused(path, "is empty; numbers are needed", shape)
        try:
            array_bytes(shape, dtype, self.largest)
        except MeasurementError as fault:
            return Node.refused(path, str(fault), shape)

        def load() -> NDArray[Any]:
            try:
                read: NDArray[Any] = np.asarray(data[()])
            except (OSError, ValueError, RuntimeError) as fault:
                raise MeasurementError(
                    f"{path[:60]!r} cannot be read, the file is damaged: {str(fault)[:120]}"
                ) from None
            if pair is not None:
                read = np.ascontiguousarray(read).view(pair).reshape(shape)
            # MATLAB writes the transpose
            return read.transpose() if matlab else read

        units = (_text(_attribute(data, name)) for name in _UNITS)
        unit = next(filter(None, units), "")
        return Node(path, shape[::-1] if matlab else shape, dtype.name, load=load, unit=unit)


def walk_hdf5(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through an HDF5 file."""
    opened = h5py.File(file, "r")
    yield from _Walk(opened, heads, largest).group(opened, "", ())
