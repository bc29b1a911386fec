"""The response surface: one row a test point, the one table that all later stages read.

Simulated and measured surfaces are indistinguishable downstream. Real tests are no grid, so the table is in
long form; force and response are complex and as measured, never the nominal level.
"""

from __future__ import annotations

import io
import json
import os
from dataclasses import dataclass, fields
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.errors import MeasurementError, RsgenError
from rsgen.finding import Finding
from rsgen.output import write_atomic

__all__ = ["OUTCOMES", "ResponseSurface", "load_surface", "save_surface"]

OUTCOMES = (
    "settled: the response repeats with the period of the force",
    "not settled: the response still changes after the longest transient allowed",
    "not settled: the response repeats after two periods of the force, not after one",
    "not settled: the response grows without bound",
    "not settled: the sweep passes faster than the response follows",
)
"""What became of a test point; the table stores the index."""

SWEEPS = ("rest", "up", "down")

_UNITS = {
    "level": "N",
    "frequency": "Hz",
    "force": "N",
    "harmonics": "m",
    "peak": "m",
    "sweep": "",
    "outcome": "",
    "residual": "1",
    "error": "1",
    "stable": "",
}
_SCHEMA = 1


def _frozen(values: ArrayLike, dtype: type | str, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    array = np.array(values, dtype=dtype)
    if array.ndim != len(shape) or any(
        want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    ):
        expected = ", ".join("any" if size == -1 else str(size) for size in shape)
        raise RsgenError(f"surface.{name}: shape {array.shape}; must be ({expected})")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, slots=True, eq=False)
class ResponseSurface:
    """Steady states of a structure over force level and frequency; n test points, H harmonics.

    Parameters
    ----------
    level
        (n,) nominal force amplitude [N], or amplitude of the displacement [m] where that was held constant;
        names the level a point belongs to, never used as the force.
    frequency
        (n,) [Hz], positive.
    force
        (n,) complex amplitude F of the measured force [N], f(t) = Re F exp(i omega t).
    harmonics
        (n, H+1) complex displacement [m], x(t) = Re sum_h X_h exp(i h omega t); column 0 is the mean (real).
    peak
        (n, 2) largest and smallest displacement in a period [m]; NaN where only harmonics are known.
    sweep
        (n,) "rest", "up" or "down": how the point was reached.
    outcome
        (n,) index into OUTCOMES; 0 is settled. Unsettled points are never used for identification.
    residual
        (n,) how far the state is from repeating, relative to the amplitude [1]; NaN where unknown.
    error
        (n,) estimated relative error of the amplitude [1]; NaN where unknown.
    origin
        "simulated" or "measured".
    phase_known
        False where the test recorded amplitudes only: the phase of the response is then without meaning.
    control
        What the test held constant within a level: "force" or "response".
    stable
        (n,) False where the motion would leave this state if the force were held constant; None: all stable.
    findings
        What a reader should know about how the surface came about before using its numbers.

    Raises
    ------
    RsgenError
        A shape does not fit, a frequency is not positive and finite, a sweep or outcome is unknown.
    """

    level: NDArray[np.float64]
    frequency: NDArray[np.float64]
    force: NDArray[np.complex128]
    harmonics: NDArray[np.complex128]
    peak: NDArray[np.float64]
    sweep: NDArray[np.str_]
    outcome: NDArray[np.int8]
    residual: NDArray[np.float64]
    error: NDArray[np.float64]
    origin: str
    phase_known: bool = True
    control: str = "force"
    stable: NDArray[np.bool_] | None = None
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.frequency))
        shapes: dict[str, tuple[type | str, tuple[int, ...]]] = {
            "level": (np.float64, (n,)),
            "frequency": (np.float64, (n,)),
            "force": (np.complex128, (n,)),
            "harmonics": (np.complex128, (n, -1)),
            "peak": (np.float64, (n, 2)),
            "sweep": ("U4", (n,)),
            "outcome": (np.int8, (n,)),
            "residual": (np.float64, (n,)),
            "error": (np.float64, (n,)),
            "stable": (np.bool_, (n,)),
        }
        if self.stable is None:
            object.__setattr__(self, "stable", np.ones(n, dtype=bool))
        for name, (dtype, shape) in shapes.items():
            object.__setattr__(self, name, _frozen(getattr(self, name), dtype, name, shape))
        if self.harmonics.shape[1] < 2:
            raise RsgenError("surface.harmonics: needs at least the mean and the fundamental")
        if not np.all(np.isfinite(self.frequency) & (self.frequency > 0)):
            raise RsgenError("surface.frequency: must be positive and finite everywhere")
        if not np.isin(self.sweep, SWEEPS).all():
            raise RsgenError(f"surface.sweep: must be one of {', '.join(SWEEPS)}")
        if n and not ((self.outcome >= 0) & (self.outcome < len(OUTCOMES))).all():
            raise RsgenError(f"surface.outcome: must be 0 to {len(OUTCOMES) - 1}")
        if self.control not in ("force", "response"):
            raise RsgenError(f"surface.control: {self.control!r}; must be 'force' or 'response'")
        if self.origin not in ("simulated", "measured"):
            raise RsgenError(f"surface.origin: {self.origin!r}; must be 'simulated' or 'measured'")

    def __len__(self) -> int:
        """Count the test points."""
        return len(self.frequency)

    @property
    def omega(self) -> NDArray[np.float64]:
        """(n,) angular frequency [rad/s]."""
        return 2 * np.pi * self.frequency

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """(n,) X, amplitude of the fundamental of the displacement [m]."""
        return np.abs(self.harmonics[:, 1])

    @property
    def phase(self) -> NDArray[np.float64]:
        """(n,) lag of the displacement behind the force [rad], in [0, 2 pi)."""
        return np.angle(self.force / self.harmonics[:, 1]) % (2 * np.pi)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """(n,) True where the response repeats with the period of the force."""
        return np.equal(self.outcome, 0)

    @property
    def levels(self) -> NDArray[np.float64]:
        """The distinct nominal levels, ascending, in ``level_unit``."""
        return np.unique(self.level)

    @property
    def level_unit(self) -> str:
        """Unit of the levels: "N", or "m" where the amplitude of the response was held."""
        return "N" if self.control == "force" else "m"

    @property
    def answer(self) -> NDArray[np.float64]:
        """(n,) what the test found at its levels: X [m], or |F| [N] where the response was held."""
        return self.amplitude if self.control == "force" else np.abs(self.force)

    @property
    def answer_unit(self) -> str:
        """Unit of ``answer``."""
        return "m" if self.control == "force" else "N"

    def select(self, mask: NDArray[np.bool_] | NDArray[np.intp]) -> ResponseSurface:
        """Keep some points: a boolean mask (n,) or an index array."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return ResponseSurface(**{k: v[mask] if k in _UNITS else v for k, v in values.items()})


def save_surface(path: str | os.PathLike[str], surface: ResponseSurface) -> None:
    """Write a surface as HDF5, atomically; every array carries its unit.

    Complex arrays are HDF5 compounds (r, i), as h5py, MATLAB and Julia read them. ``settled`` is written
    besides ``outcome`` for readers that only want yes or no.

    Raises
    ------
    RsgenError
        The file cannot be written; what was there before is still there.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = "rsgen response surface"
        file.attrs["schema"] = _SCHEMA
        file.attrs["origin"] = surface.origin
        file.attrs["phase_known"] = surface.phase_known
        file.attrs["control"] = surface.control
        file.attrs["findings"] = [json.dumps(finding.to_dict()) for finding in surface.findings]
        file.attrs["outcomes"] = list(OUTCOMES)
        columns = {name: getattr(surface, name) for name in _UNITS}
        columns["sweep"] = columns["sweep"].astype("S4")
        columns["settled"] = surface.settled.astype(np.uint8)
        columns["stable"] = columns["stable"].astype(np.uint8)
        for name, values in columns.items():
            # no time stamps: the same surface gives the same bytes
            data = file.create_dataset(name, data=values, track_times=False)
            data.attrs["units"] = surface.level_unit if name == "level" else _UNITS.get(name, "")
    write_atomic(path, buffer.getvalue())


def load_surface(path: str | os.PathLike[str]) -> ResponseSurface:
    """Read a surface that ``save_surface`` wrote.

    Raises
    ------
    MeasurementError
        The file is not HDF5, not a surface of this schema, or an array is missing or of the wrong kind.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != "rsgen response surface" or file.attrs.get("schema") != _SCHEMA:
                raise MeasurementError(f"{path}: not an rsgen response surface of schema {_SCHEMA}")
            values: dict[str, Any] = {}
            for name in _UNITS:
                if name == "stable" and name not in file:
                    # surfaces written before response control was told apart
                    continue
                link = file.get(name, getlink=True)
                if not isinstance(link, h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
                    raise MeasurementError(f"{path}: {name}: missing; a surface has {', '.join(_UNITS)}")
                if file[name].external:
                    raise MeasurementError(f"{path}: {name}: stored outside the file; not allowed")
                values[name] = file[name][()]
            values["sweep"] = np.char.decode(values["sweep"], "ascii")
            # surfaces written before there were tests without phase do not say
            known = bool(file.attrs.get("phase_known", True))
            findings = [Finding.from_dict(json.loads(text)) for text in file.attrs.get("findings", ())]
            # surfaces written before findings were data have sentences
            old = [Finding("note", "info", names={"text": str(n)}) for n in file.attrs.get("notes", ())]
            return ResponseSurface(
                **values,
                origin=str(file.attrs["origin"]),
                phase_known=known,
                control=str(file.attrs.get("control", "force")),
                findings=(*old, *findings),
            )
    except (OSError, KeyError, ValueError, TypeError) as fault:
        raise MeasurementError(f"{path}: cannot be read as a response surface: {fault}") from fault
