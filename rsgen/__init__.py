"""Identify nonlinear springs and dampers from the response surface of a vibration test.

The whole program::

    import rsgen as rs

    law     = rs.Law("k*x + k3*x**3 + c*v")                        # or rs.laws["cubic-spring"] + "c*v"
    surface = rs.ResponseSurface(level, frequency, force, response)   # or .from_frame(df), rs.simulate(...)
    found   = rs.identify(surface, law)                            # rs.Observation(...) says more of the test
    print(found, found["k3"].interval)
    ranking = rs.rank(surface, [law, *rs.laws])
    table   = rs.modal_table(surface)                          # omega(X), zeta(X), k(X), c(X): no law
    curves  = rs.predict(found, levels=[1, 3, 9])
    rs.write_report("reports/joint", surface, found)

and with a case file, which holds test, law, and, of a virtual test, the truth::

    case           = rs.load_case("cases/cubic.toml")
    surface        = rs.simulate(case.oscillator, case.test)       # or rs.read_measurement(case.test)
    identification = rs.identify(surface, case.model)              # laws without values: truth cannot leak
    comparison     = rs.compare(identification, case.truth, case.accept)
    rs.write_report("reports/cubic", case, surface, identification, comparison)

Names are imported when they are first used, so that ``import rsgen`` and ``rsgen --help`` stay quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsgen import figures, history
    from rsgen.case import Case, load_case, read
    from rsgen.comparison import Comparison, compare, verdict_of
    from rsgen.describing import DescribingFunction, derive
    from rsgen.errors import CaseError, ExpressionError, MeasurementError, RsgenError
    from rsgen.export import save_frf
    from rsgen.finding import Finding
    from rsgen.identification import identify
    from rsgen.law import Element, Law, laws, make_element
    from rsgen.measurement import MeasuredTest, read_measurement
    from rsgen.modal import ModalTable, modal_table
    from rsgen.multisine import MultisineSpectra, best_linear
    from rsgen.observation import Observation
    from rsgen.oscillator import Model, Oscillator
    from rsgen.prediction import Prediction, predict
    from rsgen.ranking import Ranking, rank
    from rsgen.report import write_report
    from rsgen.report.stated_verdict import explain
    from rsgen.report.wording import sentence
    from rsgen.results import Identification
    from rsgen.simulation import MultisineTest, SimulatedTest, simulate
    from rsgen.steady_state import SteadyStates, solve_steady_states
    from rsgen.surface import ResponseSurface, load_surface, save_surface
    from rsgen.verdict import Verdict

__version__: str
"""Of the installed package; it comes from the tag of the commit that was built."""

_NOT_INSTALLED = "0+unknown"
"""The version where the folder of the sources is used without being installed."""

# name -> the package or module that has it
_PLACES = {
    "Case": "case",
    "CaseError": "errors",
    "Comparison": "comparison",
    "DescribingFunction": "describing",
    "Element": "law",
    "ExpressionError": "errors",
    "Finding": "finding",
    "Identification": "results",
    "Law": "law",
    "MeasuredTest": "measurement",
    "MeasurementError": "errors",
    "ModalTable": "modal",
    "Model": "oscillator",
    "MultisineSpectra": "multisine",
    "MultisineTest": "simulation",
    "Observation": "observation",
    "Oscillator": "oscillator",
    "Prediction": "prediction",
    "Ranking": "ranking",
    "ResponseSurface": "surface",
    "RsgenError": "errors",
    "SimulatedTest": "simulation",
    "SteadyStates": "steady_state",
    "Verdict": "verdict",
    "best_linear": "multisine",
    "compare": "comparison",
    "derive": "describing",
    "explain": "report.stated_verdict",
    "identify": "identification",
    "laws": "law",
    "load_case": "case",
    "load_surface": "surface",
    "make_element": "law",
    "modal_table": "modal",
    "predict": "prediction",
    "rank": "ranking",
    "read": "case",
    "read_measurement": "measurement",
    "save_frf": "export",
    "save_surface": "surface",
    "sentence": "report.wording",
    "simulate": "simulation",
    "solve_steady_states": "steady_state",
    "verdict_of": "comparison",
    "write_report": "report",
}
_PACKAGES = ("figures", "history")

__all__ = [
    "Case",
    "CaseError",
    "Comparison",
    "DescribingFunction",
    "Element",
    "ExpressionError",
    "Finding",
    "Identification",
    "Law",
    "MeasuredTest",
    "MeasurementError",
    "ModalTable",
    "Model",
    "MultisineSpectra",
    "MultisineTest",
    "Observation",
    "Oscillator",
    "Prediction",
    "Ranking",
    "ResponseSurface",
    "RsgenError",
    "SimulatedTest",
    "SteadyStates",
    "Verdict",
    "best_linear",
    "compare",
    "derive",
    "explain",
    "figures",
    "history",
    "identify",
    "laws",
    "load_case",
    "load_surface",
    "make_element",
    "modal_table",
    "predict",
    "rank",
    "read",
    "read_measurement",
    "save_frf",
    "save_surface",
    "sentence",
    "simulate",
    "solve_steady_states",
    "verdict_of",
    "write_report",
]


def _version() -> str:
    # imported here, for most uses of rsgen never ask
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("rsgen")
    except PackageNotFoundError:
        return _NOT_INSTALLED


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return globals().setdefault(name, _version())
    if name in _PACKAGES:
        return import_module(f"rsgen.{name}")
    if name not in _PLACES:
        raise AttributeError(f"module 'rsgen' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(f"rsgen.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
