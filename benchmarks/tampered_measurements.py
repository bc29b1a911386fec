"""Measured tests of ``tests/cases`` with something wrong: in the case that reads them, or in the numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat

import rsgen
from benchmarks.laboratory import Laboratory
from benchmarks.tampering import (
    BACKGROUND,
    LEVELS,
    MISFIT,
    SENSE,
    SIZE,
    TAMPERINGS,
    WAVE,
    Tampering,
)

CASES = Path(__file__).parent.parent / "tests" / "cases"
NAMES = ("wire", "nlbeam", "clamp", "silverbox", "f16", "decay")
TABLES = ("wire", "nlbeam", "clamp")
"""Stepped sines; the numbers of their surfaces are tampered with as those of a virtual test."""

RECORD = MISFIT | WAVE | {"parts-disagree", "damping-hidden-by-misfit", "channels-delayed", "held-out-missed"}
"""What is said of records of a multisine that one law does not explain."""

READINGS = 10
"""Of fifty a point: enough for their scatter, and five times quicker."""


def folder() -> Path | None:
    """Where the measured data are; None where RSGEN_DATA names no folder."""
    named = os.environ.get("RSGEN_DATA")
    return Path(named) if named and Path(named).is_dir() else None


@dataclass(frozen=True)
class Edited:
    """A measured case whose text has something replaced."""

    text: str

    def write(self, folder: Path) -> Path:
        """Write the case; give its path."""
        path = folder / "case.toml"
        path.write_text(self.text, encoding="utf-8")
        return path


@dataclass(frozen=True)
class Records:
    """The periodic records of a measured multisine, level by level: ``u`` and ``y`` are (n,) arrays."""

    text: str
    rate: float
    u: tuple[np.ndarray, ...]
    y: tuple[np.ndarray, ...]

    def write(self, folder: Path) -> Path:
        """Write a file a level and the case; give its path."""
        text = self.text.replace('"mat"', '"npz"')
        for level, samples in zip(VOLTAGES, zip(self.u, self.y, strict=True), strict=True):
            for name, values in zip("uy", samples, strict=True):
                text = text.replace(f"silverbox/SNJP_{name}m_{level}.mat", f"{name}_{level}.npz")
                np.savez(folder / f"{name}_{level}.npz", **{f"{name}m": values, "fs": self.rate})
        return Edited(text).write(folder)


VOLTAGES = (5, 50, 100)
PERIOD, PERIODS = 8192, 15
"""Samples of a period, and how many of the thirty are taken: half the time, and as good an error."""


def _records(change: Callable[[Records], Records]) -> Callable[[str], Records]:
    def make(name: str) -> Records:
        files = [[loadmat(folder() / name / f"SNJP_{c}m_{level}.mat") for c in "uy"] for level in VOLTAGES]
        u, y = (
            tuple(pair[i][f"{channel}m"].ravel()[: PERIOD * PERIODS] for pair in files)
            for i, channel in enumerate("uy")
        )
        text = (CASES / f"{name}.toml").read_text(encoding="utf-8")
        return change(Records(text, float(files[0][0]["fs"].item()), u, y))

    return make


def _each(channel: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[str], Records]:
    """Change the samples of every level of a channel, "u" or "y"."""

    def of_records(one: Records) -> Records:
        return replace(one, **{channel: tuple(change(samples) for samples in getattr(one, channel))})

    return _records(of_records)


def _last(channel: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[str], Records]:
    """Change the samples of the highest level of a channel, "u" or "y"."""

    def of_records(one: Records) -> Records:
        rest = getattr(one, channel)
        return replace(one, **{channel: (*rest[:-1], change(rest[-1]))})

    return _records(of_records)


def _from_middle(gain: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: x * np.where(np.arange(len(x)) < len(x) // 2, 1, gain)


def _one_period_noise(x: np.ndarray) -> np.ndarray:
    noise = np.std(x) * np.random.default_rng(1).standard_normal(PERIOD)
    return np.concatenate([x[: 8 * PERIOD], noise, x[9 * PERIOD :]])


def _clipped(x: np.ndarray) -> np.ndarray:
    return np.clip(x, -0.5 * np.abs(x).max(), 0.5 * np.abs(x).max())


def _samples_lost(x: np.ndarray) -> np.ndarray:
    return np.concatenate([np.delete(x, slice(9 * PERIOD + 100, 9 * PERIOD + 140)), np.zeros(40)])


def _hum(x: np.ndarray) -> np.ndarray:
    return x + 0.3 * np.std(x) * np.sin(2 * np.pi * 50 / 2441.40625 * np.arange(len(x)))


def edited(
    name: str, right: frozenset[str], *changes: tuple[str, str], refusal: str = "", unseen: str = ""
) -> Tampering:
    """Replace parts of a case's text; each must be there."""

    def make(case: str) -> Edited:
        text = (CASES / f"{case}.toml").read_text(encoding="utf-8")
        for old, new in changes:
            if old not in text:
                raise ValueError(f"{case}.toml has no {old!r}")
            text = text.replace(old, new)
        return Edited(text)

    return Tampering(name, right, build=make, refusal=refusal, unseen=unseen)


def _first_readings(surface: rsgen.ResponseSurface) -> np.ndarray:
    """The first READINGS of every point of a test that has more."""
    points = np.stack([surface.level, surface.frequency], axis=1)
    _, point = np.unique(points, axis=0, return_inverse=True)
    order = np.argsort(point, kind="stable")
    first = np.searchsorted(point[order], point[order])
    reading = np.empty(len(order), dtype=int)
    reading[order] = np.arange(len(order)) - first
    return reading < READINGS


def as_table(name: str) -> Laboratory:
    """What a measured test gave, as a table like that of a laboratory."""
    case = rsgen.load_case(CASES / f"{name}.toml", folder())
    surface = rsgen.read(case)
    surface = surface.select(_first_readings(surface))
    observation = case.model.observation
    further = {
        "identify": {
            "background": observation.background,
            "calibrated": observation.calibrated,
            "hold_out": list(observation.hold_out),
        }
    }
    turned = surface.harmonics[:, 1] * np.exp(-1j * np.angle(surface.force))
    laws = tuple(str(element.force) for element in case.model.elements)
    columns = (surface.level, surface.frequency, np.abs(surface.force), -(surface.omega**2) * turned)
    table = Laboratory(name, laws, *columns, further=further)
    if surface.phase_known:
        return table
    amplitudes = {"quantity": "acceleration", "amplitude": "a_real", "phase_known": False}
    return replace(table, response=np.abs(table.response) + 0j, test={**table.test, "response": amplitudes})


def _numbers(names: Iterable[str]) -> list[Tampering]:
    """Tamperings of numbers, by their names among those of the virtual tests."""
    known = {entry.name: entry for entry in TAMPERINGS if entry.change is not None}
    return [replace(known[name], change=None, build=_changed(known[name])) for name in names]


def _changed(entry: Tampering) -> Callable[[str], Laboratory]:
    return lambda name: entry.change(as_table(name))


WITHOUT_PHASE = (
    "two levels swapped",
    "the same force at every level",
    "half of a level's points from another level",
    "half of a level's points noise",
    "10 % outliers in one block",
    "frequencies of one level 2 % too high",
    "sensor overloaded at half of the largest response",
    "gain of the sensor 1.3 times from the middle on",
    "gain of the sensor drifts by 15 %",
    "gain of the sensor 1.2 times from the middle of a level on",
    "frequencies of one level shifted by half of a line's width",
    "a second mode in the band",
    "Hz read as kHz",
)
WITH_PHASE = (
    *WITHOUT_PHASE,
    "phase in the wrong sense (conjugate)",
    "another sensor's channel, with a delay",
    "response turned by 30 degrees",
)

LINEAR = "law without the decisive term"
_SOFT = ' + kn*x*abs(x)"'

OF_CASE: dict[str, tuple[Tampering, ...]] = {
    "wire": (
        *_numbers((*WITH_PHASE, "sign of the response reversed", "one level in g, read as m/s^2")),
        edited(
            "velocity read as displacement",
            SENSE | MISFIT,
            ('"velocity"', '"displacement"'),
            ("-5411.2554 m/s/V", "-5411.2554 m/V"),
        ),
        edited(
            "velocity read as acceleration",
            SENSE | MISFIT,
            ('"velocity"', '"acceleration"'),
            ("-5411.2554 m/s/V", "-5411.2554 m/s^2/V"),
        ),
        edited(LINEAR, MISFIT, (_SOFT, '"'), (' + cn*v*abs(v)"', '"')),
        edited("the background left out", BACKGROUND, ('"constant"', '"none"')),
        edited(
            "in-phase and quadrature exchanged",
            SENSE,
            ("real        = 3", "real        = 4"),
            ("imaginary   = 4", "imaginary   = 3"),
        ),
    ),
    "nlbeam": (
        *_numbers(WITH_PHASE),
        edited(LINEAR, MISFIT, (_SOFT, '"'), ("cn*v*abs(v)**q", "c*v")),
        edited(
            "the drive's channel taken for the response",
            MISFIT | SENSE,
            ("X1__V_", "X_exc__V_"),
            ("Y1__V_", "Y_exc__V_"),
            refusal="response is zero",
        ),
        edited(
            "velocity read as displacement",
            SENSE | MISFIT,
            ('"velocity"', '"displacement"'),
            ("1 m/s/V", "1 m/V"),
        ),
    ),
    "clamp": (
        *_numbers(WITHOUT_PHASE),
        edited("labels 1, 2, 3, ... for the forces", LEVELS, ('"1.5 N", "2 N"', '"2 N", "3 N"')),
        edited(
            "one file twice, once for another level",
            LEVELS,
            ("clamp_meas_1.5", "clamp_meas_1.0"),
            refusal="stands twice",
        ),
        edited(LINEAR, MISFIT, (" + k2*x*abs(x) + k3*x**3", ""), (' + c2*v*abs(v)"', '"')),
    ),
    "silverbox": (
        *(
            Tampering(f"gain of {what} 1.2 times from the middle of the records on", RECORD, build=make)
            for what, make in (
                ("the response", _each("y", _from_middle(1.2))),
                ("the force", _each("u", _from_middle(1.2))),
            )
        ),
        *(
            Tampering(f"gain of {what} drifts by 15 %", RECORD, build=make)
            for what, make in (
                ("the response", _each("y", lambda y: y * np.linspace(1, 1.15, len(y)))),
                ("the force", _each("u", lambda u: u * np.linspace(1, 1.15, len(u)))),
            )
        ),
        Tampering(
            "gain of the response 1.2 times at the highest level", RECORD, build=_last("y", lambda y: 1.2 * y)
        ),
        Tampering("a period of the highest level noise", RECORD, build=_last("y", _one_period_noise)),
        Tampering("sensor overloaded at half of the largest response", RECORD, build=_each("y", _clipped)),
        Tampering("samples lost at the highest level", RECORD, build=_last("y", _samples_lost)),
        Tampering(
            "hum of the mains in the response",
            RECORD,
            build=_each("y", _hum),
            unseen="50 Hz is no line of the period: it is noise, and in the intervals as such",
        ),
        Tampering("sign of the response reversed", SENSE, build=_each("y", np.negative)),
        Tampering("record played backwards", SENSE | RECORD, build=_each("y", lambda y: y[::-1])),
        Tampering(
            "response later by half of a radian at the resonance",
            SENSE | RECORD,
            build=_each("y", lambda y: np.roll(y, 3)),
        ),
        Tampering(
            "responses of two levels swapped",
            RECORD,
            build=_records(lambda one: replace(one, y=(one.y[1], one.y[0], one.y[2]))),
        ),
        edited("displacement read as velocity", SENSE | RECORD, ('"displacement"', '"velocity"')),
        edited("displacement read as acceleration", SENSE | RECORD, ('"displacement"', '"acceleration"')),
        edited("law without the cubic term", RECORD, (" + k3*x**3", "")),
        edited("law without the quadratic term", RECORD, (" + k2*x**2", "")),
        edited("a law guessed wrongly", RECORD, (" + k3*x**3", " + k5*x**5")),
        edited("a drag for the damper", RECORD, ('"c*v"', '"c*v*abs(v)"')),
        edited(
            "one level for all",
            frozenset({"levels-disagree"}),
            ('"5 mV", "50 mV"', '"100 mV", "50 mV"'),
        ),
    ),
    "f16": (
        edited("sign of the response reversed", SENSE, ('Acceleration[3]"', 'Acceleration[3]"\nfactor = -1')),
        edited(
            "acceleration read as displacement",
            SENSE,
            ('"acceleration"', '"displacement"'),
            ('"m/s^2"', '"m"'),
        ),
        edited("two modes in the band", MISFIT, ('"6.9 Hz", "8.5 Hz"', '"4 Hz", "8.5 Hz"')),
        edited(
            "response in mm/s^2, read as m/s^2", SIZE, ('Acceleration[3]"', 'Acceleration[3]"\nfactor = 1000')
        ),
        edited(
            "swept sine taken as a stepped sine",
            WAVE | MISFIT,
            ('"swept-sine"', '"stepped-sine"'),
            refusal="both must have the same frequencies",
        ),
        edited(
            "sweep taken as a free decay",
            WAVE | MISFIT,
            ('"swept-sine"', '"ring-down"'),
            ('[[element]]\nname  = "wing"', 'system = { mass = 1 }\n[[element]]\nname  = "wing"'),
            ('[test.force]\nsamples = "Force"\nunit    = "N"\n', ""),
            ('hold_out = ["28.8 N"]', ""),
            refusal="does not go with 'ring-down'",
        ),
        edited(
            "samples of the generator taken for the force",
            MISFIT | SENSE,
            ('samples = "Force"', 'samples = "Voltage"'),
            refusal="no level 28.8 N in the surface",
        ),
        edited(
            LINEAR,
            MISFIT,
            (" + k2*x*abs(x)**0.5 + k3*x*abs(x) + k4*x**3", ""),
            (" + c2*v*abs(v)**0.5 + c3*v*abs(v) + c4*v**3", ""),
        ),
    ),
    "decay": (
        edited(
            "the drive before the decay not cut off", WAVE | MISFIT, ('start  = "13 s"', 'start  = "2 s"')
        ),
        edited(
            "driven throughout",
            WAVE | MISFIT,
            ('start  = "13 s"', 'start  = "2 s"'),
            ('stop   = "15 s"', 'stop   = "10 s"'),
            refusal="decay",
        ),
        edited(
            "noise after the decay",
            WAVE | MISFIT,
            ('start  = "13 s"', 'start  = "23 s"'),
            ('stop   = "15 s"', 'stop   = "28 s"'),
            refusal="decay",
        ),
        edited(
            "a second mode as large as the first",
            MISFIT | WAVE,
            ('stop   = "15 s"', 'stop   = "19 s"'),
            unseen="points end where the second mode begins: values and intervals are those without it",
        ),
        edited(
            "another channel (the drive voltage)",
            WAVE | MISFIT,
            ("samples  = 3", "samples  = 2"),
            refusal="decay",
        ),
        edited(
            "milliseconds read as seconds",
            SIZE,
            ("column = 1", 'column = 1\nunit = "ms"'),
            refusal="it lasts from 0 to 0.029 s",
        ),
    ),
}
