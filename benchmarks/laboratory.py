"""A laboratory: a virtual test of a case of ``cases/`` as files and a case file with no truth in it.

A stepped sine gives a table of the forces and of the fundamental of the acceleration, as most laboratories
keep it; a history of force and displacement comes from an integrator that shares nothing with rsgen.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

import rsgen
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Verdict
from rsgen.data.record_set import QUANTITIES
from rsgen.dynamics.virtual_test import add_noise
from tests.case_files import MEASURED, Changes, law, write_small
from tests.oracles.swept import driven

CASES = Path(__file__).parents[1] / "cases"
NAMES = ("bilinear", "combined", "coulomb", "cubic", "cubic-hardening", "joint", "piecewise", "quintic")
NOISE = 0.003
EVERY = 3
"""Every third frequency of the case: some forty a level, as a patient laboratory steps them."""


@dataclass(frozen=True)
class Laboratory:
    """A stepped sine in a table, a row a point; what the file says and how the case reads it.

    ``test`` are the tables of the case file below ``[test]`` by name, for tamperings to change.
    """

    name: str
    laws: tuple[str, ...]
    level: np.ndarray  # (n,) [N]
    frequency: np.ndarray  # (n,) [Hz]
    force: np.ndarray  # (n,) amplitude [N]
    response: np.ndarray  # (n,) complex, relative to the force, in the unit of the file
    heads: tuple[str, ...] = ("level_N", "f_Hz", "force_N", "a_real", "a_imag")
    test: dict[str, dict[str, object]] = field(
        default_factory=lambda: {
            "frequency": {"column": "f_Hz"},
            "force": {"amplitude": "force_N"},
            "response": {
                "quantity": "acceleration", "real": "a_real", "imaginary": "a_imag", "phase_sense": "lead",
            },
            "level": {"column": "level_N"},
        }
    )  # fmt: skip
    further: Changes = field(default_factory=dict)

    @property
    def levels(self) -> np.ndarray:
        """The levels of the test, ascending [N]."""
        return np.unique(self.level)

    @property
    def natural_frequency(self) -> float:
        """Where the response to the lowest level is largest [Hz]."""
        lowest = self.at(self.levels[0])
        size = np.abs(self.response[lowest]) / self.frequency[lowest] ** 2
        return float(self.frequency[lowest[np.argmax(size)]])

    def at(self, level: float) -> np.ndarray:
        """Rows of a level in the order of the file."""
        return np.flatnonzero(self.level == level)

    def reading(self, table: str, **keys: object) -> Laboratory:
        return replace(self, test={**self.test, table: {**self.test[table], **keys}})

    def keep(self, rows: np.ndarray) -> Laboratory:
        columns = ("level", "frequency", "force", "response")
        return replace(self, **{column: getattr(self, column)[rows] for column in columns})

    def write(self, folder: Path) -> Path:
        turned = self.response if "real" in self.test["response"] else np.abs(self.response)
        table = np.column_stack([self.level, self.frequency, self.force, turned.real, turned.imag])
        np.savetxt(
            folder / "table.csv", table, fmt="%.9g", delimiter=",", header=",".join(self.heads), comments=""
        )
        read = {f"test.{name}": keys for name, keys in self.test.items()}
        response = self.test["response"]
        read["test.response"] = {"unit": QUANTITIES[str(response["quantity"])], **response}
        return write_measured(folder, self.laws, {"test.file": "table.csv"} | read | self.further)


@dataclass(frozen=True)
class Record:
    """A history of force and displacement, and the ``excitation`` that the case takes it for."""

    laws: tuple[str, ...]
    mass: float
    rate: float
    force: np.ndarray
    displacement: np.ndarray
    excitation: str
    further: Changes = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        np.savez(folder / "record.npz", force=self.force, displacement=self.displacement)
        ring = self.excitation == "ring-down"
        samples = {
            "test.file": "record.npz",
            "test.excitation": self.excitation,
            "test.time": {"rate": self.rate},
        }
        samples["test.response"] = {"quantity": "displacement", "samples": "displacement", "unit": "m"}
        driven_by = {"test.force": {"samples": "force", "unit": "N"}, "test.level": {"value": "6 N"}}
        known = {"system": {"mass": self.mass}} if ring else driven_by
        return write_measured(folder, self.laws, samples | known | self.further)


def write_measured(folder: Path, laws: tuple[str, ...], changes: Changes) -> Path:
    """Write the case of a measured test with these laws; give its path."""
    return write_small(folder, "case", {**law(*laws), **MEASURED} | changes)


@cache
def load(name: str) -> rsgen.Case:
    return rsgen.load_case(CASES / f"{name}.toml")


@cache
def simulated(name: str) -> rsgen.ResponseSurface:
    case = load(name)
    return rsgen.simulate(case.oscillator, case.test)


def stepped(name: str, noise: float = NOISE, seed: int = 1, every: int = EVERY) -> Laboratory:
    surface = add_noise(simulated(name), noise, seed)
    grid = np.unique(surface.frequency)[::every]
    surface = surface.select(surface.settled & np.isin(surface.frequency, grid))
    turned = surface.harmonics[:, 1] * np.exp(-1j * np.angle(surface.force))
    return Laboratory(
        name, tuple(str(element.force) for element in load(name).model.elements), surface.level,
        surface.frequency, np.abs(surface.force), -(surface.omega**2) * turned,
    )  # fmt: skip


def recorded(name: str, force: np.ndarray, rate: float, excitation: str, seed: int = 1) -> Record:
    """The displacement of a case's structure under any force, with the noise of its sensor."""
    case = load(name)
    x = driven(case.oscillator, force, rate)
    x = x + NOISE * np.std(x) * np.random.default_rng(seed).standard_normal(len(x))
    laws = tuple(str(element.force) for element in case.model.elements)
    return Record(laws, case.oscillator.mass, rate, force, x, excitation)


@dataclass(frozen=True)
class Outcome:
    """What rsgen said of a case: a verdict with the findings behind it, or the sentence of a refusal."""

    verdict: Verdict | None
    findings: tuple[Finding, ...] = ()
    refusal: str = ""
    crashed: bool = False

    @property
    def state(self) -> str:
        """The verdict in a word; "refused" where there is no result, "crashed" where there is no sentence."""
        if self.verdict is not None:
            return self.verdict.state
        return "crashed" if self.crashed else "refused"

    @property
    def deciding(self) -> tuple[str, ...]:
        """Codes of the findings that decided, each once."""
        decided = self.verdict.decided_by if self.verdict is not None else ()
        return tuple(dict.fromkeys(finding.code for finding in decided))

    @property
    def doubted(self) -> bool:
        """Whether nobody would take the result for good."""
        return self.state in ("refused", "rejected", "doubtful")


def judge(path: Path) -> Outcome:
    """Go from a case file to the verdict as ``rsgen identify`` does; nothing is compared with a truth."""
    try:
        case = rsgen.load_case(path)
        found = rsgen.identify(rsgen.read(case), case.model)
        return Outcome(found.verdict, found.findings)
    except RsgenError as refusal:
        return Outcome(None, refusal=" ".join(str(refusal).split()))
