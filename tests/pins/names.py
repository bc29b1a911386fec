"""Names that others build on, pinned one by one: documented attributes, and what the files of a run hold.

A name that is gone or new fails the pin and is said; names.json has them sorted.
"""

import io
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path

import h5py
import numpy as np

import rsgen
from rsgen.analysis import comparison, fit_comparison
from rsgen.common import finding
from rsgen.data import history
from rsgen.data.multisine import linear
from rsgen.data.oscillator import Model
from rsgen.describing import function
from rsgen.dynamics.settling import SteadyStates
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import MeasuredTest
from rsgen.identification import modal_result, results
from rsgen.identification.prediction import prediction_result as predicted
from rsgen.identification.ranking.ranking_result import Candidate
from rsgen.law.element import Element
from tests.conftest import FEW
from tests.identification.test_across import two_masses
from tests.pins.grids import NOISE, small
from tests.pins.multisine import CUBIC, virtual
from tests.pins.pinned import Pin, Tree
from tests.pins.ranking import library
from tests.surfaces import changed, noisy

ROOT = Path(__file__).parents[2]

CLASSES: tuple[type, ...] = (
    rsgen.ResponseSurface, rsgen.MultisineSpectra, rsgen.Identification, results.MultisineIdentification,
    results.Estimate, results.Resonance, results.EquivalentCurve, results.RestoringForce, results.Background,
    linear.BestLinear, linear.Distortion, rsgen.Ranking, Candidate, rsgen.ModalTable, modal_result.ModalTest,
    rsgen.Prediction, predicted.ResonanceCurve, predicted.HeldOutLevel, predicted.PredictedRecord,
    SteadyStates, function.DescribingFunction, function.Equivalent,
    rsgen.Comparison, comparison.Row, fit_comparison.FitComparison,
    fit_comparison.FitRow, finding.Verdict, rsgen.Finding, finding.Quantity, rsgen.Observation,
    rsgen.Oscillator, Model, rsgen.Law, Element, rsgen.SimulatedTest, rsgen.MultisineTest, rsgen.Case,
    rsgen.SweepTest, rsgen.DecayTest, history.FreeDecay, history.SweepLaw, history.TimeHistory,
)  # fmt: skip


def attributes(kind: type) -> Tree:
    names = {name for name in dir(kind) if not name.startswith("_")}
    if is_dataclass(kind):
        names |= {each.name for each in fields(kind) if not each.name.startswith("_")}
    if kind is rsgen.ModalTable:
        names |= {f"{name}{end}" for name in modal_result.MODAL_COLUMNS for end in ("", "_lower", "_upper")}
    return {"names": sorted(names)}


def surface_names(table: rsgen.ResponseSurface) -> Tree:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "surface.h5"
        rsgen.save_surface(path, table)
        with h5py.File(path) as file:
            arrays = [f"array {name} [{file[name].attrs['units']}] {file[name].dtype.kind}" for name in file]
            return {"names": sorted([*arrays, *(f"attribute {name}" for name in file.attrs)])}


def paths_of(tree: object, path: str = "") -> Iterator[str]:
    """Every key of a JSON document with those above it; entries of a list are []."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield f"{path}/{key}"
            yield from paths_of(value, f"{path}/{key}")
    elif isinstance(tree, list):
        for value in tree:
            yield from paths_of(value, f"{path}[]")


@cache
def report_files(kind: str) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        surface, found, case = REPORTS[kind]()
        rsgen.write_report(folder, surface, found, case=case)
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


def result_names(kind: str) -> Tree:
    files = report_files(kind)
    return {"files": list(files), "names": sorted(set(paths_of(json.loads(files["result.json"]))))}


def _spectra_names() -> Tree:
    with np.load(io.BytesIO(report_files("multisine")["spectra.npz"])) as file:
        return {"names": sorted(f"{name} {file[name].dtype.kind} {file[name].ndim}d" for name in file)}


Parts = tuple[rsgen.ResponseSurface | rsgen.MultisineSpectra, rsgen.Identification, rsgen.Case | None]


def _sine() -> Parts:
    table = small("cubic", NOISE)
    about = rsgen.Observation(hold_out=(6.0,), background="phase")
    return table, rsgen.rank(table, library(*FEW), about).best, None


def _joint() -> Parts:
    case = rsgen.load_case(ROOT / "cases" / "jenkins.toml")
    assert isinstance(case.test, rsgen.SimulatedTest)
    test = replace(case.test, level=np.array([3.0, 6.0, 10.0]), frequency=np.linspace(8.6, 13.0, 15))
    case = replace(case, test=test)
    assert case.oscillator is not None
    table = noisy(rsgen.simulate(case.oscillator, test), NOISE, 1)
    return table, rsgen.identify(table, case.model), case


def _multisine() -> Parts:
    spectra = virtual("cubic", NOISE)
    return spectra, rsgen.identify(spectra, CUBIC, rsgen.Observation(hold_out=(5.0,))), None


def _measured() -> Parts:
    case = rsgen.load_case(ROOT / "tests" / "cases" / "nlbeam.toml", data=Path(os.environ["RSGEN_DATA"]))
    assert isinstance(case.test, MeasuredTest)
    table = read_measurement(case.test)
    return table, rsgen.identify(table, case.model), case


REPORTS: dict[str, Callable[[], Parts]] = {
    "sine": _sine, "joint": _joint, "multisine": _multisine, "measured": _measured,
}  # fmt: skip

PINS = {
    "all": Pin(lambda: {
        name: sorted(part.__all__)
        for name, part in {"rsgen": rsgen, "figures": rsgen.figures, "history": rsgen.history}.items()
    }),
    **{f"attributes/{kind.__name__}": Pin(partial(attributes, kind)) for kind in CLASSES},
    "surface.h5": Pin(lambda: surface_names(small("cubic"))),
    "surface.h5/across": Pin(lambda: surface_names(two_masses())),
    "surface.h5/labels": Pin(lambda: surface_names(changed(small("cubic"), label=small("cubic").level))),
    "spectra.npz": Pin(_spectra_names, slow=True),
    **{
        f"result.json/{kind}": Pin(
            partial(result_names, kind), slow=True, thorough=kind in ("joint", "measured"),
            data="nlbeam" if kind == "measured" else "",
        )
        for kind in REPORTS
    },
}  # fmt: skip
