"""Make the example files of this folder: one synthetic structure, tested in every way, in every format.

Nothing here was measured. The structure is m = 1.5 kg, k = 5920 N/m, kn = 2e6 N/m^3 (hardening) and
c = 7.5 N s/m; for the free decay c = 1.2 N s/m, so that it lasts. Tables of amplitudes come from rsgen's
simulator, time histories from an integrator of scipy, which shares nothing with it. Run
``python cases/formats/make.py`` to make them anew; the same program gives the same numbers.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import rsgen

FOLDER = Path(__file__).parent
MASS, STIFFNESS, CUBIC, DAMPING = 1.5, 5920.0, 2e6, 7.5
LIGHT = 1.2
GRAVITY = 9.80665
LEVELS = (1.0, 3.0, 6.0)
RATE = 128.0

Array = NDArray[np.float64]
Table = tuple[float, Array, NDArray[np.complex128], NDArray[np.complex128]]

CASE = f"""
schema = 1
name = "formats"
title = "Synthetic structure of the format examples"
system = {{ mass = {MASS} }}
element = [{{ name = "spring", force = "k*x + kn*x**3" }}, {{ name = "damper", force = "c*v" }}]
truth = {{ k = {STIFFNESS}, kn = {CUBIC}, c = {DAMPING} }}
[test]
kind = "simulated"
level = {{ values = {list(LEVELS)} }}
frequency = {{ start = 8.5, stop = 12.5, count = 41 }}
"""


def steady() -> list[Table]:
    """Simulate the table: (level, frequency, force, acceleration) of each level."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.toml"
        path.write_text(CASE, encoding="utf-8")
        case = rsgen.load_case(path)
    surface = rsgen.simulate(case.oscillator, case.test)
    tables = []
    for level in LEVELS:
        one = surface.select((surface.level == level) & surface.settled)
        response = -(one.omega**2) * one.harmonics[:, 1]
        tables.append((level, one.frequency, one.force, response))
    return tables


def integrate(
    force: Callable[[float], float], seconds: float, start: float = 0.0, damping: float = DAMPING
) -> tuple[Array, Array, Array]:
    """Integrate the motion under a force; give time, displacement and acceleration at RATE."""
    t = np.arange(int(seconds * RATE)) / RATE

    def slope(now: float, state: Array) -> tuple[float, float]:
        x, v = state
        return v, (force(now) - STIFFNESS * x - CUBIC * x**3 - damping * v) / MASS

    done = solve_ivp(slope, (0, t[-1]), (start, 0.0), t_eval=t, rtol=1e-8, atol=1e-10)
    x, v = done.y
    forces = np.array([force(now) for now in t])
    return t, x, (forces - STIFFNESS * x - CUBIC * x**3 - damping * v) / MASS


def sweep(level: float) -> tuple[Array, Array]:
    """Sweep up through the resonance, 8 to 13 Hz at 0.1 Hz/s; give force and acceleration."""

    def force(t: float) -> float:
        return level * math.sin(2 * math.pi * (8 * t + 0.05 * t * t))

    t, _, acceleration = integrate(force, 50.0)
    return np.array([force(now) for now in t]), acceleration


def steps(level: float) -> tuple[Array, Array]:
    """Hold one frequency after the other for 5 s, 8.8 to 12 Hz; give force and displacement."""
    frequencies = np.arange(8.8, 12.01, 0.2)
    phase = np.concatenate(([0.0], np.cumsum(2 * np.pi * frequencies * 5.0)))

    def force(t: float) -> float:
        k = min(int(t / 5.0), len(frequencies) - 1)
        return level * math.sin(phase[k] + 2 * math.pi * frequencies[k] * (t - 5.0 * k))

    t, displacement, _ = integrate(force, 5.0 * len(frequencies))
    return np.array([force(now) for now in t]), displacement


def write_text(tables: list[Table]) -> None:
    """Write acceleration in g and lag in degrees; and one file a level with decimal commas, without phase."""
    rows = ["frequency_Hz,force_peak_N,acceleration_peak_g,lag_deg"]
    for level, frequency, force, response in tables:
        ratio = response / force
        alone = ["f;a"]
        for f, load, a, q in zip(frequency, force, response, ratio, strict=True):
            lag = -np.degrees(np.angle(q))
            rows.append(f"{f:.4f},{abs(load):.6g},{abs(a) / GRAVITY:.8g},{lag:.6g}")
            alone.append(f"{f:.4f};{abs(a):.8g}".replace(".", ","))
        name = FOLDER / f"magnitude_{level:.1f}N.csv"
        name.write_text("\n".join(alone) + "\n", encoding="utf-8")
    (FOLDER / "table.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def _save_matlab(path: Path, tree: dict[str, Any]) -> None:
    """Write version 5 with a head without a time, so that the same numbers give the same bytes."""
    scipy.io.savemat(path, tree, do_compression=True)
    with path.open("r+b") as file:
        file.write(b"MATLAB 5.0 MAT-file, synthetic example of rsgen".ljust(116))


def write_matlab(tables: list[Table]) -> None:
    """A struct array in version 5, groups in version 7.3, histories of two levels in version 5."""
    run = np.zeros((1, len(tables)), dtype=[(key, "O") for key in ("level", "f", "F", "A")])
    for number, (level, frequency, force, response) in enumerate(tables):
        run[0, number] = (level, frequency[None], force[None], response[None])
    _save_matlab(FOLDER / "table.mat", {"test": {"run": run}})
    with h5py.File(FOLDER / "table-v73.mat", "w", userblock_size=512) as file:
        for number, (level, frequency, force, response) in enumerate(tables, start=1):
            for key, values in (("level", [level]), ("f", frequency), ("F", np.abs(force))):
                data = file.create_dataset(
                    f"run_{number}/{key}", data=np.atleast_2d(values).T, track_times=False
                )
                data.attrs["MATLAB_class"] = np.bytes_(b"double")
            pair = np.empty((len(frequency), 1), dtype=[("real", "f8"), ("imag", "f8")])
            ratio = response / force * np.abs(force)
            pair["real"], pair["imag"] = ratio.real[:, None], ratio.imag[:, None]
            data = file.create_dataset(f"run_{number}/A", data=pair, track_times=False)
            data.attrs["MATLAB_class"] = np.bytes_(b"double")
    head = b"MATLAB 7.3 MAT-file, synthetic example of rsgen".ljust(116) + bytes(8) + b"\x00\x02IM"
    with (FOLDER / "table-v73.mat").open("r+b") as file:
        file.write(head)
    for level in LEVELS[1:]:
        force, acceleration = sweep(level)
        channels = np.array([0.01 * acceleration, acceleration], dtype=np.float32)
        _save_matlab(
            FOLDER / f"sweep_{level:.0f}N.mat",
            {"Force": force.astype(np.float32)[None], "Acceleration": channels, "Fs": RATE},
        )


def write_hdf5() -> None:
    """A stepped sine as time histories."""
    with h5py.File(FOLDER / "steps.h5", "w") as file:
        for key, values, unit in zip(("force", "displacement"), steps(3.0), ("N", "m"), strict=True):
            data = file.create_dataset(key, data=values.astype(np.float32), track_times=False)
            data.attrs["units"] = unit
        file.create_dataset("rate", data=RATE, track_times=False).attrs["units"] = "Hz"


def write_numpy(tables: list[Table]) -> None:
    """Matrices: a row a level, a column a frequency."""
    np.savez(
        FOLDER / "table.npz",
        frequency=tables[0][1],
        level=np.array(LEVELS),
        receptance=np.array([-a / (2 * np.pi * f) ** 2 / force for _, f, force, a in tables]),
    )


def _set58(
    kind: int, values: NDArray[Any], axes: tuple[str, ...], start: float, step: float, binary: bool
) -> bytes:
    """Write one data set 58: evenly spaced, double precision."""
    complex_ = np.iscomplexobj(values)
    place = f"{kind:5d}{0:10d}{1:5d}{0:10d} {'BEAM':10s}{2:10d}{3:4d} {'BEAM':10s}{1:10d}{3:4d}"
    count = f"{6 if complex_ else 4:10d}{len(values):10d}{1:10d}{start:13.5E}{step:13.5E}{0:13.5E}"
    title = ["synthetic example of rsgen", "NONE", "NONE", "NONE", "NONE"]
    head = "\n".join([*title, place, count, *axes]) + "\n"
    flat = np.column_stack([values.real, values.imag]).ravel() if complex_ else values
    if binary:
        data = flat.astype("<f8").tobytes()
        first = f"    58b{1:6d}{2:6d}{11:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}\n"
        return f"    -1\n{first}{head}".encode() + data + b"\n    -1\n"
    lines = ["".join(f"{v:20.12E}" for v in flat[i : i + 4]) for i in range(0, len(flat), 4)]
    return f"    -1\n    58\n{head}{chr(10).join(lines)}\n    -1\n".encode()


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:20s} {unit:20s}"


def write_universal(tables: list[Table]) -> None:
    """Accelerances, a data set a level, ASCII; and a free decay, binary."""
    axes = (
        _axis(18, "Frequency", "Hz"),
        _axis(12, "Acceleration", "m/s^2"),
        _axis(13, "Force", "N"),
        _axis(0, "NONE", "NONE"),
    )
    sets = [_set58(4, a / force, axes, f[0], f[1] - f[0], False) for _, f, force, a in tables]
    (FOLDER / "frf.uff").write_bytes(b"".join(sets))
    axes = (_axis(17, "Time", "s"), _axis(8, "Displacement", "m"), *(_axis(0, "NONE", "NONE"),) * 2)
    _, displacement, _ = integrate(lambda t: 0.0, 20.0, 0.015, LIGHT)
    (FOLDER / "decay.uff").write_bytes(_set58(1, displacement, axes, 0.0, 1 / RATE, True))


if __name__ == "__main__":
    made = steady()
    write_text(made)
    write_matlab(made)
    write_hdf5()
    write_numpy(made)
    write_universal(made)
