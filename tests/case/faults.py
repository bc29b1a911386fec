"""Faults of case files: what is changed in a good case, and what is said about it."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

GONE = object()
"""In place of a value: the key is left out."""


@dataclass(frozen=True)
class Literal:
    """A value that stands in the file as it is."""

    text: str


Changes = dict[str, Any]
"""Bad values by the dotted path of their key; entries of lists count from 1."""

Row = tuple[Changes, list[str]]

SPRING = {"name": "spring", "force": "k1*x + kn1*x**3"}
DAMPER = {"name": "damper", "force": "c1*v"}
SIMULATED: dict[str, Any] = {
    "schema": 1,
    "name": "good",
    "title": "A good case",
    "system": {"mass": "1.5 kg"},
    "element": [SPRING, DAMPER],
    "printed": {"stiffness": "k1 + 3/4*kn1*X**2"},
    "truth": {"k1": "5.92 kN/m", "kn1": "-2.2e5 N/m^3", "c1": 3.8},
    "test": {
        "kind": "simulated",
        "level": {"start": 1, "stop": 12, "count": 4},
        "frequency": {"start": 7, "stop": 13, "count": 5},
    },
    "identify": {"hold_out": []},
    "accept": {"k1": 1e-4},
}
TABLE: dict[str, Any] = {
    "schema": 1,
    "name": "good",
    "title": "A good case",
    "system": {"mass": "1.5 kg"},
    "element": [SPRING, DAMPER],
    "test": {
        "kind": "measured",
        "file": "data.csv",
        "frequency": {"column": 1},
        "force": {"amplitude": 2},
        "response": {"quantity": "velocity", "real": 3, "imaginary": 4, "phase_sense": "lead"},
    },
}
HISTORY: dict[str, Any] = {
    **TABLE,
    "test": {
        "kind": "measured",
        "file": "data.mat",
        "excitation": "swept-sine",
        "force": {"samples": "F"},
        "response": {"quantity": "acceleration", "samples": "A"},
        "time": {"rate": 400},
    },
}

OF_SIMULATED: list[Row] = [
    (
        {"accept.k1": 0, "accept.kn9": 0.001, "accept.c1": "small", "titel": "A bad case"},
        [
            "accept.k1: is 0; a number above 0 and of at most 10 is needed",
            "accept.kn9: is no parameter; did you mean 'kn1'?",
            "accept.c1: is 'small'; a number above 0 and of at most 10 is needed",
            "titel: is not a key here",
        ],
    ),
    ({"test.noise": {"relative": -0.1}}, ["test.noise.relative: is -0.1; a number from 0 to 1 is needed"]),
    ({"test.noise": {"seed": 3}}, ["test.noise.relative: is missing"]),
    ({"identify.band": ["9 Hz", "8 Hz"]}, ["identify.band: 9 to 8 Hz; must be ascending"]),
    (
        {"identify.band": ["9 Hz", "8 m"], "system.mass": "0 kg"},
        ["identify.band.2: '8 m' is a length, but Hz", "system.mass: is 0 kg; a number above 0 is needed"],
    ),
    ({"identify.background": 1}, ["identify.background: is 1; 'none'"]),
    (
        {"test.harmonics": 65, "test.accuracy": 1.0},
        [
            "test.harmonics: is 65; a whole number from 1 to 64 is needed",
            "test.accuracy: is 1.0; a number from 1e-09 to 0.01 is needed",
        ],
    ),
    (
        {"accept": {"kn1": 1e-4}, "model": "rank"},
        ['accept: the law is not known before a ranking; leave [accept] out or model = "rank"'],
    ),
    ({"accept": {"kn2": 1e-4}}, ["accept.kn2: is no parameter; did you mean 'kn1'?"]),
    ({"accept.k1": 0.0}, ["accept.k1: is 0.0; a number above 0 and of at most 10 is needed"]),
    (
        {"element": GONE, "printed": GONE, "truth": GONE, "accept": GONE},
        ['element: is missing; every case needs it, but a measured one with model = "rank"'],
    ),
    ({"element": []}, ["element: is a list of 0; at least 1 entry is needed"]),
    ({"element.2.name": "Spring"}, ["element.2.name: 'Spring' is used twice"]),
    (
        {"test.frequency.start": "44 rad/s"},
        ["test.frequency.start: '44 rad/s' is an angular frequency, but Hz is needed"],
    ),
    ({"test.frequency.stop": 3}, ["test.frequency.stop: is 3; must be above start, which is 7"]),
    ({"test.level.values": [1]}, ["test.level: has values and start, stop, count"]),
    ({"test.level.count": 2.5}, ["test.level.count: is 2.5; a whole number from 1 to 1000000 is needed"]),
    ({"test.level.count": 1}, ["test.level.count: is 1, but start and stop differ"]),
    ({"test.level": {"values": [2, 1]}}, ["test.level.values.2: 1 is below the value before it"]),
    ({"test.level": {"values": []}}, ["test.level.values: is empty"]),
    (
        {"test.level.count": 100000, "test.frequency.count": 100000},
        ["test: 100000 x 100000 = 10000000000 points; at most 1000000"],
    ),
    ({"test.level.stop": GONE}, ["test.level: stop missing"]),
    ({"test.level": {"values": [1.0, 1.0, 2.0]}}, ["test.level.values.2: 1 stands twice"]),
    ({"test.level.start": 0}, ["test.level.start: is 0; must be above 0"]),
    (
        {"test.level": {"values": [1]}, "identify.hold_out": [1]},
        ["identify.hold_out: holds every level back"],
    ),
    ({"identify.hold_out": [5.5]}, ["identify.hold_out.1: 5.5 N is not tested"]),
    (
        {"test.kind": GONE},
        ["test.kind: is missing; 'simulated', 'simulated-multisine' or 'measured' is needed"],
    ),
    (
        {"test.kind": "simulate"},
        ["test.kind: is 'simulate'; 'simulated', 'simulated-multisine' or 'measured' is allowed"],
    ),
    ({"element.2.force": "__import__(1)"}, ["element.2.force:"]),
    ({"element.2.force": "c1*v + k1*v"}, ["element: k1*x is in N*s, a force is needed"]),
    ({"element.2.force": "m*v", "truth.c1": GONE}, ["element.2.force: 'm' is the mass"]),
    ({"element.2.force": "c1*(v"}, ["element.2.force:"]),
    (
        {"element.2.force": GONE, "element.2.law": "linear-dampr", "printed": GONE, "accept.k1": 0.001},
        ["element.2.law: law 'linear-dampr': unknown; did you mean 'linear-damper'"],
    ),
    ({"system.mass": "1.5 m"}, ["system.mass: '1.5 m' is a length, but kg (a mass) is needed"]),
    ({"system.mass": GONE}, ["system.mass: is missing"]),
    ({"system.mass": 0.0}, ["system.mass: is 0 kg; a number above 0 is needed"]),
    ({"test.method": "magic"}, ["test.method: is 'magic'; 'time' or 'harmonic-balance' is needed"]),
    ({"name": "CON"}, ["name: 'CON' is the name of a device on Windows"]),
    ({"name": "../good"}, ["name: '../good' is not a plain name"]),
    ({"printed.stiffness": "k1 + 3/4***X**2"}, ["printed.stiffness:"]),
    ({"printed.stiffness": "k1 + 3/4*kn7*X**2"}, ["printed.stiffness:"]),
    ({"schema": 2}, ["schema: is 2; 1 is needed"]),
    ({"test.sweep": "both"}, ["test.sweep: is 'both'; 'rest', 'up' or 'down' is needed"]),
    ({"title": "\u202e case"}, ["title: contains U+202E"]),
    ({"title": "\x1b[2J case"}, ["title: contains U+001B"]),
    ({"title": "x" * 1011}, ["title: has 1011 characters; at most 300"]),
    ({"title": GONE}, ["title: is missing"]),
    ({"title": 5}, ["title: is 5; a text in quotes of at most 2000 characters is needed"]),
    ({"truth.c1": True}, ["truth.c1: is true; a finite number in SI units or a text with its unit"]),
    (
        {"truth.c1": "3.8 N/m"},
        [
            "truth.c1: '3.8 N/m' is a stiffness, but N*s/m (a damping coefficient) is needed; "
            "c1*v must be a force"
        ],
    ),
    ({"truth.c1": math.inf}, ["truth.c1: is inf; a finite number in SI units"]),
    ({"truth": GONE}, ["truth: is missing; a simulated case needs a value for each of c1, k1, kn1"]),
    (
        {"truth.kn1": GONE},
        ["element.1.force: 'kn1' has neither a value in [truth] nor an equation in element.1.memory"],
    ),
    ({"truth.c1": "3.8 parrots"}, ["truth.c1: '3.8 parrots': the unit 'parrots' is not known"]),
    (
        {
            "element.1.force": "k1*x + a*b*x**2",
            "printed": GONE,
            "truth.kn1": GONE,
            "truth.a": "2 N",
            "truth.b": "3 m",
        },
        ["truth: a*b*x**2 is in N*m^3, a force is needed"],
    ),
    (
        {"truth.kn2": 1},
        ["truth.kn2: is no parameter of the elements; did you mean 'kn1'? known: c1, k1, kn1"],
    ),
    ({"truth.c1": "3.8"}, ["truth.c1: '3.8' is a number in quotes"]),
    (
        {"test.level.count": 0, "titel": "x"},
        ["titel: is not a key here", "test.level.count: is 0; a whole number from 1 to 1000000 is needed"],
    ),
    (
        {"name": "a/b", "system.mass": 0, "truth.kn1": GONE},
        [
            "name: 'a/b' is not a plain name",
            "element.1.force: 'kn1' has neither a value in [truth] nor an equation",
            "system.mass: is 0 kg",
        ],
    ),
    ({"title": "A", "titel": "B"}, ["titel: is not a key here; did you mean 'title'? known: schema, name"]),
    ({"element.2.forse": "x"}, ["element.2.forse: is not a key here; did you mean 'force'?"]),
    (
        {"test.level.step": 2},
        [
            "test.level.step: is not a key here; did you mean 'stop'? "
            "known: start, stop, count, spacing, values"
        ],
    ),
    (
        {"test.frequency": GONE, "test.frequncy": {"start": 7, "stop": 13, "count": 5}},
        ["test.frequency: is missing", "test.frequncy: is not a key here; did you mean 'frequency'?"],
    ),
    *(
        (
            {"element.2.force": "c1*v + z", "element.2.memory": memory, "truth.a": 1.0, "truth.b": 1.0},
            [f"element.2.{text}"],
        )
        for memory, text in (
            (
                {"z": "a*v - b*abs(v)*z", "y": "a*v - b*abs(v)*y"},
                "memory.y: y stands neither in the force nor in the equation of a state that does",
            ),
            ({"z": "a*v - b*abs(v)*z + sin(t)"}, "memory.z: depends on t; an equation of a state is written"),
            (
                {"z": "a*v - b*abs(v)*z + y"},
                "memory.z: 'y' has neither a value in [truth] nor an equation in element.2.memory; known: a",
            ),
            ({"z": "a*b"}, "memory.z: a*b depends on neither x, v nor a state"),
            ({"z": "a*b*(v"}, "memory.z: column 6: 1 parenthesis not closed"),
            ({"z": "b*(-v)**a"}, "memory.z: law: (-v)**a: not real for negative v"),
            ({"z": 5}, "memory.z: is 5; a text in quotes"),
            (
                {"z": "b*masing(a*x)"},
                "memory.z: b*masing(a*x): masing and structural stand in the force only",
            ),
        )
    ),
    (
        {"element.2.force": "c1*v + z"},
        ["element.2.force: 'z' has neither a value in [truth] nor an equation in element.2.memory"],
    ),
    (
        {"element.2.memory": {"z": "v"}, "element.2.law": "linear-damper", "element.2.force": GONE},
        ["element.2.law: 'memory' belongs to a 'force'; a law of the library has its own"],
    ),
    (
        {"element.2.force": "c1*v + z", "element.2.memory": {"z": "a*v - abs(v)*z/b"}}
        | {"truth.a": 1.0, "truth.b": 1.0, "truth.z": 1.0},
        ["truth.z: is a state; it is 0 at the start, known: a, b, c1, k1, kn1"],
    ),
    (
        {"element.2.force": "c1*v + k1", "element.2.memory": {"k1": "a*v - a*abs(v)*k1"}, "truth.a": 1.0},
        ["element: k1: a state and a parameter have this name; rename one"],
    ),
    (
        {"element.2.force": "masing(-c1*x)"},
        ["element.2.force: masing(-c1*x): a virgin curve must be positive"],
    ),
    (
        {"element.2.force": "masing(c1*x + kn1)"},
        ["element.2.force: masing(kn1 + c1*x): a virgin curve must be zero at x = 0"],
    ),
    ({"truth.c1": Literal("9" * 400)}, ["truth.c1: an integer of"]),
    ({"truth.c1": Literal("1e-400")}, ["truth.c1: too small for a number"]),
]
OF_TABLE: list[Row] = [
    (
        {"test.response.imag": "b"},
        ["test.response.imag: is not a key here; did you mean 'imaginary'? known: amplitude, phase, real,"],
    ),
    ({"test.calibrated": False}, ["test.calibrated: is not a key here; known: file, frequency, force,"]),
    ({"test.file": "/etc/passwd"}, ["test.file: '/etc/passwd' is an absolute path"]),
    ({"accept": {"k1": 0.001}}, ["accept: a measured case has no truth"]),
    ({"test.frequency.column": 0}, ["test.frequency.column: is 0; a column number from 1"]),
    (
        {"test.layout": {"delimiter": ",", "decimal": ","}},
        ["test.layout.delimiter: ',' is the decimal sign here"],
    ),
    (
        {"test.format": "xls"},
        [
            "test.format: is 'xls'; 'auto', 'csv', 'mat', 'hdf5', 'npy', 'npz', 'uff', 'lvm', 'tdms', "
            "'xlsx' or 'wav' is needed"
        ],
    ),
    (
        {"test.response.imaginary": GONE},
        ["test.response: give amplitude (with phase), or real and imaginary"],
    ),
    (
        {"test.force": GONE, "test.base": {"quantity": "acceleration", "unit": "m/s^2"}},
        ["test.base: give amplitude (with phase), or real and imaginary"],
    ),
    ({"test.file": ["a.csv", "b.csv"], "test.sha256": "0" * 64}, ["test.sha256: 1 for 2 files"]),
    ({"test.level": {"column": 5, "value": "1 N"}}, ["test.level: has value and column"]),
    ({"test.level": {"name": "run.csv"}}, ["test.level.name: must have {level} once"]),
    (
        {"test.file": ["a.csv", "b.csv"], "test.level": {"values": [1, 2, 3]}},
        ["test.level.values: 3 for 2 files"],
    ),
    ({"test.frequency": GONE}, ["test.frequency.column: is missing"]),
    (
        {"test.response": GONE, "test.recponse": {"quantity": "velocity"}},
        [
            "test.recponse: is not a key here; did you mean 'response'?",
            "test.response: give amplitude",
            "test.response.quantity: is missing",
        ],
    ),
    (
        {"test.response.real": GONE, "test.response.imaginary": GONE, "test.response.amplitude": 3},
        ["test.response.phase: is missing"],
    ),
    (
        {"test.response.phase_sense": GONE},
        ["test.response.phase_sense: is missing; 'lag' (positive means later) or 'lead'"],
    ),
    (
        {"test.force.amplitude": GONE, "test.force.nominal": True},
        ["test.level: is missing; without a force value, values, column or name is needed"],
    ),
    ({"test.file": "../data.csv"}, ["test.file: '../data.csv' leaves its folder"]),
    (
        {
            "test.response.real": GONE,
            "test.response.phase_sense": "lag",
            "test.response.imaginary": GONE,
            "test.response.amplitude": 3,
            "test.response.phase": 4,
            "test.response.phase_known": False,
        },
        ["test.response.phase_known: is false, but there is a phase"],
    ),
    (
        {"test.response.quantity": "jerk"},
        ["test.response.quantity: is 'jerk'; 'displacement', 'velocity' or 'acceleration' is needed"],
    ),
    (
        {
            "test.response.quantity": "acceleration",
            "test.response.real": GONE,
            "test.response.phase_sense": GONE,
            "test.response.imaginary": GONE,
            "test.response.samples": "A",
        },
        ["test.response: give amplitude (with phase), or real and imaginary, or complex"],
    ),
    ({"test.file": ["a.csv", "../b.csv"]}, ["test.file.2: '../b.csv' leaves its folder"]),
    ({"test.sha256": "abc"}, ["test.sha256.1: is 'abc'"]),
    ({"test.sweep": {"column": 5}}, ["test.sweep: up and down must say"]),
    ({"test.time": {"rate": 400}}, ["test.time: belongs to time histories"]),
    ({"truth": {"k1": 1}}, ["truth: a measured case knows no truth"]),
    ({"test.response.unit": "N"}, ["test.response"]),
    ({"test.file": "http://127.0.0.1:9/x.csv"}, ["test.file: 'http://127.0.0.1:9/x.csv' contains a sign"]),
]
OF_HISTORY: list[Row] = [
    ({"test.demodulation": {"band": [9, 8]}}, ["test.demodulation.band: the lowest frequency stands first"]),
    (
        {"system": GONE, "test.excitation": "ring-down", "test.force": GONE},
        ["system.mass: is missing; a free decay determines stiffness and damping per mass only"],
    ),
    ({"test.time": GONE}, ["test.time.column: one of column, rate and rate_column is needed"]),
    ({"test.response.scale": "rms"}, ["test.response.scale: is 'rms', but samples are instants"]),
    (
        # a wrong value is not a missing one, and hides no other fault
        {
            "test.time.rate": "-4 Hz",
            "test.demodulation": {"band": ["3 Hz", "2 m"], "bandwidth": 0},
            "test.file": ["a.csv", "../b"],
            "test.force": {"samples": 1, "scale": "rms", "unit": "mm"},
            "test.response": {"quantity": "velocity", "amplitude": 2, "factor": 0},
            "test.level": {"value": -3},
            "identify": {"hold_out": ["4 mm"]},
        },
        [
            "test.time.rate: is -4 Hz; a number above 0 is needed",
            "test.demodulation.band.2: '2 m' is a length, but Hz",
            "test.demodulation.bandwidth: is 0 Hz; a number above 0 is needed",
            "test.file.2: '../b' leaves its folder",
            "test.force.scale: is 'rms', but samples are instants",
            "test.force: '1 mm' is a length, but N (a force) is needed",
            "test.response.factor: is 0; a number other than 0 is needed",
            "test.response: a time history needs 'samples', its column, and nothing else",
            "test.level.value: is -3 N; a number above 0 is needed",
            "identify.hold_out.1: '4 mm' is a length, but N (a force) is needed",
        ],
    ),
]
OF_TEXT: list[tuple[str, bytes, str]] = [
    ("not UTF-8", b'schema = 1\nname = "M\xfcller"\n', "line 2: not UTF-8"),
    ("lists in lists", b"a = " + b"[" * 5000 + b"]" * 5000, "nested too deeply to be read"),
    ("digits", b"a = " + b"9" * 5000, "a number cannot be read"),
    ("dots", b"schema = 1\n" + b"a." * 8999 + b"a = 1", "line 2: a key of more than 40 parts"),
    ("syntax", b"schema = 1\nname = good\n", "line 2, column 8: Invalid value; a case file is TOML 1.0"),
    (
        "twice",
        b"schema = 1\nschema = 1\n",
        "line 2, column 11: Cannot overwrite a value; a case file is TOML 1.0",
    ),
]
"""Name, content and message of files that are no TOML."""


def toml(value: Any) -> str:
    """Write a value as TOML in one line."""
    if isinstance(value, Literal):
        return value.text
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    # JSON and TOML agree in texts, numbers and truth values
    return repr(value) if isinstance(value, float) else json.dumps(value)


def changed(case: dict[str, Any], changes: Changes) -> bytes:
    """Write a case with changes."""
    tree = copy.deepcopy(case)
    for path, value in changes.items():
        *parents, key = path.split(".")
        place: Any = tree
        for parent in parents:
            place = place[int(parent) - 1] if isinstance(place, list) else place[parent]
        if value is GONE:
            del place[key]
        else:
            place[key] = value
    return "".join(f"{key} = {toml(value)}\n" for key, value in tree.items()).encode()


@dataclass(frozen=True)
class Fault:
    """A faulty case file and all that is said about it."""

    name: str
    content: bytes
    expected: tuple[str, ...]

    def write(self, folder: Path) -> Path:
        """Write it into a folder."""
        path = folder / "faulty.toml"
        path.write_bytes(self.content)
        return path


FAULTS = [
    *(
        Fault(",".join(changes), changed(case, changes), tuple(expected))
        for case, rows in ((SIMULATED, OF_SIMULATED), (TABLE, OF_TABLE), (HISTORY, OF_HISTORY))
        for changes, expected in rows
    ),
    *(Fault(name, content, (expected,)) for name, content, expected in OF_TEXT),
]
