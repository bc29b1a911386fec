"""HDF5 files and surfaces made to hurt a reader: declared, packed, linked, deep, or leading outside."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.random import Generator

from rsgen.data.surface.columns import COLUMN_UNITS
from tests.attacks.good_files import good, power_of_ten
from tests.attacks.texts import pick

SECRET = 424242.0  # a number in a file outside, which no reader may give


def _made(make: Callable[[h5py.File], object], **how: Any) -> bytes:
    file = io.BytesIO()
    with h5py.File(file, "w", **how) as made:
        make(made)
    return file.getvalue()


def hdf5_declared(folder: Path, rng: Generator) -> bytes:
    """Arrays of any size without a byte in the file, packed to nothing, or of a million chunks."""
    size = power_of_ten(rng, 5, 12)
    arrays: list[dict[str, Any]] = [
        {"shape": (size,), "dtype": "f8", "chunks": (1000,)},
        {"shape": (size,), "dtype": "f8", "fillvalue": 1.0},
        {"shape": (min(size, 10**7),), "dtype": "f8", "chunks": (10**5,), "compression": "gzip"},
        {"shape": (10**9,), "dtype": "f8", "chunks": (10**8,), "compression": "gzip"},
        {"shape": (power_of_ten(rng, 3, 4.3),), "dtype": "f8", "chunks": (1,), "compression": "gzip"},
    ]
    kind = int(rng.integers(5))

    def make(file: h5py.File) -> None:
        data = file.create_dataset("f", **arrays[kind])
        if kind == 3:
            data[0] = 1.0
        elif kind in (2, 4):
            data[...] = 0.0

    return _made(make)


def _virtual(file: h5py.File, name: str, outside: Path) -> None:
    layout = h5py.VirtualLayout((40,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(outside), "f", shape=(40,))
    file.create_virtual_dataset(name, layout)


def _outside(folder: Path) -> tuple[Path, list[tuple[str, int, int]]]:
    """Write a secret into files; return that of HDF5, and where it lies in the other."""
    outside = folder / "outside.h5"
    if not outside.exists():
        with h5py.File(outside, "w") as file:
            file["f"] = np.full(40, SECRET)
        (folder / "outside.bin").write_bytes(np.full(40, SECRET).tobytes())
    return outside, [(str(folder / "outside.bin"), 0, 320)]


def outside_ways(folder: Path, name: str = "f") -> dict[str, Callable[[h5py.File], object]]:
    """Return the ways in which an array of this name may lead to a secret in another file."""
    outside, place = _outside(folder)
    return {
        "external": lambda file: file.update({name: h5py.ExternalLink(str(outside), "f")}),
        "virtual": lambda file: _virtual(file, name, outside),
        "raw": lambda file: file.create_dataset(name, shape=(40,), dtype="f8", external=place),
        "soft": lambda file: file.update({name: h5py.SoftLink(str(outside))}),
    }


def hdf5_outside(folder: Path, rng: Generator) -> bytes:
    others = dict.fromkeys(("F", "x", "t", "u", "a"), np.ones(40))
    way = pick(rng, [*outside_ways(folder).values()])
    return _made(lambda file: (file.update(others), way(file)))


def hdf5_tree(folder: Path, rng: Generator) -> bytes:
    """Loops, depth, groups by the thousand, long names, huge attributes, kinds that are no numbers."""
    kind = int(rng.integers(7))

    def make(file: h5py.File) -> None:
        if kind == 0:
            file["a/b"] = np.ones(3)
            file["a/c"] = file["a"]
        elif kind == 1:
            file["/".join("g" * power_of_ten(rng, 0.5, 2.5))] = np.ones(3)
        elif kind == 2:
            for number in range(power_of_ten(rng, 1, 3.7)):
                file.create_group(str(number))
        elif kind == 3:
            file["n" * power_of_ten(rng, 1, 4.5)] = np.ones(3)
            file["a\x1b[2J\u202e"] = np.ones(3)
        elif kind == 4:
            units = ["m" * 60000, np.bytes_(b"\xff" * 300), "m^" + "9" * 300, "m" * 20]
            file.create_dataset("f", data=np.ones(3)).attrs["units"] = pick(rng, units)
        elif kind == 5:
            file.create_dataset("f", data=np.ones(3, dtype=[("r", "f8"), ("i", "f4")]))
            file.create_dataset("t", data=["a", "b"])
            file.create_dataset("x", data=np.ones((2,) * 20, dtype="f4"))
        else:
            number = int(rng.integers(10, 3000))
            file["f"] = np.array([file.ref] * number, dtype=h5py.ref_dtype)

    return _made(make, libver=str(rng.choice(["earliest", "latest"])))


TEXTS = (b"[" * 100_000, b'{"a":' * 9000, b"9" * 9000, b"[null]", b'[{"code": 1}]', b"\xff", b"NaN")


def surface(folder: Path, rng: Generator) -> bytes:
    """A surface one of whose arrays is declared, packed, linked, of another kind or length, or deep JSON."""
    content = io.BytesIO(good("surface", folder))
    names = [*COLUMN_UNITS, "findings"]
    name, size = pick(rng, names), power_of_ten(rng, 3, 12)
    values: list[Any] = [
        np.full(40, np.nan), np.full(40, 1e308), np.zeros((40, 3)), np.ones(39), ["a"] * 40,
        *map(np.bytes_, TEXTS),
    ]  # fmt: skip
    value, origin = pick(rng, values), ["o" * 60_000, b"\xff", 3, np.ones(1000)]
    ways: list[Callable[[h5py.File], object]] = [
        lambda file: file.create_dataset(name, shape=(size,), dtype="f8", chunks=(1000,)),
        lambda file: file.create_dataset(name, shape=(size,), dtype="f8"),
        lambda file: file.create_dataset(name, data=np.zeros(10**6), compression="gzip"),
        *outside_ways(folder, name).values(),
        lambda file: file.create_dataset(name, data=value),
        lambda file: file.update({name: h5py.SoftLink("/" + name)}),
        lambda file: file.attrs.__setitem__("origin", pick(rng, origin)),
    ]
    with h5py.File(content, "r+") as file:
        if name in file:
            del file[name]
        pick(rng, ways)(file)
    return content.getvalue()
