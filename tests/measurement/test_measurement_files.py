"""Files of every format: one test written in many ways gives one surface, and hostile files are refused."""

import base64
import io
import json
import os
import re
import sys
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from rsgen import read
from rsgen.common.errors import MeasurementError
from rsgen.files import sandbox
from rsgen.files.array_files import walk_npz
from rsgen.files.data_files import recognise_format
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import Layout, LevelRule
from rsgen.files.sandbox import list_binary, read_binary
from rsgen.files.text_columns import read_columns
from rsgen.files.tree import LARGEST_BYTES
from rsgen.files.uff import walk_universal
from tests.attacks.good_files import universal
from tests.attacks.traps_hdf5 import outside_ways
from tests.measurement.tables import planned
from tests.programs import python

FORMATS = Path(__file__).parents[2] / "cases" / "formats"
CORPUS = json.loads((Path(__file__).parents[1] / "corpus" / "binary.json").read_text(encoding="utf-8"))


def marked(test):
    """Mark a test as slow, and as one of what files hold, not of how they are read."""
    return pytest.mark.slow(pytest.mark.usefixtures("read_here")(test))


# the text has six digits of the lag in degrees; formats of 64 bits differ by the order of multiplications
@pytest.mark.parametrize(("name", "digits"), [
    ("csv-table", 1e-5), ("mat-v73", 1e-13), ("npz-matrix", 1e-13), ("uff-frf", 1e-11),
])  # fmt: skip
@marked
def test_every_format_gives_the_same_surface(name, digits):
    reference, surface = (read(FORMATS / f"{one}.toml") for one in ("mat-struct", name))
    np.testing.assert_allclose(surface.frequency, reference.frequency, rtol=1e-12)
    np.testing.assert_allclose(surface.level, reference.level, rtol=1e-12)
    ratio = surface.harmonics[:, 1] / surface.force
    np.testing.assert_allclose(ratio, reference.harmonics[:, 1] / reference.force, rtol=digits)
    assert surface.sweep.tolist() == reference.sweep.tolist()


def tree(path: Path) -> Path:
    numbers = {"f": np.array([1.0, 2.0, 3.0]), "A": np.arange(1.0, 7.0).reshape(2, 3), "q": np.eye(3) + 1}
    if path.suffix == ".mat":
        scipy.io.savemat(path, {**numbers, "s": {"in": {"f": numbers["f"], "name": "text"}}})
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file.update(numbers | {"s/in/f": numbers["f"]})
            file["f"].attrs["units"] = "Hz"
    else:
        np.savez(path, **numbers, **{"s/in/f": numbers["f"]})
    return path


@pytest.mark.parametrize("ending", [".mat", ".h5", ".npz"])
@marked
def test_addresses(tmp_path, ending):
    path = tree(tmp_path / f"tree{ending}")
    wanted: list[int | str] = ["f", "A[2]", "A[:,2]", "A[1,:]", "s/in/f", "q[2,:]"]
    found = read_binary(path, recognise_format(path), wanted)
    rows = [channels[0].values.ravel().tolist() for channels in found]
    assert rows == [[1, 2, 3], [4, 5, 6], [2, 5], [1, 2, 3], [1, 2, 3], [1, 2, 1]]
    if ending == ".h5":
        assert found[0][0].unit == "Hz"


@pytest.mark.parametrize(("address", "message"), [
    ("g", "nothing is called 'g'; known: 'f', 'A', 'q', 's'"), ("A[3]", "no channel 3; there are 2"),
    ("A[0]", "no channel 0"), ("q[1]", "is square; write"), ("s/in/name", "is a text"),
    (2, "a number alone is for tables"),
])  # fmt: skip
@marked
def test_wrong_addresses_are_named(tmp_path, address, message):
    path = tree(tmp_path / "tree.mat")
    with pytest.raises(MeasurementError, match=f"^{re.escape(str(path))}: .*{re.escape(message)}"):
        read_binary(path, "mat", [address])


@marked
def test_sides_of_a_matrix_become_rows(tmp_path):
    path = tmp_path / "grid.npz"
    f, force = np.array([5.0, 6.0, 7.0]), np.array([1.0, 2.0])
    # three repeats of two levels at three frequencies
    x = np.arange(1.0, 19.0).reshape(2, 3, 3)
    np.savez(path, f=f[:, None], F=force, x=x[:, :, 0])
    plan = planned(path, "f", "F", "x", level=LevelRule(column="F"))
    surface = read_measurement(plan)
    assert surface.frequency.tolist() == [5, 6, 7, 5, 6, 7]
    assert surface.level.tolist() == [1, 1, 1, 2, 2, 2]
    assert surface.amplitude.tolist() == x[:, :, 0].ravel().tolist()
    for shape, said in (((4, 5), "fit no side of 4 x 5"), (4, "columns differ in length")):
        np.savez(path, f=f, F=force, x=np.ones(shape))
        with pytest.raises(MeasurementError, match=said):
            read_measurement(plan)


@marked
def test_entries_must_have_every_column(tmp_path):
    path = tmp_path / "runs.h5"
    with h5py.File(path, "w") as file:
        for run in ("drive_1", "drive_2", "drive_10"):
            file[f"{run}/f"] = [1.0, 2.0]
            file[f"{run}/F"] = float(run.removeprefix("drive_"))
            if run != "drive_2":
                file[f"{run}/x"] = [1.0, 1.0]
    test = planned(path, "drive_*/f", "drive_*/F", "drive_*/x", level=LevelRule(spread=0.1))
    with pytest.raises(MeasurementError, match="every entry must have both"):
        read_measurement(test)
    with h5py.File(path, "a") as file:
        file["drive_2/x"] = [1.0, 1.0]
    # in the order of the numbers: 2 before 10
    assert read_measurement(test).force.real.tolist() == [1, 1, 2, 2, 10, 10]


@pytest.mark.slow
def test_cells_and_structs_of_matlab_73(tmp_path):
    path = tmp_path / "cells.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for number in range(3):
            data = file.create_dataset(f"#refs#/{number}", data=np.full((4, 1), float(number)))
            data.attrs["MATLAB_class"] = np.bytes_(b"double")
        cell = np.array([[file[f"#refs#/{number}"].ref] for number in range(3)], dtype=h5py.ref_dtype)
        file["runs"] = cell
        file["runs"].attrs["MATLAB_class"] = np.bytes_(b"cell")
        file["s/f"] = cell
        file["s"].attrs["MATLAB_class"] = np.bytes_(b"struct")
    with path.open("r+b") as raw_file:
        raw_file.write(b"MATLAB 7.3 MAT-file, made by a test".ljust(124) + b"\x00\x02IM")
    assert recognise_format(path) == "hdf5"
    first, all_ = read_binary(path, "hdf5", ["runs/2", "s/f/*"])
    assert first[0].values.tolist() == [[1, 1, 1, 1]]
    assert [channel.values[0, 0] for channel in all_] == [0, 1, 2]
    assert [entry.path for entry in list_binary(path, "hdf5").entries][:3] == ["runs/1", "runs/2", "runs/3"]


def arrays(content: bytes) -> list[list]:
    return [node.load().tolist() for node in walk_universal(io.BytesIO(content), None, 2**20)]


def test_universal_records():
    assert arrays(universal([1.0, 2.0, 3.0], step=0.5)) == [[0, 0.5, 1.0], [1, 2, 3]]
    # uneven: pairs; complex: pairs; both: triples
    assert arrays(universal([1, 5, 2, 6], even=0, count=2)) == [[1, 2], [5, 6]]
    assert arrays(universal([1, 5, 2, 6], kind=5, count=2, step=0.5)) == [[0, 0.5], [1 + 5j, 2 + 6j]]
    assert arrays(universal([1, 5, 7, 2, 6, 8], kind=5, even=0, count=2)) == [[1, 2], [5 + 7j, 6 + 8j]]
    # fields of fixed width that touch, and exponents of Fortran
    assert arrays(universal([0, 0], rows=[" -1.00000E-01-2.00000D+00"]))[1] == [-0.1, -2]
    # other data sets are skipped
    other = b"    -1\n  2411\nanything\n    -1\n"
    assert arrays(other + universal([1.0]) + other)[1] == [1]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("width", [4, 8])
def test_binary_universal_records(order, width):
    kind, first = (2 if width == 4 else 4), f"    58b{1 if order == '<' else 2:6d}{2:6d}{11:12d}"
    first += f"{3 * width:12d}{0:6d}{0:6d}{0:12d}{0:12d}"

    def binary(numbers: np.ndarray, end: bytes, **keys: int) -> bytes:
        head = universal([], **keys).split(b"\n")[2:13]
        return end.join([b"    -1", first.encode(), *head, numbers.tobytes()])

    data = np.array([1.0, -2.5, 1e30]).astype(f"{order}f{width}")
    content = binary(data, b"\r\n", count=3, kind=kind)
    assert arrays(content + b"    -1\r\n")[1] == data.tolist()
    with pytest.raises(MeasurementError, match="the closing -1 is missing"):
        arrays(content[:-2] + b"    -1\r\n")
    # the abscissa of an uneven record of double precision may be single
    if width == 8:
        mixed = np.array([(0.5, 1.0), (1.5, 2.0)], dtype=[("x", f"{order}f4"), ("y", f"{order}f8")])
        content = binary(mixed, b"\n", count=2, kind=4, even=0)
        assert arrays(content + b"\n    -1\n") == [[0.5, 1.5], [1, 2]]


def test_archives_hold_no_pickles_and_no_lies():
    file = io.BytesIO()
    np.savez(file, good=np.arange(3.0), bad=np.array([{}], dtype=object))
    nodes = {node.path: node for node in walk_npz(file, None, 2**20)}
    assert nodes["good"].load().tolist() == [0, 1, 2]
    assert "pickle" in nodes["bad"].fault
    header, said = io.BytesIO(), {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(header, said)
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("huge.npy", header.getvalue())
    assert "no whole .npy array" in {node.path: node for node in walk_npz(file, None, 2**20)}["huge"].fault


TRAPS = {
    **dict.fromkeys(("external", "virtual", "raw", "soft")),
    "declared": lambda file: file.create_dataset("x", (10**12,), "f8", chunks=(1000,)),
    "opaque": lambda file: file.create_dataset("x", data=np.void(b"\x80\x04cposix\nsystem\n")),
    "deep": lambda file: file.update({"/".join("x" * 40): np.ones(4)}),
}
"""Those that lead outside of the file are ways of ``outside_ways``."""


@pytest.mark.slow
@pytest.mark.parametrize("trap", TRAPS)
def test_traps_in_hdf5_are_refused(tmp_path, trap):
    path = tmp_path / "trap.h5"
    with h5py.File(path, "w") as file:
        (TRAPS[trap] or outside_ways(tmp_path, "x")[trap])(file)
    with pytest.raises(MeasurementError, match=rf"^{re.escape(str(path))}: "):
        read_binary(path, "hdf5", ["x"])
    # the listing shows nothing from elsewhere
    assert all(entry.fault and "42" not in entry.first for entry in list_binary(path, "hdf5").entries)


@pytest.fixture(scope="module")
def _warm():
    """Read good files, so that the memory of the first process is no part of what a hostile file takes."""
    for name in ("table.mat", "steps.h5"):
        list_binary(FORMATS / name, recognise_format(FORMATS / name))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="work and memory of a process are counted as Linux does")
@pytest.mark.usefixtures("_warm")
@pytest.mark.parametrize("entry", [
    pytest.param(entry, marks=[pytest.mark.thorough] if number % 4 else [])
    for number, entry in enumerate(CORPUS)
], ids=lambda entry: entry["id"])  # fmt: skip
def test_hostile_files(tmp_path, entry):
    resource = pytest.importorskip("resource")
    path = tmp_path / entry["id"].removeprefix("data-")
    path.write_bytes(base64.b64decode(entry.get("input_b64", "")))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    form, fault = recognise_format(path), ""
    addresses = ["1/abscissa", "1/ordinate"] if form == "uff" else ["t", "x"] if form != "npy" else ["array"]
    try:
        read_binary(path, form, addresses)
    except MeasurementError as error:
        fault = str(error)
    assert fault.isprintable()
    assert fault == "" or fault.startswith(f"{path}: ")
    if entry["expected"].split()[0] in ("accept", "reject") and " or " not in entry["expected"]:
        assert ("reject" if fault else "accept") == entry["expected"].split()[0]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    # of the corpus: 2 s and 200 MB above what the reading process needs for a good file
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 2.0
    assert after.ru_maxrss - before.ru_maxrss < 200 * 1024


@pytest.mark.slow
def test_a_bomb_is_refused_before_it_unpacks(tmp_path):
    path = tmp_path / "bomb.mat"
    scipy.io.savemat(path, {"x": np.zeros((1, 9_000_000))}, do_compression=True)
    assert path.stat().st_size < 2**20
    with h5py.File(tmp_path / "bomb.h5", "w") as file:
        file.create_dataset("x", data=np.zeros(9_000_000), compression="gzip", chunks=(100_000,))
    for name, form in (("bomb.mat", "mat"), ("bomb.h5", "hdf5")):
        with pytest.raises(MeasurementError, match="declares 72000000 bytes"):
            read_binary(tmp_path / name, form, ["x"])


def test_the_reading_process_loads_no_more_than_it_needs():
    done = python("-c", "import sys, rsgen.files.sandbox; print(*sys.modules)", check=True)
    unneeded = {"sympy", "pint", "pydantic", "scipy", "numba", "rsgen.data.surface", "rsgen.files.plan"}
    assert not unneeded & set(done.stdout.split())


@pytest.mark.slow
def test_waiting_ends(tmp_path, monkeypatch):
    path = tmp_path / "long.npy"
    np.save(path, np.zeros(6_000_000))
    monkeypatch.setattr(sandbox, "_seconds", lambda size, form: size / 1e12)
    with pytest.raises(MeasurementError, match="reading was ended after"):
        read_binary(path, "npy", ["array"])


@pytest.mark.skipif(os.name != "posix", reason="pipes are POSIX")
def test_only_regular_files_of_a_size_to_be_read_are_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.mat")
    huge = tmp_path / "huge.mat"
    with huge.open("wb") as file:
        # sparse: takes no disk
        file.truncate(LARGEST_BYTES + 1)
    for path in (huge, tmp_path / "pipe.mat", Path("/dev/zero"), tmp_path, tmp_path / "absent.mat"):
        with pytest.raises(MeasurementError, match="at most" if path == huge else "."):
            read_binary(path, "mat", ["x"])
        with pytest.raises(MeasurementError, match="at most" if path == huge else "."):
            read_columns(path, Layout(), [1])
