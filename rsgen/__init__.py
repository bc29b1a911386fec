"""Identify nonlinear springs and dampers from the response surface of a vibration test.

The whole program::

    import rsgen as rs

    law     = rs.Law("k*x + k3*x**3 + c*v")                        # or rs.laws["cubic-spring"] + "c*v"
    surface = rs.ResponseSurface(level, frequency, force, response)   # or rs.simulate(...)
    found   = rs.identify(surface, law)                            # rs.Observation(...) says more of the test
    print(found, found["k3"].interval)
    ranking = rs.rank(surface, [law, *rs.laws])
    table   = rs.modal_table(surface)                          # omega(X), zeta(X), k(X), c(X): no law
    curves  = rs.predict(found, levels=[1, 3, 9])
    print(rs.compare_fits([found, rs.identify(surface, "k*x + c*v")]))
    rs.write_report("reports/joint", surface, found)

and with a case file, which holds test, law, and, of a virtual test, the truth::

    case           = rs.load_case("cases/cubic.toml")
    surface        = rs.simulate(case.oscillator, case.test)       # or rs.read(case)
    identification = rs.identify(surface, case.model)              # laws without values: truth cannot leak
    comparison     = rs.compare(identification, case.truth, case.accept)
    rs.write_report("reports/cubic", surface, identification, case=case, comparison=comparison)

Names are imported when they are first used, so that ``import rsgen`` and ``rsgen --help`` stay quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsgen import figures, history
    from rsgen.analysis.comparison import Comparison, compare, verdict_of
    from rsgen.analysis.fit_comparison import compare_fits
    from rsgen.cases.case import Case
    from rsgen.cases.loading import load_case, read
    from rsgen.common.errors import RsgenError
    from rsgen.common.finding import Finding
    from rsgen.data.multisine.linear import best_linear
    from rsgen.data.multisine.spectra import MultisineSpectra, load_spectra, save_spectra
    from rsgen.data.oscillator import Observation, Oscillator
    from rsgen.data.surface.response_surface import ResponseSurface, save_surface
    from rsgen.describing.derivation import derive
    from rsgen.dynamics.simulation import simulate
    from rsgen.dynamics.transients import DecayTest, SweepTest
    from rsgen.dynamics.virtual_test import MultisineTest, SimulatedTest
    from rsgen.files.surface_file import load_surface
    from rsgen.identification.identify import identify
    from rsgen.identification.modal_result import ModalTable
    from rsgen.identification.modal_table import modal_table
    from rsgen.identification.prediction import Prediction, predict
    from rsgen.identification.profile import Profile, profile
    from rsgen.identification.ranking import Ranking, rank
    from rsgen.identification.results import Identification
    from rsgen.law.element import Law, laws, make_element
    from rsgen.report import write_report
    from rsgen.report.sentences import explain, sentence

__version__: str
"""Of the installed package; it comes from the tag of the commit that was built."""

_NOT_INSTALLED = "0+unknown"
"""The version where the folder of the sources is used without being installed."""

_NAMES = {
    "analysis.comparison": ("Comparison", "compare", "verdict_of"),
    "analysis.fit_comparison": ("compare_fits",),
    "cases.case": ("Case",),
    "cases.loading": ("load_case", "read"),
    "common.errors": ("RsgenError",),
    "common.finding": ("Finding",),
    "data.multisine.linear": ("best_linear",),
    "data.multisine.spectra": ("MultisineSpectra", "load_spectra", "save_spectra"),
    "data.oscillator": ("Observation", "Oscillator"),
    "data.surface.response_surface": ("ResponseSurface", "save_surface"),
    "describing.derivation": ("derive",),
    "dynamics.simulation": ("simulate",),
    "dynamics.transients": ("DecayTest", "SweepTest"),
    "dynamics.virtual_test": ("MultisineTest", "SimulatedTest"),
    "files.surface_file": ("load_surface",),
    "identification.identify": ("identify",),
    "identification.modal_result": ("ModalTable",),
    "identification.modal_table": ("modal_table",),
    "identification.prediction": ("Prediction", "predict"),
    "identification.profile": ("Profile", "profile"),
    "identification.ranking": ("Ranking", "rank"),
    "identification.results": ("Identification",),
    "law.element": ("Law", "laws", "make_element"),
    "report": ("write_report",),
    "report.sentences": ("explain", "sentence"),
}
"""Names by the package or module that has them."""
_PLACES = {name: place for place, names in _NAMES.items() for name in names}
_PACKAGES = ("figures", "history")

__all__ = [
    "Case",
    "Comparison",
    "DecayTest",
    "Finding",
    "Identification",
    "Law",
    "ModalTable",
    "MultisineSpectra",
    "MultisineTest",
    "Observation",
    "Oscillator",
    "Prediction",
    "Profile",
    "Ranking",
    "ResponseSurface",
    "RsgenError",
    "SimulatedTest",
    "SweepTest",
    "best_linear",
    "compare",
    "compare_fits",
    "derive",
    "explain",
    "figures",
    "history",
    "identify",
    "laws",
    "load_case",
    "load_spectra",
    "load_surface",
    "make_element",
    "modal_table",
    "predict",
    "profile",
    "rank",
    "read",
    "save_spectra",
    "save_surface",
    "sentence",
    "simulate",
    "verdict_of",
    "write_report",
]


def _version() -> str:
    # 0.04 s, and most uses of rsgen never ask
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
