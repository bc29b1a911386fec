"""A few attacks of every kind on the readers; ``python -m tests.attacks readers`` makes thousands."""

import struct
import time
from collections.abc import Callable

import numpy as np
import pytest

from rsgen.common.errors import MeasurementError
from rsgen.files.data_files import FORMATS
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.inspection.listing import list_contents
from rsgen.files.plan import Layout
from rsgen.files.sandbox import list_binary
from rsgen.files.surface_file import load_surface
from rsgen.files.text_columns import MAX_NUMBER_LENGTH, read_columns
from tests.attacks.child import allowed
from tests.attacks.damage import DAMAGE
from tests.attacks.good_files import ENDINGS, good, table_plan
from tests.attacks.traps import TRAPS, npy_padded

SECONDS = 2.0  # work allowed for these small files, on a busy machine


def refusal(act: Callable[[], object], seconds: float = SECONDS) -> str:
    """The sentence of a refusal, which comes soon."""
    begun = time.process_time()
    with pytest.raises(MeasurementError) as caught:
        act()
    assert time.process_time() - begun < allowed(seconds)
    return str(caught.value)


def test_every_format_is_attacked():
    assert {"csv", *FORMATS} <= {*ENDINGS, *(row.name for row in FORMATS.values() if row.package)}
    assert set(ENDINGS) <= set(TRAPS)


@pytest.mark.slow
@pytest.mark.parametrize("form", [form for form in ENDINGS if form not in ("uff", "surface")])
@pytest.mark.usefixtures("read_here")
def test_good_files_are_read(form, tmp_path):
    """What is tampered with is whole before: an attack that meets a broken file shows nothing."""
    path = tmp_path / f"a{ENDINGS[form]}"
    path.write_bytes(good(form, tmp_path))
    assert len(read_measurement(table_plan(path, form))) == 40


@pytest.mark.slow
@pytest.mark.parametrize("form", [form for form in ENDINGS if form not in ("csv", "surface")])
def test_damaged_files_are_listed_or_refused_and_those_cut_off_are_refused(form, tmp_path):
    content, rng = good(form, tmp_path), np.random.default_rng(7)
    damage = rng.choice(np.array(DAMAGE), 1)[0]
    for name, changed in (("damaged", damage(content, rng)), ("cut off", content[:-3])):
        path, fault, entries = tmp_path / f"{name}{ENDINGS[form]}", "", ()
        path.write_bytes(changed)
        try:
            entries = list_contents(path).entries
        except MeasurementError as error:
            fault = str(error)
            assert fault.startswith(f"{path}: ")
            assert fault.isprintable()
        assert fault or name == "damaged"
        assert all(entry.fault or entry.dtype for entry in entries)
        assert all(entry.low <= entry.high for entry in entries if entry.low is not None)


@pytest.mark.thorough
def test_damage_that_keeps_the_hdf5_library_busy_ends(tmp_path):
    """HDF5 1.14 follows a list of free blocks that leads back to itself without end; its process is ended."""
    content = bytearray(good("surface", tmp_path))
    heap = content.index(b"HEAP")
    # after signature and version: size of the block, offset of its first free part, address of the block
    _, free, address = struct.unpack_from("<QQQ", content, heap + 8)
    struct.pack_into("<Q", content, address + free, free)
    path = tmp_path / "endless.h5"
    path.write_bytes(content)
    assert "takes more time" in refusal(lambda: list_binary(path, "hdf5"))
    assert "takes more time" in refusal(lambda: load_surface(path))


@pytest.mark.parametrize("ending", ["", "x", ".5.5", "e5e"])
def test_a_number_of_a_million_digits_is_refused_by_its_length(ending, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"f,F\n1,2\n" + b"7" * 900_000 + ending.encode() + b",2\n")
    sentence = refusal(lambda: read_columns(path, Layout(), [1]))
    assert "line 3: column 1: '777" in sentence
    assert f"at most {MAX_NUMBER_LENGTH}" in sentence


@pytest.mark.parametrize(("seed", "reason"), [(1, "EOF: reading array header"), (2, "Header info length")])
def test_a_header_of_megabytes_is_refused(tmp_path, seed, reason):
    path = tmp_path / "a.npy"
    path.write_bytes(npy_padded(tmp_path, np.random.default_rng(seed)))
    assert f"is no whole .npy array of numbers: {reason}" in refusal(lambda: list_binary(path, "npy"))


def test_thousands_of_columns_and_many_stars_in_a_name_take_no_time(tmp_path):
    path, file = tmp_path / "a.csv", tmp_path / "b.csv"
    row = ",".join(["1.5"] * 4000)
    path.write_text("\n".join([row] * 40 + [row[:-1] + "x"]) + "\n")
    begun = time.process_time()
    assert len(list_contents(path).entries) == 4000
    assert time.process_time() - begun < allowed(SECONDS)
    file.write_text(f"f,{'a' * 60}b,x_1N_2,x_2N_2,x_N_2\n1,2,3,4,5\n", encoding="utf-8")
    act = lambda: read_columns(file, Layout(), ["*a" * 25 + "*c"], None)  # noqa: E731
    assert "no column named" in refusal(act, 0.5)
    # a * is one sign at least
    assert read_columns(file, Layout(), ["x_*N_*"], None).names == ("x_1N_2", "x_2N_2")
