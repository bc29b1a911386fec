"""Measured files: the same test, written in any way, gives the same surface; rows read many at once, too."""

import base64
import hashlib
import json
import math
import re
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import pytest

from rsgen.common.errors import MeasurementError
from rsgen.data.surface.columns import recognise_directions
from rsgen.files import text_columns as text_lines
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import Layout, LevelRule, MeasuredTest
from rsgen.files.signals import Channel
from rsgen.files.text_columns import Columns, read_columns
from tests.attacks.test_readers import refusal

# numbers are written with 17 digits; what remains is the round-off of the conversions
ROUND_OFF = 1e-13
CORPUS = json.loads((Path(__file__).parents[1] / "corpus" / "csv.json").read_text(encoding="utf-8"))

LEVELS = np.repeat([1.0, 3.0], 14)
FREQUENCY = np.tile(np.concatenate([np.linspace(8, 11, 7), np.linspace(11, 8, 7)]), 2)
OMEGA = 2 * np.pi * FREQUENCY
# the force drifts within a level and has a phase, as from a real shaker
FORCE = LEVELS * (1 + 0.02 * np.sin(FREQUENCY)) * np.exp(0.3j)
MASS, STIFFNESS, DAMPING = 1.5, 5920.0, 3.8
DISPLACEMENT = FORCE / (STIFFNESS - MASS * OMEGA**2 + 1j * OMEGA * DAMPING)
SWEEP = np.tile(["up"] * 7 + ["down"] * 7, 2)
GRAVITY = 9.80665


def write(path: Path, delimiter: str = ",", header: bool = True, **columns: np.ndarray) -> Path:
    names = delimiter.join(columns) if header else ""
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, "%.17g", delimiter=delimiter, header=names, comments="")
    return path


def plan(path: Path, **changes) -> MeasuredTest:
    """Describe a test in the plainest way: SI, displacement, real and imaginary part."""
    known = {
        "frequency": "f", "force": Channel(real="Fr", imaginary="Fi"),
        "response": Channel(real="Xr", imaginary="Xi"), "quantity": "displacement",
        "level": LevelRule(spread=0.2),
    }  # fmt: skip
    return MeasuredTest(path, **known | changes)


def plain(path: Path) -> MeasuredTest:
    parts = {"Fr": FORCE.real, "Fi": FORCE.imag, "Xr": DISPLACEMENT.real, "Xi": DISPLACEMENT.imag}
    return plan(write(path, f=FREQUENCY, **parts))


def _velocity_mm_rms_deg_lag(path: Path) -> MeasuredTest:
    velocity = 1j * OMEGA * DISPLACEMENT * 1e3 / math.sqrt(2)
    lag = -np.degrees(np.angle(velocity / FORCE))
    write(path, ";", omega=OMEGA, F=np.abs(FORCE), V=np.abs(velocity), lag=lag)
    response = Channel(amplitude="V", phase="lag", unit="mm/s", scale="rms", phase_sense="lag")
    frequency = {"frequency": "omega", "frequency_unit": "rad/s"}
    return plan(path, **frequency, force=Channel(amplitude="F"), response=response, quantity="velocity")


def _acceleration_g_columns_by_number(path: Path) -> MeasuredTest:
    a = -(OMEGA**2) * DISPLACEMENT / GRAVITY
    columns = (np.arange(len(OMEGA)), a.real, -a.imag, FREQUENCY, FORCE.real, -FORCE.imag)
    write(path, "\t", False, **dict(zip("abcdef", columns, strict=True)))
    return plan(
        path, frequency=4, force=Channel(real=5, imaginary=6, phase_sense="lag"),
        response=Channel(real=2, imaginary=3, phase_sense="lag", factor=GRAVITY), quantity="acceleration",
    )  # fmt: skip


def _blanks_and_names_in_a_comment(path: Path) -> MeasuredTest:
    plain(path)
    body = [line.replace(",", "   ") for line in path.read_text().splitlines()[1:]]
    text = "\r\n".join(["made by hand", "", "% f Fr Fi Xr Xi", *body[:14], "", *body[14:], ""])
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    return plan(path, layout=Layout(skip=1))


@pytest.mark.parametrize("mapping", [
    _velocity_mm_rms_deg_lag, _acceleration_g_columns_by_number, _blanks_and_names_in_a_comment,
])  # fmt: skip
def test_every_mapping_gives_the_same_surface(tmp_path, mapping):
    surface = read_measurement(mapping(tmp_path / "m.csv"))
    np.testing.assert_allclose(surface.frequency, FREQUENCY, rtol=ROUND_OFF)
    ratio = surface.harmonics[:, 1] / surface.force
    np.testing.assert_allclose(ratio, DISPLACEMENT / FORCE, rtol=100 * ROUND_OFF)
    np.testing.assert_allclose(np.abs(surface.force), np.abs(FORCE), rtol=ROUND_OFF)
    assert surface.sweep.tolist() == SWEEP.tolist()


@pytest.mark.parametrize(("frequency", "blocks", "directions"), [
    ([3, 2, 1], "", "ddd"), ([1, 2, 3, 2, 1], "", "uuudd"), ([5], "", "r"), ([2, 2, 2], "", "rrr"),
    # a turning frequency tested twice ends one sweep and begins the other
    ([1, 2, 3, 3, 2, 1], "", "uuuddd"),
    # a jitter below 2 % of the range is no turn
    ([1, 2, 1.99, 3, 4], "", "uuuuu"),
    # the first point of a new block belongs to the new sweep, although it lies above the last one
    ([1, 2, 3, 3.1, 2, 1], "000111", "uuuddd"),
])  # fmt: skip
def test_directions_from_the_order(frequency, blocks, directions):
    numbers = np.array([int(b) for b in blocks or "0" * len(frequency)])
    found = recognise_directions(np.array(frequency), np.ones(len(frequency)), numbers)
    assert "".join(str(direction)[0] for direction in found) == directions


# a receptance table has no time axis that could be uneven: these two belong to the readers of time histories
_TIME_ONLY = {"data-nonmono.csv", "data-jitter.csv"}


@pytest.mark.parametrize("entry", [e for e in CORPUS if e["id"] not in _TIME_ONLY], ids=lambda e: e["id"])
def test_hostile_files(tmp_path, entry):
    path = tmp_path / "data.csv"
    content = base64.b64decode(entry.get("input_b64", ""))
    path.write_bytes(content)
    # empty files have no names; numbers then stand for the columns
    names = content.split(b"\n")[0].decode("utf-8-sig", "replace").replace(";", ",").split(",")
    columns: list[int | str] = list(names) if len(names) > 1 else [1, 1]
    # the corpus holds time histories, read here as frequency, x and v; the row at 0 is skipped
    accepted = entry["expected"].startswith("accept")
    force = columns[0] if accepted else columns[-1]
    response = Channel(real=columns[1], imaginary=columns[min(2, len(columns) - 1)] if accepted else force)
    test = MeasuredTest(path, columns[0], Channel(amplitude=force), response, "velocity")
    if accepted:
        assert len(read_measurement(test)) >= 1
    else:
        said = refusal(lambda: read_measurement(test))
        assert said.startswith(f"{path}: ")
        assert said.isprintable()


@pytest.mark.parametrize(("text", "message"), [
    ("f,F,a,b\n1,1,1,1\n2,1,1\n", "line 3: 3 values; every line must have 4"),
    ("f,F,a,b\n1,1,1e999,1\n", "line 2: column 3: '1e999' is too large"),
    ("f,F,a,b\n1,1,,1\n2,1,1,-\n", "in every column asked for; the first gap is in line 2"),
    ("f;F;a;b\n1;1;0,5;1\n", "for a decimal comma set test.layout.decimal"),
    ("f,F,a,b\n-1,1,1,1\n", "line 2: frequency is negative"),
    ("f,F,a,b\n1,1,0,0\n", "line 2: response is zero in every row"),
    ("f,G,a,b\n1,1,1,1\n", "no column named 'F'; known: 'f', 'G'"),
    ("f,F,F,a,b\n1,1,1,1,1\n", "2 columns are named 'F'"),
    ("f,F,a,b\n1,1,1,١\n", "is no number"),
    ("# nothing but a remark\n", "no numbers in it"),
])  # fmt: skip
def test_faults_name_line_and_remedy(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    test = plan(path, force=Channel(amplitude="F"), response=Channel(real="a", imaginary="b"))
    with pytest.raises(MeasurementError, match=re.escape(message)):
        read_measurement(test)


def test_hash_is_checked_and_a_missing_line_end_said(tmp_path):
    path = tmp_path / "h.csv"
    path.write_bytes(b"1 1 1 1\n2 1 1 1")

    def said(*sha256: str) -> list[str]:
        signals = Channel(amplitude=2), Channel(real=3, imaginary=4)
        surface = read_measurement(MeasuredTest(path, 1, *signals, "displacement", sha256=sha256))
        assert len(surface) == 2
        return [finding.code for finding in surface.findings if finding.code == "last-line-open"]

    assert said(hashlib.sha256(path.read_bytes()).hexdigest()) == []
    with pytest.raises(MeasurementError, match="the case expects"):
        said("0" * 64)
    assert said() == ["last-line-open"]
    # no row is open where the text ends in a remark or a blank
    path.write_bytes(b"1 1 1 1\n2 1 1 1\n# the end")
    assert said() == []


ODD = (
    "", " ", "nan", "NA", "-", "1e999", "1,5", "1.5.5", "e5", "+-1", "0x1", "1_0", "word", "9" * 401,
    "0" * 401, "1.5", "1 2", '"1"', "1\r2", "\x00", "-1-1", "2024-01-02", "#", "%1", "-0", "+1.", ".5", "1E3",
    "007", " 2 ", "\t3", "1e-400", "4.9e-324", "9" * 30,
)  # fmt: skip
"""Cells that are no plain numbers, or look like ones, and numbers that look like none."""
ROWS = ("", "  ", "# note", "1", "1;2;3", "a;b")


def found(path: Path, layout: Layout, bytes_at_once: int, plain: bool) -> Columns | str:
    """Read both columns in blocks of some size, or line by line; a fault as its sentence."""
    slow = nullcontext() if plain else patch("rsgen.files.text_columns.plain_rows", lambda *_: None)
    with patch.object(text_lines, "BLOCK_BYTES", bytes_at_once), slow:
        try:
            return read_columns(path, layout, [2, 1])
        except MeasurementError as fault:
            return str(fault)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(("delimiter", "decimal"), [
    (",", "."), (";", "."), (";", ","), ("\t", ","), ("|", "."), ("whitespace", ","),
])  # fmt: skip
def test_one_odd_cell_or_row_changes_nothing_however_many_bytes_are_read_at_once(delimiter, decimal, end):
    between = " " if delimiter == "whitespace" else delimiter
    odd = (between.join(cells) for cell in ODD for cells in ((cell, "6"), ("5", cell)))
    for row in (*odd, *ROWS):
        rows = [f"f{between}x", *(f"{n}{between}{n + 1}" for n in (1, 3)), row, f"7{between}8"]
        content = (end.join(rows) + end * (row not in ROWS)).encode()
        for size, comments in ((7, ("-",)), (64, ("#", "%")), (1 << 18, ("#",))):
            equal_however_read(content, Layout(delimiter, decimal, comments), size)


def equal_however_read(content: bytes, layout: Layout, size: int) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes(content)
        once, slowly = (found(path, layout, size, plain) for plain in (True, False))
    if isinstance(once, str) or isinstance(slowly, str):
        assert once == slowly
        return
    assert once.values.tobytes() == slowly.values.tobytes()
    for name in ("line", "block"):
        np.testing.assert_array_equal(getattr(once, name), getattr(slowly, name))
    for name in ("names", "words", "spans", "ended"):
        assert getattr(once, name) == getattr(slowly, name)
