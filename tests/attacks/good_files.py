"""Good data files of every format, small, as bytes: what is tampered with in attacks on the readers."""

import io
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.io.wavfile
from numpy.random import Generator

from rsgen.data.surface.response_surface import ResponseSurface, save_surface
from rsgen.files.plan import HistoryRule, LevelRule, MeasuredTest
from rsgen.files.signals import Channel

ENDINGS = {
    "csv": ".csv", "mat": ".mat", "hdf5": ".h5", "npy": ".npy", "npz": ".npz", "uff": ".uff",
    "surface": ".h5", "lvm": ".lvm", "wav": ".wav",
}  # fmt: skip
ENDINGS |= {
    form: f".{form}" for form, package in (("tdms", "nptdms"), ("xlsx", "openpyxl")) if find_spec(package)
}
# what stands before the names of the table's columns, and of the history's
_BEFORE = {"lvm": ("1/", "2/"), "tdms": ("table/", "record/"), "xlsx": ("table/", "record/")}
ROWS, SAMPLES = 40, 1200


def arrays() -> dict[str, np.ndarray[Any, Any]]:
    """A table of amplitudes and a history, as they stand in the files."""
    f = np.linspace(8.0, 12.0, ROWS)
    F = np.repeat([1.0, 3.0], ROWS // 2)
    x = F / (5920 - 1.5 * (2 * np.pi * f) ** 2 + 40j * 2 * np.pi * f)
    t = np.arange(SAMPLES) / 100
    drive = 2 * np.sin(2 * np.pi * (4 * t + 0.4 * t**2))
    return {
        "f": f, "F": F, "x": x, "t": t, "u": drive, "a": np.roll(drive, 3) * 1e-3, "fs": np.array([100.0]),
    }  # fmt: skip


def power_of_ten(rng: Generator, low: float, high: float) -> int:
    return int(10 ** rng.uniform(low, high))


def universal(numbers: np.ndarray[Any, Any], **keys: Any) -> bytes:
    """A data set 58 in ASCII; ``keys`` replace fields of the head."""
    known: dict[str, Any] = {"kind": 2, "count": len(numbers), "even": 1, "start": 0.0, "step": 0.01} | keys
    lines = [
        "    -1", "    58", "title", "NONE", "NONE", "NONE", "NONE",
        f"{known.get('function', 1):5d}{0:10d}    0         0" + " NONE               1   1" * 2,
        f"{known['kind']:10d}{known['count']:10d}{known['even']:10d}{known['start']:13.5E}{known['step']:13.5E}"
        f"{0:13.5E}",
        "        17    0    0    0 Time                 s",
        "         8    0    0    0 Motion               m",
        *["         0    0    0    0 NONE                 NONE"] * 2,
    ]  # fmt: skip
    rows = ["".join(f"{v:13.5E}" for v in numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    return ("\n".join([*lines, *known.get("rows", rows), "    -1"]) + "\n").encode()


def _hdf5(parts: dict[str, np.ndarray[Any, Any]]) -> bytes:
    file = io.BytesIO()
    with h5py.File(file, "w") as made:
        for name, values in parts.items():
            checked = {"chunks": (min(16, len(values)),), "compression": "gzip", "fletcher32": True}
            made.create_dataset(name, data=values, **(checked if name in ("f", "x", "u") else {}))
            made[name].attrs["units"] = "Hz"
    return file.getvalue()


def _groups() -> dict[str, dict[str, np.ndarray[Any, Any]]]:
    parts = arrays()
    table = {"f": parts["f"], "F": parts["F"], "re": parts["x"].real, "im": parts["x"].imag}
    return {"table": table, "record": {name: parts[name] for name in ("t", "u", "a")}}


def _labview() -> bytes:
    lines = ["LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "***End_of_Header***\t", "\t"]
    for group in _groups().values():
        lines += [f"Channels\t{len(group)}", "***End_of_Header***\t", "\t".join(["X_Value", *group])]
        rows = enumerate(zip(*group.values(), strict=True))
        lines += ["\t".join([str(number), *(f"{v:.9g}" for v in row)]) for number, row in rows]
        lines.append("")
    return ("\n".join(lines) + "\n").encode()


def _recorded(form: str) -> bytes:
    """A file of a recorder: the table and the history as groups, sheets or channels."""
    file: Any = io.BytesIO()
    if form == "wav":
        channels = [values for group in _groups().values() for name, values in group.items() if name != "t"]
        missing = [np.pad(v, (0, SAMPLES - len(v)), constant_values=np.nan) for v in channels]
        scipy.io.wavfile.write(file, 100, np.stack(missing, axis=1))
    elif form == "tdms":
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(file) as made:
            for group, channels_of in _groups().items():
                made.write_segment([ChannelObject(group, *channel) for channel in channels_of.items()])
    else:
        from openpyxl import Workbook

        book = Workbook()
        book.remove(book.active)
        for group, columns in _groups().items():
            sheet = book.create_sheet(group)
            sheet.append(list(columns))
            for row in zip(*columns.values(), strict=True):
                sheet.append(list(map(float, row)))
        book.save(file)
    return bytes(file.getvalue())


def good(form: str, folder: Path) -> bytes:
    """A good file of a format."""
    parts = arrays()
    table = np.column_stack([parts["f"], parts["F"], parts["x"].real, parts["x"].imag])
    file: Any = io.BytesIO()
    if form == "csv":
        title = "f [Hz],F [N],x_re [m],x_im [m]"
        np.savetxt(file, table, fmt="%.9g", delimiter=",", header=title, comments="")
    elif form == "mat":
        scipy.io.savemat(file, parts | {"s": {"in": parts["f"]}}, do_compression=True)
    elif form == "npz":
        np.savez_compressed(file, **parts)
    elif form == "npy":
        np.save(file, table)
    elif form == "hdf5":
        return _hdf5(parts)
    elif form == "lvm":
        return _labview()
    elif form in ("wav", "tdms", "xlsx"):
        return _recorded(form)
    elif form == "uff":
        return universal(parts["u"]) + universal(parts["a"])
    else:
        path = folder / "good-surface.h5"
        save_surface(path, ResponseSurface(parts["F"], parts["f"], parts["F"].astype(complex), parts["x"]))
        return path.read_bytes()
    return bytes(file.getvalue())


def table_plan(path: Path, form: str) -> MeasuredTest:
    """Read the table of amplitudes of a good file."""
    f, F, x = "f", "F", Channel(complex="x")
    if form == "uff":
        f, F, x = "1/abscissa", "1/ordinate", Channel(amplitude="2/ordinate")
    elif form in {"npy", "csv", "wav"} | _BEFORE.keys():
        named = [f"{_BEFORE[form][0]}{name}" for name in ("f", "F", "re", "im")] if form in _BEFORE else ()
        numbered = [f"array[:,{number}]" if form == "npy" else number for number in (1, 2, 3, 4)]
        f, F, re, im = named or numbered
        x = Channel(real=re, imaginary=im, unit="m" if form == "wav" else None)
    force = Channel(amplitude=F, unit="N" if form == "wav" else None)
    return MeasuredTest((path,), f, force, x, "displacement", level=LevelRule(column=F))


def history_plan(path: Path, form: str) -> MeasuredTest:
    """Read the time history of a good file."""
    named: dict[str, tuple[Any, Any, Any]] = {
        "npy": ("array[:,2]", "array[:,3]", "array[:,1]"), "csv": (2, 3, 1),
        "uff": ("1/ordinate", "2/ordinate", "1/abscissa"),
    }  # fmt: skip
    before = _BEFORE.get(form, ("", ""))[1]
    u, a, t = named.get(form, tuple(f"{before}{name}" for name in ("u", "a", "t")))
    signals, rule = (Channel(samples=u), Channel(samples=a)), HistoryRule("swept-sine", time=t)
    if form == "wav":
        signals = Channel(samples=5, unit="N"), Channel(samples=6, unit="m/s^2")
        rule = HistoryRule("swept-sine", rate_column="rate")
    return MeasuredTest((path,), None, *signals, "acceleration", history=rule)
