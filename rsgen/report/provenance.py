"""Where a result comes from: inputs, versions, command, machine, durations."""

from __future__ import annotations

import datetime
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version

import rsgen
from rsgen.cases import Case
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.simulation import MultisineTest, SimulatedTest
from rsgen.files import MeasuredTest

__all__ = ["collect_provenance"]

_PACKAGES = ("numpy", "scipy", "sympy", "numba", "matplotlib", "h5py")


def _versions() -> str:
    found = [f"rsgen {rsgen.__version__}", f"Python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def _origin(case: Case | None) -> dict[str, str]:
    """Name the case file and its test; empty without a case file."""
    if case is None:
        return {}
    named = {"Case file": case.path.name, "SHA-256 of the case": case.sha256}
    if isinstance(case.test, MeasuredTest):
        return named | {
            "Measured file": ", ".join(path.name for path in case.test.all_files),
            "SHA-256 of the measured file": ", ".join(case.test.sha256) or "not fixed by the case",
        }
    noise = f"{case.test.noise_relative:g} relative, seed {case.test.seed}"
    if isinstance(case.test, MultisineTest):
        made = f"multisine, {case.test.lines} lines, {case.test.realisations} realisations a level"
        return named | {"Simulation": made, "Noise": noise if case.test.noise_relative else "none"}
    return named | {
        "Simulation": f"{case.test.method}, {_held(case.test)}, sweep {case.test.sweep}, "
        f"accuracy {case.test.accuracy:g}",
        "Noise": noise if case.test.noise_relative else "none",
    }


def _held(test: SimulatedTest) -> str:
    return f"{test.base} of the base" if test.base else f"{test.control} control"


def _table(table: ResponseSurface | MultisineSpectra) -> dict[str, str]:
    """Name what was identified from."""
    if isinstance(table, MultisineSpectra):
        size = f"{len(table)} records of {table.periods} periods, {table.lines[-1]} lines"
        return {"Spectra": f"{table.origin}, {size}"}
    return {"Surface": f"{table.origin}, {len(table)} points"}


def collect_provenance(
    case: Case | None,
    surface: ResponseSurface | MultisineSpectra,
    durations: Mapping[str, float],
    command: Sequence[str],
) -> dict[str, str]:
    """Give name and value pairs for the last section of the page.

    Parameters
    ----------
    durations
        Seconds by stage.
    command
        What was called; empty where rsgen was used from Python.
    """
    entries = {
        **_origin(case),
        **_table(surface),
        "Versions": _versions(),
        "Machine": f"{platform.system()} {platform.machine()}, {platform.python_implementation()}",
        "Command": " ".join(command) or "called from Python",
        "Written": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
    if durations:
        entries["Durations"] = ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in durations.items())
    return entries
