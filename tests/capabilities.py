"""Two tables of what each kind of test can do, made by doing it: ``docs/capabilities.md``.

Every row is a virtual test of one cubic structure, every column something that a user asks of it.
``python -m tests.capabilities`` writes the page anew; the tests try every cell.
"""

import functools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsgen as rs
from rsgen.app.cli import main
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import BACKGROUNDS, OFFSET
from tests.case_files import Changes, law, write_small
from tests.surfaces import changed, distorted, without_phase

LAW = "k*x + k3*x**3 + c*v"
TRUTH = {"k": 5920.0, "k3": 3e5, "c": 6.0}
MASS = 1.5
RIVALS = (LAW, "k*x + c*v", "k*x + c*v + Ff*sign(v)", "k*x + k5*x**5 + c*v")
MAX_STANDARD_ERRORS = 5.0
MAX_ERROR_HELD_OUT = 0.1

Records = rs.ResponseSurface | MultisineSpectra

_NOISE = {"noise": {"relative": 0.01, "seed": 3}}
_STEPPED = {"kind": "simulated", "frequency": {"start": 8, "stop": 13, "count": 31}, **_NOISE}
_FORCES = {"level": {"values": ["2 N", "5 N", "8 N", "12 N"]}}
_FORCED = _STEPPED | _FORCES
_SWEEP = {
    "kind": "simulated-sweep", "band": ["8 Hz", "13 Hz"], "duration": "60 s", "rate": "200 Hz",
    **_FORCES, **_NOISE,
}  # fmt: skip
_DECAY = {
    "kind": "simulated-decay", "level": {"values": ["20 mm", "40 mm"]}, "duration": "20 s",
    "rate": "400 Hz", "noise": {"relative": 0.003, "seed": 3},
}  # fmt: skip
_MULTISINE = {
    "kind": "simulated-multisine", "level": {"values": ["3 N", "5 N", "8 N"]}, "band": ["2.5 Hz", "20 Hz"],
    "period": "4 s", **_NOISE,
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    test: Changes  # the table [test] of its case file
    known: Mapping[str, Any] = field(default_factory=dict)  # keyword arguments of ``identify``
    change: Callable[[Any], Records] = lambda records: records  # what is done to the virtual records
    law: Any = LAW  # one formula, or elements
    values: Mapping[str, float] = field(default_factory=TRUTH.copy)
    rivals: Sequence[Any] = RIVALS  # laws that are ranked, the right one among them
    refused: Mapping[str, str] = field(default_factory=dict)  # columns with a no, each with its reason
    damping: float = TRUTH["c"]  # true value of c: a decay needs some hundred periods

    def write(self, folder: str) -> Path:
        truth = TRUTH | {"c": self.damping}
        return write_small(Path(folder), changes=law(LAW, **truth) | {"test": self.test})

    @functools.cached_property
    def records(self) -> Records:
        with tempfile.TemporaryDirectory() as folder:
            case = rs.load_case(self.write(folder))
        assert case.oscillator is not None
        return self.change(rs.simulate(case.oscillator, case.test))

    @property
    def level(self) -> float:
        """The level that is held out: the second largest, or its label."""
        return float(self.records.levels[-2])

    def identify(self, observation: rs.Observation | None = None, **known: Any) -> rs.Identification:
        """Identify the law, and check what was found."""
        found = rs.identify(self.records, self.law, observation, **{**self.known, **known})
        assert found.verdict.usable, str(found.verdict)
        for name, value in self.values.items():
            bound = MAX_STANDARD_ERRORS * found[name].standard_error
            assert abs(found[name].value - value) <= bound, f"{name}: {found[name].value:.4g}"
        return found


def _ranked(row: Row) -> None:
    ranking = rs.rank(row.records, row.rivals, mass=row.known.get("mass"))
    right = next(one for one in ranking if one.values.keys() - {"m"} == row.values.keys())
    assert right.tied or right is ranking.candidates[0], f"{right.name} is not among the best"
    assert ranking.fits, str(ranking.verdict)


def _held_out(row: Row) -> None:
    found = row.identify(rs.Observation(hold_out=(row.level,)))
    prediction = rs.predict(found, surface=row.records)
    scores = [level.error for level in (*prediction.held_out, *prediction.records)]
    assert scores, str(prediction)
    assert max(scores) < MAX_ERROR_HELD_OUT, f"a held-out level is off by {max(scores):.2g}"


def _predicted(row: Row) -> None:
    level = float(np.sqrt(row.records.levels[-2] * row.records.levels[-1]))
    assert rs.predict(row.identify(), [level]).curves


def _finite(numbers: Sequence[float] | np.ndarray) -> None:
    assert len(numbers)
    assert np.isfinite(numbers).all()


def _page(row: Row) -> None:
    with tempfile.TemporaryDirectory() as folder:
        rs.write_report(folder, row.records, row.identify())
        assert (Path(folder) / "report.html").stat().st_size


def _notebook(row: Row) -> None:
    """Run the case as a user does: simulation, page, notebook."""
    if row.law is not LAW:
        rs.simulate(rs.Oscillator(MASS, row.law, dict(row.values)), rs.SimulatedTest([1], [10]))
    with tempfile.TemporaryDirectory() as folder:
        with pytest.raises(SystemExit, match="0"):
            main(["run", str(row.write(folder)), "--out", f"{folder}/reports"])
        assert list(Path(folder).rglob("notebook.ipynb"))


COLUMNS: dict[str, Callable[[Row], object]] = {
    "identify": Row.identify, "rank": _ranked,
    **{
        f"background: {kind}": lambda row, kind=kind: row.identify(rs.Observation(background=kind))
        for kind in (*BACKGROUNDS[1:], "constant" + OFFSET)
    },
    "modal table": lambda row: _finite(rs.modal_table(row.records, mass=row.known.get("mass")).frequency),
    "predict": _predicted, "hold out": _held_out,
    "fixed": lambda row: row.identify(fixed={"c": row.values["c"]}),
    "profile": lambda row: _finite(rs.profile(row.identify(), "k3").interval),
    "page": _page, "virtual test, notebook": _notebook,
}  # fmt: skip

NO_FORCE = "a free decay has no force that a background could follow"
NOT_DETERMINED = "not determined by points at phase resonance alone"
BETWEEN = "the structure between the sensors is not modelled"
REASONS = (NO_FORCE, NOT_DETERMINED, BETWEEN)

_BACKGROUNDS = tuple(f"background: {kind}" for kind in (*BACKGROUNDS[2:], "constant" + OFFSET))
EXCITATIONS = {
    "stepped sine, force": Row(_FORCED),
    "stepped sine, response": Row(
        _STEPPED | {"control": "response", "level": {"start": "10 mm", "stop": "40 mm", "count": 4}}
    ),
    "stepped sine, phase (three lags)": Row(
        _FORCED | {"control": "phase", "phase": {"lags": ["60 deg", "90 deg", "120 deg"]}}
    ),
    "stepped sine, phase resonance alone": Row(
        _STEPPED | {"control": "phase", "level": {"start": 1, "stop": 12, "count": 24}}, {"mass": MASS},
        refused=dict.fromkeys(_BACKGROUNDS, NOT_DETERMINED),
    ),
    "continuation": Row(_STEPPED | {
        "control": "continuation", "level": {"start": "3 mm", "stop": "60 mm", "count": 24},
        "frequency": {"start": 8, "stop": 13, "count": 6},
    }),
    "swept sine": Row(_SWEEP),
    "free decay": Row(
        _DECAY, {"mass": MASS}, values={**TRUTH, "c": 1.0},
        refused=dict.fromkeys(("background: phase", *_BACKGROUNDS), NO_FORCE), damping=1.0,
    ),
    "multisine": Row(_MULTISINE),
}  # fmt: skip


def _joined(table: rs.ResponseSurface) -> rs.ResponseSurface:
    """Add the motion across a joint, seen by a gauge, whose cubic force acts on the mass."""
    count, order = len(table), table.harmonics.shape[1]
    across = (0.3 - 0.1j) ** (np.arange(order) > 0) * table.harmonics
    across[:, 0] = across[:, 0].real
    wave = np.fft.irfft(np.pad(across, ((0, 0), (0, 32))) * np.r_[1, np.full(order + 31, 0.5)], axis=1)
    joint = np.fft.rfft(JOINT * (wave * wave.shape[1]) ** 3, axis=1)[:, :order] / wave.shape[1]
    force = joint * np.r_[1, np.full(order - 1, 2)]
    force[:, 1] += table.force
    noise = np.random.default_rng(4).normal(size=(count, order, 2)) @ [1, 1j] * 0.01 / np.sqrt(2)
    noise[:, 0] = noise[:, 0].real
    across = across + noise * np.abs(across[:, 1:2])
    return changed(table, force=force[:, 1], force_harmonics=force, across=across)


JOINT = 4e6
JOINTS = ("kl*x", "kl*x + cj*v", "Ff*sign(v)", "k5*x**5")
_JOINED = [rs.make_element("wing", LAW), rs.make_element("joint", "kj*x**3", across="gauge")]
_PER_MASS = {name: value / MASS for name, value in TRUTH.items()}

MODIFIERS = {
    "driven base": Row(
        _STEPPED | {"base": {"quantity": "acceleration"}, "level": {"values": [2, 5, 8, 12]}},
        values=_PER_MASS,
    ),
    "two sensors": Row(
        _FORCED, change=_joined, law=_JOINED, values={**TRUTH, "kj": JOINT},
        rivals=[_JOINED, *([_JOINED[0], rs.make_element("joint", law, across="gauge")] for law in JOINTS)],
        refused=dict.fromkeys(("predict", "virtual test, notebook"), BETWEEN),
    ),
    "no phase": Row(_FORCED, change=without_phase),
    "given mass": Row(_FORCED, {"mass": MASS}),
    "harmonics of the force": Row(_FORCED, change=distorted),
}  # fmt: skip


def stated(row: Row, column: str) -> str:
    """Return what the page says of a cell."""
    return row.refused.get(column, "yes")


def answer(row: Row, column: str) -> str:
    """Return "yes", or why not, by trying it."""
    try:
        COLUMNS[column](row)
    except rs.RsgenError as refusal:
        return f"refused: {refusal}"
    except AssertionError as wrong:
        return f"wrong: {wrong}".splitlines()[0]
    return "yes"


def _table(rows: Mapping[str, Row]) -> list[str]:
    marks = {"yes": "yes"} | {reason: f"no [{i}]" for i, reason in enumerate(REASONS, 1)}
    lines = ["| | " + " | ".join(rows) + " |", "|---" * (len(rows) + 1) + "|"]
    for column in COLUMNS:
        cells = [marks[stated(row, column)] for row in rows.values()]
        lines.append(f"| {column} | " + " | ".join(cells) + " |")
    return lines


def page() -> str:
    reasons = [f"* [{i}] {reason[0].upper()}{reason[1:]}." for i, reason in enumerate(REASONS, 1)]
    return "\n".join([_HEAD, *_table(EXCITATIONS), _MODIFIED, *_table(MODIFIERS), "", *reasons, ""])


_HEAD = """# What each kind of test can do

Every cell is a virtual test with 1 % noise that `make test-all` runs: "yes" where values come back within
their errors, the right law is first, a held-out level is met. Noise of a sweep is 1 % of the largest sample
of its record, that of a decay 0.3 %, which is 1 % where a third of the amplitude is left.

## Excitation and control
"""
_MODIFIED = """
## What else is known of a test

The tests of this table are stepped sines with the force controlled.
"""

if __name__ == "__main__":
    Path("docs/capabilities.md").write_text(page(), encoding="utf-8")
