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
    from rsgen.analysis.comparison import Comparison, compare, verdict_of
    from rsgen.analysis.export import save_frf
    from rsgen.cases import Case, load_case, read
    from rsgen.common.errors import CaseError, ExpressionError, MeasurementError, RsgenError
    from rsgen.common.finding import Finding, Verdict
    from rsgen.data import history
    from rsgen.data.multisine import MultisineSpectra, best_linear
    from rsgen.data.observation import Observation
    from rsgen.data.oscillator import Model, Oscillator
    from rsgen.data.surface import ResponseSurface, load_surface, save_surface
    from rsgen.describing import DescribingFunction, derive
    from rsgen.dynamics.simulation import MultisineTest, SimulatedTest, simulate
    from rsgen.dynamics.steady_state import SteadyStates, solve_steady_states
    from rsgen.files import MeasuredTest, read_measurement
    from rsgen.identification.identify import identify
    from rsgen.identification.modal import ModalTable, modal_table
    from rsgen.identification.prediction import Prediction, predict
    from rsgen.identification.ranking import Ranking, rank
    from rsgen.identification.results import Identification
    from rsgen.law import Element, Law, laws, make_element
    from rsgen.report import figures, write_report
    from rsgen.report.stated_verdict import explain
    from rsgen.report.wording import sentence

__version__: str
"""Of the installed package; it comes from the tag of the commit that was built."""

_NOT_INSTALLED = "0+unknown"
"""The version where the folder of the sources is used without being installed."""

# name -> the package or module that has it
_PLACES = {
    "Case": "cases",
    "CaseError": "common.errors",
    "Comparison": "analysis.comparison",
    "DescribingFunction": "describing",
    "Element": "law",
    "ExpressionError": "common.errors",
    "Finding": "common.finding",
    "Identification": "identification.results",
    "Law": "law",
    "MeasuredTest": "files",
    "MeasurementError": "common.errors",
    "ModalTable": "identification.modal",
    "Model": "data.oscillator",
    "MultisineSpectra": "data.multisine",
    "MultisineTest": "dynamics.simulation",
    "Observation": "data.observation",
    "Oscillator": "data.oscillator",
    "Prediction": "identification.prediction",
    "Ranking": "identification.ranking",
    "ResponseSurface": "data.surface",
    "RsgenError": "common.errors",
    "SimulatedTest": "dynamics.simulation",
    "SteadyStates": "dynamics.steady_state",
    "Verdict": "common.finding",
    "best_linear": "data.multisine",
    "compare": "analysis.comparison",
    "derive": "describing",
    "explain": "report.stated_verdict",
    "identify": "identification.identify",
    "laws": "law",
    "load_case": "cases",
    "load_surface": "data.surface",
    "make_element": "law",
    "modal_table": "identification.modal",
    "predict": "identification.prediction",
    "rank": "identification.ranking",
    "read": "cases",
    "read_measurement": "files",
    "save_frf": "analysis.export",
    "save_surface": "data.surface",
    "sentence": "report.wording",
    "simulate": "dynamics.simulation",
    "solve_steady_states": "dynamics.steady_state",
    "verdict_of": "analysis.comparison",
    "write_report": "report",
}
_PACKAGES = {"figures": "rsgen.report.figures", "history": "rsgen.data.history"}

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
        return import_module(_PACKAGES[name])
    if name not in _PLACES:
        raise AttributeError(f"module 'rsgen' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(f"rsgen.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
