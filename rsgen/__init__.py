"""Identify nonlinear springs and dampers from the response surface of a vibration test.

The whole program in five lines::

    case           = rsgen.load_case("cases/cubic.toml")
    surface        = rsgen.simulate(case.oscillator, case.test)      # or rsgen.read_measurement(case.test)
    identification = rsgen.identify(surface, case.model)             # laws without values: truth cannot leak
    comparison     = rsgen.compare(identification, case.truth, case.accept)
    rsgen.write_report("reports/cubic", case, surface, identification, comparison)

Names are imported when they are first used, so that ``import rsgen`` and ``rsgen --help`` stay quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsgen import figures
    from rsgen.case import Case, load_case
    from rsgen.comparison import Comparison, compare
    from rsgen.describing import DescribingFunction, derive
    from rsgen.errors import CaseError, ExpressionError, MeasurementError, RsgenError
    from rsgen.identification import Identification, identify
    from rsgen.law import Element, Law, laws, make_element
    from rsgen.measurement import MeasuredTest, read_measurement
    from rsgen.oscillator import Model, Oscillator
    from rsgen.prediction import Prediction, predict
    from rsgen.ranking import rank
    from rsgen.report import write_report
    from rsgen.simulation import SimulatedTest, simulate
    from rsgen.steady_state import SteadyStates, solve_steady_states
    from rsgen.surface import ResponseSurface, load_surface, save_surface

__version__ = "0.1.0"

# name -> the package or module that has it; a module itself where the two are equal
_PACKAGES = {
    "Case": "case",
    "CaseError": "errors",
    "Comparison": "comparison",
    "DescribingFunction": "describing",
    "Element": "law",
    "ExpressionError": "errors",
    "Identification": "identification",
    "Law": "law",
    "MeasuredTest": "measurement",
    "MeasurementError": "errors",
    "Model": "oscillator",
    "Oscillator": "oscillator",
    "Prediction": "prediction",
    "ResponseSurface": "surface",
    "RsgenError": "errors",
    "SimulatedTest": "simulation",
    "SteadyStates": "steady_state",
    "compare": "comparison",
    "derive": "describing",
    "figures": "figures",
    "identify": "identification",
    "laws": "law",
    "load_case": "case",
    "load_surface": "surface",
    "make_element": "law",
    "predict": "prediction",
    "rank": "ranking",
    "read_measurement": "measurement",
    "save_surface": "surface",
    "simulate": "simulation",
    "solve_steady_states": "steady_state",
    "write_report": "report",
}

__all__ = [
    "Case",
    "CaseError",
    "Comparison",
    "DescribingFunction",
    "Element",
    "ExpressionError",
    "Identification",
    "Law",
    "MeasuredTest",
    "MeasurementError",
    "Model",
    "Oscillator",
    "Prediction",
    "ResponseSurface",
    "RsgenError",
    "SimulatedTest",
    "SteadyStates",
    "compare",
    "derive",
    "figures",
    "identify",
    "laws",
    "load_case",
    "load_surface",
    "make_element",
    "predict",
    "rank",
    "read_measurement",
    "save_surface",
    "simulate",
    "solve_steady_states",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _PACKAGES:
        raise AttributeError(f"module 'rsgen' has no attribute {name!r}")
    module = import_module(f"rsgen.{_PACKAGES[name]}")
    value = module if name == "figures" else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_PACKAGES])
