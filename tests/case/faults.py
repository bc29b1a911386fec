"""Faults of case files: what is changed in a good case; what is said about it is in ``sentences.json``."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rsgen.cases.loading import load_case
from rsgen.common.errors import CaseError
from tests.case_files import GONE, Changes, Literal, changed

SPRING = {"name": "spring", "force": "k1*x + kn1*x**3"}
DAMPER = {"name": "damper", "force": "c1*v"}
SIMULATED = {
    "schema": 1, "name": "good", "title": "A good case", "system": {"mass": "1.5 kg"},
    "element": [SPRING, DAMPER], "printed": {"stiffness": "k1 + 3/4*kn1*X**2"},
    "truth": {"k1": "5.92 kN/m", "kn1": "-2.2e5 N/m^3", "c1": 3.8},
    "test": {
        "kind": "simulated", "level": {"start": 1, "stop": 12, "count": 4},
        "frequency": {"start": 7, "stop": 13, "count": 5},
    },
    "identify": {"hold_out": []},
    "accept": {"k1": 1e-4},
}  # fmt: skip
TABLE = {
    "schema": 1, "name": "good", "title": "A good case", "system": {"mass": "1.5 kg"},
    "element": [SPRING, DAMPER],
    "test": {
        "kind": "measured", "file": "data.csv", "frequency": {"column": 1}, "force": {"amplitude": 2},
        "response": {"quantity": "velocity", "real": 3, "imaginary": 4, "phase_sense": "lead"},
    },
}  # fmt: skip
HISTORY = {
    **TABLE,
    "test": {
        "kind": "measured", "file": "data.mat", "excitation": "swept-sine", "force": {"samples": "F"},
        "response": {"quantity": "acceleration", "samples": "A"}, "time": {"rate": 400},
    },
}  # fmt: skip

OF_SIMULATED: list[Changes] = [
    {"accept.k1": 0, "accept.kn9": 0.001, "accept.c1": "small", "titel": "A bad case"},
    {"test.noise": {"relative": -0.1}}, {"test.noise": 0.01}, {"test.noise_relative": 0.01},
    {"identify.model": "rank"}, {"test.level": [1, 2, 3]}, {"identify.band": ["9 Hz", "8 Hz"]},
    {"identify.band": ["9 Hz", "8 m"], "system.mass": "0 kg"}, {"identify.background": 1},
    {"identify.calibrated": False}, {"test.harmonics": 65, "test.accuracy": 1.0},
    {"accept": {"kn1": 1e-4}, "model": "rank"}, {"element": []},
    {"element": GONE, "printed": GONE, "truth": GONE, "accept": GONE}, {"element.2.name": "Spring"},
    {"test.frequency.start": "44 rad/s"}, {"test.level.values": [1]}, {"test.level.count": 1},
    {"test.level": {"values": []}}, {"test.level.count": 100000, "test.frequency.count": 100000},
    {"test.level.stop": GONE}, {"test.level": {"values": [1.0, 1.0, 2.0]}},
    {"test.level": {"values": [1]}, "identify.hold_out": [1]}, {"identify.hold_out": [5.5]},
    {"test.control": "phase", "identify.predict": ["9 N"]}, {"test.kind": GONE}, {"test.kind": "simulate"},
    {"element.2.force": "__import__(1)"}, {"element.2.force": "c1*v + k1*v"},
    {"element.2.force": "m*v", "truth.c1": GONE}, {"element.2.force": "c1*(v"},
    {"element.2.force": GONE, "element.2.law": "linear-dampr", "printed": GONE, "accept.k1": 0.001},
    {"system.mass": "1.5 m"}, {"system.mass": GONE}, {"name": "CON"},
    {"printed.stiffness": "k1 + 3/4*kn7*X**2"}, {"schema": 2}, {"title": "\u202e case"},
    {"title": "x" * 1011}, {"title": 5}, {"truth.c1": True}, {"truth.c1": "3.8 N/m"}, {"truth": GONE},
    {
        "element.1.force": "k1*x + a*b*x**2", "printed": GONE, "truth.kn1": GONE, "truth.a": "2 N",
        "truth.b": "3 m",
    },
    {"truth.kn2": 1},
    {"name": "a/b", "system.mass": 0, "truth.kn1": GONE}, {"element.2.forse": "x"},
    {"system.mass_error": "1 g"}, {"system.mass": {"value": "1.5 kg", "error": "15 g"}},
    {"system.mass": "1.5 kg ± 15 g"}, {"system.mass": "1.5 kg +- 1 %"},
    {"test.frequency": GONE, "test.frequncy": {"start": 7, "stop": 13, "count": 5}},
    *(
        {"element.2.force": "c1*v + z", "element.2.memory": memory, "truth.a": 1.0, "truth.b": 1.0}
        for memory in (
            {"z": "a*v - b*abs(v)*z", "y": "a*v - b*abs(v)*y"}, {"z": "a*v - b*abs(v)*z + sin(t)"},
            {"z": "a*v - b*abs(v)*z + y"}, {"z": "a*b"}, {"z": "b*(-v)**a"}, {"z": "b*masing(a*x)"},
        )
    ),
    {"element.2.memory": {"z": "v"}, "element.2.law": "linear-damper", "element.2.force": GONE},
    {"element.2.force": "c1*v + z", "element.2.memory": {"z": "a*v - abs(v)*z/b"}}
    | {"truth.a": 1.0, "truth.b": 1.0, "truth.z": 1.0},
    {"element.2.force": "c1*v + k1", "element.2.memory": {"k1": "a*v - a*abs(v)*k1"}, "truth.a": 1.0},
    {"element.2.force": "masing(-c1*x)"}, {"element.2.force": "masing(c1*x + kn1)"},
    {"truth.c1": Literal("9" * 400)}, {"truth.c1": Literal("1e-400")},
]  # fmt: skip
OF_TABLE: list[Changes] = [
    {"test.channels": {"a": {"quantity": "velocity", "real": 3, "imag": 4, "phase_sense": "lead"}}},
    {"test.channels": {"a": {"quantity": "velocity", "amplitude": 3, "unit": "N"}}},
    {"element.2.across": "tip - root"}, {"test.calibrated": False}, {"test.file": "/etc/passwd"},
    {"accept": {"k1": 0.001}}, {"test.frequency.column": 0},
    {"test.layout": {"delimiter": ",", "decimal": ","}}, {"test.format": "xls"},
    {"test.force": GONE, "test.base": {"quantity": "acceleration", "unit": "m/s^2"}},
    {"test.file": ["a.csv", "b.csv"], "test.sha256": "0" * 64}, {"test.level": {"column": 5, "value": "1 N"}},
    {"test.level": {"name": "run.csv"}},
    {"test.file": ["a.csv", "b.csv"], "test.level": {"values": [1, 2, 3]}}, {"test.frequency": GONE},
    {"test.response.real": GONE, "test.response.imaginary": GONE, "test.response.amplitude": 3},
    {"test.response.phase_sense": GONE}, {"test.force.amplitude": GONE, "test.force.nominal": True},
    {
        "test.response.real": GONE, "test.response.phase_sense": "lag", "test.response.imaginary": GONE,
        "test.response.amplitude": 3, "test.response.phase": 4, "test.response.phase_known": False,
    },
    {"test.response.quantity": "mobility"},
    {
        "test.response.quantity": "acceleration", "test.response.real": GONE,
        "test.response.phase_sense": GONE, "test.response.imaginary": GONE, "test.response.samples": "A",
    },
    {"test.sha256": "abc"}, {"test.sweep": {"directon": "up"}}, {"test.time": {"rate": 400}},
    {"truth": {"k1": 1}}, {"test.file": "http://127.0.0.1:9/x.csv"}, {"system.mass_error": "-1 g"},
    {"system.mass_error": 0.1, "system.mass": GONE},
]  # fmt: skip
OF_HISTORY: list[Changes] = [
    {"test.demodulation": {"band": [9, 8]}},
    {"system": GONE, "test.excitation": "ring-down", "test.force": GONE}, {"test.time": GONE},
    {"test.response.scale": "rms"},
    {"test.level": {"values": [1], "unit": "label"}, "identify": {"hold_out": ["0.6 V", "600 mV"]}},
    {"test.level": {"values": ["0.5 V"]}, "identify": {"hold_out": ["1.5 V"], "predict": ["4 V"]}},
    {"test.level": {"values": [1], "unit": "label"}, "identify": {"predict": [4]}},
    {"test.level": {"values": [1], "unit": "V"}}, {"test.sweep": {"direction": "down"}},
    {"test.level": {"values": ["3 N"]}, "test.excitation": "ring-down", "test.force": GONE},
    {"test.excitation": "ring-down", "test.force": GONE, "identify": {"hold_out": ["40 mm"]}},
    {
        "test.time.rate": "-4 Hz", "test.demodulation": {"band": ["3 Hz", "2 m"], "bandwidth": 0},
        "test.file": ["a.csv", "../b"], "test.force": {"samples": 1, "scale": "rms", "unit": "mm"},
        "test.response": {"quantity": "velocity", "amplitude": 2, "factor": 0}, "test.level": {"value": -3},
        "identify": {"hold_out": ["4 mm"]},
    },
]  # fmt: skip
OF_TEXT: dict[str, bytes] = {
    "not UTF-8": b'schema = 1\nname = "M\xfcller"\n', "lists in lists": b"a = " + b"[" * 5000 + b"]" * 5000,
    "digits": b"a = " + b"9" * 5000, "dots": b"schema = 1\n" + b"a." * 8999 + b"a = 1",
    "syntax": b"schema = 1\nname = good\n", "twice": b"schema = 1\nschema = 1\n",
}  # fmt: skip
"""Files that are no TOML."""


@dataclass(frozen=True)
class Fault:
    """A faulty case file; ``sentences.json`` has all that is said about it."""

    name: str
    content: bytes

    def write(self, folder: Path) -> Path:
        path = folder / "faulty.toml"
        path.write_bytes(self.content)
        return path


def _faults():
    times = Counter[str]()
    for case, rows in ((SIMULATED, OF_SIMULATED), (TABLE, OF_TABLE), (HISTORY, OF_HISTORY)):
        for changes in rows:
            times[name := ",".join(changes)] += 1
            yield Fault(f"{name} {times[name]}" if times[name] > 1 else name, changed(case, changes).encode())
    for name, content in OF_TEXT.items():
        yield Fault(name, content)


FAULTS = list(_faults())
SENTENCES = Path(__file__).with_name("sentences.json")
"""What is said of each fault; ``python -m tests.case.faults`` renews it, for a reader to judge."""


def said(fault: Fault) -> list[str]:
    """Return what loading a faulty case says, each with the place first."""
    with TemporaryDirectory() as folder:
        path = fault.write(Path(folder))
        try:
            load_case(path)
        except CaseError as error:
            return [sentence.removeprefix(f"{path}: ") for sentence in error.faults]
    return []


if __name__ == "__main__":
    text = json.dumps({fault.name: said(fault) for fault in FAULTS}, indent=1)
    SENTENCES.write_text(text + "\n", encoding="utf-8")
