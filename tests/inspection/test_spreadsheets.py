"""Headers of spreadsheets as laboratories write them: real and imaginary parts, quantity over unit."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsgen.cases import load_case
from rsgen.data.surface import ResponseSurface
from rsgen.files import MeasuredTest, read_measurement
from rsgen.files.inspection.clues import complex_parts
from rsgen.files.tree import Entry

MASS, DAMPING, STIFFNESS = 1.5, 4.0, 6000.0
FREQUENCY = np.linspace(6.0, 14.0, 33)
LEVELS = (1.0, 3.0)


def receptance(frequency: np.ndarray) -> np.ndarray:
    omega = 2 * np.pi * frequency
    return 1 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)


def write(path: Path, head: str, columns: Callable[[float], list[np.ndarray]]) -> Path:
    """Write a row a frequency and level."""
    blocks = [np.column_stack(np.broadcast_arrays(FREQUENCY, *columns(level))) for level in LEVELS]
    rows = [",".join(f"{value:.9g}" for value in row) for row in np.concatenate(blocks)]
    path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return path


def begun(path: Path, run_cli: Callable[..., Any]) -> tuple[dict[str, Any], ResponseSurface]:
    """Give the [test] tables of the case that is begun from a file, and what it reads."""
    case = path.with_suffix(".toml")
    assert run_cli("init", "--from", path, case).code == 0
    tables: dict[str, Any] = tomllib.loads(case.read_text(encoding="utf-8"))["test"]
    test = load_case(case).test
    assert isinstance(test, MeasuredTest)
    return tables, read_measurement(test)


def is_right(surface: ResponseSurface) -> bool:
    """Whether the surface is that of the oscillator, in size and in phase."""
    return np.allclose(surface.harmonics[:, 1] / surface.force, receptance(surface.frequency), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("real", "imaginary"),
    [
        ("Re [mm]", "Im [mm]"),
        ("real_mm", "imag_mm"),
        ("Real (mm)", "Imaginary (mm)"),
        ("x_re_mm", "x_im_mm"),
        ("Re(x) [mm]", "Im(x) [mm]"),
        ("Re{X} [mm]", "Im{X} [mm]"),
        ("xRe [mm]", "xIm [mm]"),
        ("ReX/mm", "ImX/mm"),
        ("Realteil [mm]", "Imaginärteil [mm]"),
        ("disp real part (mm)", "disp imag part (mm)"),
        ("x.r [mm]", "x.i [mm]"),
        ("In-phase (mm)", "Quadrature (mm)"),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_real_and_imaginary_part_of_the_response(
    tmp_path: Path, run_cli: Callable[..., Any], real: str, imaginary: str, turned: bool
) -> None:
    order = -1 if turned else 1
    head = ",".join(["f [Hz]", "F [N]", *[real, imaginary][::order]])
    parts = lambda level: [1e3 * level * p(receptance(FREQUENCY)) for p in (np.real, np.imag)][::order]  # noqa: E731
    path = write(tmp_path / "a.csv", head, lambda level: [np.array(level), *parts(level)])
    tables, surface = begun(path, run_cli)
    assert (tables["response"]["real"], tables["response"]["imaginary"]) == (real, imaginary)
    assert is_right(surface)


def test_force_and_response_in_parts(tmp_path: Path, run_cli: Callable[..., Any]) -> None:
    def columns(level: float) -> list[np.ndarray]:
        force = level * np.exp(0.4j) * np.ones_like(FREQUENCY)
        x = 1e3 * receptance(FREQUENCY) * force
        return [x.real, x.imag, force.real, force.imag]

    path = write(tmp_path / "a.csv", "f_Hz,x_re_mm,x_im_mm,F_re_N,F_im_N", columns)
    tables, surface = begun(path, run_cli)
    assert tables["force"]["real"] == "F_re_N"
    assert tables["response"]["imaginary"] == "x_im_mm"
    assert is_right(surface)
    assert len(surface.levels) == 2


def test_parts_of_a_frequency_response(tmp_path: Path, run_cli: Callable[..., Any]) -> None:
    def columns(level: float) -> list[np.ndarray]:
        accelerance = -((2 * np.pi * FREQUENCY) ** 2) * receptance(FREQUENCY)
        return [accelerance.real, accelerance.imag, np.array(level)]

    path = write(tmp_path / "a.csv", "f [Hz],Re(H) [(m/s^2)/N],Im(H) [(m/s^2)/N],level [N]", columns)
    tables, surface = begun(path, run_cli)
    assert tables["response"]["quantity"] == "acceleration"
    assert tables["response"]["per_force"] is True
    assert is_right(surface)


@pytest.mark.parametrize(
    "head", ["f/Hz,F/N,x/mm,phi/deg", "f / Hz,F / N,x / mm,φ / °", "f/Hz,Kraft/N,Weg/mm,Phase/deg"]
)
def test_a_header_of_quantities_over_units(tmp_path: Path, run_cli: Callable[..., Any], head: str) -> None:
    frequency, force, response, phase = head.split(",")

    def columns(level: float) -> list[np.ndarray]:
        x = 1e3 * level * receptance(FREQUENCY)
        return [np.array(level), np.abs(x), np.angle(x, deg=True)]

    tables, surface = begun(write(tmp_path / "a.csv", head, columns), run_cli)
    assert tables["frequency"]["column"] == frequency
    assert tables["force"]["amplitude"] == force
    assert (tables["response"]["amplitude"], tables["response"]["phase"]) == (response, phase)
    assert is_right(surface)


WIDE = [
    ("x@{}N [mm]", "phi@{}N [deg]"),
    ("x_{}N_mm", "phase_{}N_deg"),
    ("Re {} N [mm]", "Im {} N [mm]"),
    ("x_re_mm F={}N", "x_im_mm F={}N"),
]


@pytest.mark.parametrize("titles", WIDE)
def test_levels_side_by_side_are_read(
    tmp_path: Path, run_cli: Callable[..., Any], titles: tuple[str, str]
) -> None:
    x = 1e3 * receptance(FREQUENCY)
    in_parts = "im" in titles[1].casefold()
    parts = (x.real, x.imag) if in_parts else (np.abs(x), np.angle(x, deg=True))
    columns = {"f [Hz]": FREQUENCY}
    for level in ("5", "1", "2.5"):
        columns[titles[0].format(level)] = float(level) * parts[0]
        columns[titles[1].format(level)] = (float(level) if in_parts else 1.0) * parts[1]
    path = tmp_path / "a.csv"
    rows = [";".join(f"{value:.9g}" for value in row) for row in np.transpose([*columns.values()])]
    # a level that ends earlier leaves its cells empty
    rows[-1] = ";".join([*rows[-1].split(";")[:-2], "", ""])
    path.write_text("\n".join([";".join(columns), *rows, ""]), encoding="utf-8")
    tables, surface = begun(path, run_cli)
    assert tables["level"] == {"values": ["5 N", "1 N", "2.5 N"]}
    assert surface.levels.tolist() == [1.0, 2.5, 5.0]
    assert [int(np.sum(surface.level == level)) for level in surface.levels] == [33, 32, 33]
    assert is_right(surface)


@pytest.mark.slow
def test_force_and_response_of_each_level_in_variables(tmp_path: Path, run_cli: Callable[..., Any]) -> None:
    arrays: dict[str, np.ndarray] = {"f": FREQUENCY}
    for level in (2, 10, 1):
        arrays[f"F_{level}N"] = 0.98 * level + 0 * FREQUENCY
        arrays[f"x_{level}N"] = 0.98 * level * receptance(FREQUENCY)
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    tables, surface = begun(path, run_cli)
    assert tables["response"]["complex"] == "x_*N"
    assert surface.levels.tolist() == [1.0, 2.0, 10.0]
    assert is_right(surface)


def test_other_sensors_are_said_to_be_left_out(tmp_path: Path, run_cli: Callable[..., Any]) -> None:
    def columns(level: float) -> list[np.ndarray]:
        x = 1e3 * level * receptance(FREQUENCY)
        return [np.array(level), np.abs(x), 2 * np.abs(x), np.angle(x, deg=True)]

    begun(write(tmp_path / "a.csv", "f [Hz],F [N],x1 [mm],x2 [mm],phase [deg]", columns), run_cli)
    text = (tmp_path / "a.toml").read_text()
    assert "# left out: x2 [mm], without a phase" in text
    assert "# or that of x2 [mm]: its title names no channel" in text


@pytest.mark.slow
def test_thousands_of_parts_are_paired_in_no_time() -> None:
    names = [f"{part}_{number}" for part in ("re", "im") for number in range(1500)]
    entries = [Entry(name, (9,), "float64") for name in [*names, *names]]

    def work(count: int) -> float:
        begun = time.process_time()
        list(complex_parts(entries[:count]))
        return time.process_time() - begun

    # eight times as many names: eight times the work, not sixty-four times, whatever else the machine does
    assert min(work(6000) for _ in range(3)) < 24 * min(work(750) for _ in range(3))
    pairs = list(complex_parts(entries))
    assert {(common.title, real.path, imaginary.path) for common, real, imaginary in pairs} == {
        (str(number), f"re_{number}", f"im_{number}") for number in range(1500)
    }
