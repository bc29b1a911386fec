"""What identification and ranking would refuse of a test, found before the run."""

from __future__ import annotations

import numpy as np

from rsgen.cases import Case
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.multisine.spectra import check_records, refuse_across
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.simulation import MultisineTest, SimulatedTest
from rsgen.identification.fitting.points import Points, at_resonance_alone, select_points
from rsgen.identification.fitting.repeats import gather_repeats
from rsgen.identification.identify import identify
from rsgen.identification.ranking import identify_best
from rsgen.identification.results import Identification
from rsgen.law.numeric import compile_law

__all__ = ["identify_case", "mass_findings", "point_faults", "refuse_ranking"]


def mass_findings(case: Case, surface: ResponseSurface) -> tuple[Finding, ...]:
    """Say that a measured test, of a mass that is not given, determines none; nothing where it does."""
    if case.model.mass is not None or surface.per_mass or not surface.phase_known:
        return ()
    points = select_points(gather_repeats(surface)[0], case.model)
    # a law with memory has its stiffness in the area of its loops
    if not at_resonance_alone(points) or (not case.ranked and compile_law(case.model.force).remembers):
        return ()
    return (Finding("mass-at-resonance", "warning", "m", quantities(points=len(points))),)


def point_faults(case: Case, surface: ResponseSurface | MultisineSpectra | None = None) -> list[str]:
    """Say why identification or ranking could not use the points of a test; nothing where they can.

    Parameters
    ----------
    case
        As it was read.
    surface
        Of a measured case; of a virtual test all points count as settled, for none is simulated.

    Returns
    -------
    list of str
        One sentence a fault, ``file: place: what; what is allowed``.
    """
    if surface is None and isinstance(case.test, MultisineTest):
        surface = _planned_records(case.test)
    elif surface is None and isinstance(case.test, SimulatedTest):
        surface = _planned(case.test)
    if surface is None:
        return []
    if isinstance(surface, MultisineSpectra):
        return _line_faults(case, surface)
    try:
        points = select_points(gather_repeats(surface)[0], case.model)
    except RsgenError as fault:
        return [f"{case.path.name}: {' '.join(str(fault).split())}"]
    return [f"{case.path.name}: model: {text}" for text in _rank_faults(case, surface, points)]


def refuse_ranking(case: Case) -> None:
    """Refuse a ranking on a multisine.

    Raises
    ------
    RsgenError
        The case asks for one.
    """
    if case.ranked:
        raise RsgenError(
            f"{case.path.name}: model: 'rank' compares laws on a response surface; of a multisine identify "
            "one law after the other, and compare their misfits"
        )


def _unranked(case: Case) -> list[str]:
    """Refuse a ranking on a multisine."""
    try:
        refuse_ranking(case)
    except RsgenError as fault:
        return [str(fault)]
    return []


def _line_faults(case: Case, spectra: MultisineSpectra) -> list[str]:
    """What identification would refuse of records of a multisine."""
    place, observation = case.path.name, case.observation
    faults = _unranked(case)
    try:
        refuse_across(case.model)
        check_records(spectra, observation)
    except RsgenError as fault:
        faults.append(f"{place}: {fault}")
    return faults


def _planned(test: SimulatedTest) -> ResponseSurface:
    """The grid of a virtual test, as if every point had settled with the same response."""
    # a phase-locked loop finds its frequency: any in the band stands for it
    frequencies = np.resize(test.frequency, test.per_level)
    level, frequency = np.meshgrid(test.level, frequencies, indexing="ij")
    return ResponseSurface(
        level.ravel(),
        frequency.ravel(),
        1.0,
        np.ones(level.size, complex),
        sweep="rest",
        control=test.control,
        base=test.base or "",
    )


def _planned_records(test: MultisineTest) -> MultisineSpectra:
    """A record of each level of a virtual multisine, with a response."""
    lines = np.ones((len(test.level), 1, 2), complex)
    return MultisineSpectra(test.level, 2 * np.pi / test.period, lines, lines)


def _rank_faults(case: Case, surface: ResponseSurface, points: Points) -> list[str]:
    if not case.ranked:
        return []
    faults = []
    if not surface.phase_known:
        faults.append("'rank' compares laws by force and phase; a phase, or the law itself, is needed")
    if case.model.mass is None and np.ptp(points.omega) == 0:
        faults.append("'rank' needs the mass, or tests at more than one frequency")
    elif not isinstance(case.test, SimulatedTest) and mass_findings(case, surface):
        faults.append("'rank' needs the mass, or points off phase resonance")
    return faults


# ----------------------------------------------------------------------------
# The identification that a case asks for: of its own law, or of the best one of a ranking.


def identify_case(case: Case, table: ResponseSurface | MultisineSpectra) -> Identification:
    """Identify the law of a case, or rank laws and identify the best.

    Raises
    ------
    RsgenError
        As ``identify`` and ``rank``; or laws are to be ranked on a multisine.
    """
    if isinstance(table, MultisineSpectra):
        refuse_ranking(case)
    if isinstance(table, MultisineSpectra) or not case.ranked:
        return identify(table, case.model)
    return identify_best(table, case.model)
