"""Measured tests of ``tests/cases`` with something wrong: in the case that reads them, or in the numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import rsgen
from tests.verdict.laboratory import Laboratory
from tests.verdict.tampering import (
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
NAMES = ("wire", "nlbeam", "clamp", "f16", "decay")
TABLES = ("wire", "nlbeam", "clamp")
"""Stepped sines; the numbers of their surfaces are tampered with as those of a virtual test."""

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


def edited(name: str, right: frozenset[str], *changes: tuple[str, str], refusal: str = "") -> Tampering:
    """Replace parts of a case's text; each must be there."""

    def make(case: str) -> Edited:
        text = (CASES / f"{case}.toml").read_text(encoding="utf-8")
        for old, new in changes:
            if old not in text:
                raise ValueError(f"{case}.toml has no {old!r}")
            text = text.replace(old, new)
        return Edited(text)

    return Tampering(name, right, build=make, refusal=refusal)


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
    further = f'identify = {{ background = "{observation.background}", '
    further += (
        f"calibrated = {str(observation.calibrated).lower()}, hold_out = {list(observation.hold_out)} }}"
    )
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
    "a second mode in the band",
    "Hz read as kHz",
)
WITH_PHASE = (
    *WITHOUT_PHASE,
    "phase in the wrong sense (conjugate)",
    "another sensor's channel, with a delay",
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
            refusal="points can be used (settled",
        ),
        edited(
            "sweep taken as a free decay",
            WAVE | MISFIT,
            ('"swept-sine"', '"ring-down"'),
            ('[[element]]\nname  = "spring"', 'system = { mass = 1 }\n[[element]]\nname  = "spring"'),
            ('[test.force]\nsamples = "Force"\nunit    = "N"\n', ""),
            ('hold_out   = ["67.0 N"]', ""),
            refusal="decay",
        ),
        edited(
            "samples of the generator taken for the force",
            MISFIT | SENSE,
            ('samples = "Force"', 'samples = "Voltage"'),
            refusal="no level 67 N in the surface",
        ),
        edited(LINEAR, MISFIT, (" + k2*x*abs(x) + k3*x**3", ""), (" + c3*v**3 + c5*v**5 + c7*v**7", "")),
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
        edited("a second mode as large as the first", MISFIT | WAVE, ('stop   = "15 s"', 'stop   = "19 s"')),
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
