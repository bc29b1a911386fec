"""The flow of an identification: prepare, start, fit, judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rsgen.common.errors import require
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.observation import Observation
from rsgen.data.oscillator import Model, join_model
from rsgen.data.surface import ResponseSurface, without_copies
from rsgen.identification.all_harmonics import fit_all_harmonics
from rsgen.identification.fitting.points import per_unit_mass
from rsgen.identification.judge import judge
from rsgen.identification.lines.identify_multisine import identify_multisine
from rsgen.identification.mass_ratios import identify_ratios
from rsgen.identification.prediction import judge_held_out
from rsgen.identification.prepare import prepare
from rsgen.identification.results import Identification
from rsgen.identification.starting.start import start_fit
from rsgen.law import LawLike

__all__ = ["identify"]


def identify(
    surface: ResponseSurface | MultisineSpectra,
    law: Model | LawLike | Sequence[LawLike],
    observation: Observation | None = None,
    *,
    mass: float | None = None,
) -> Identification:
    """Identify every parameter of a law, and the mass where it is not given.

    Parameters
    ----------
    surface
        Settled points of any test; unsettled and held-out ones are left aside. Spectra of a multisine give a
        ``MultisineIdentification``.
    law
        Without values: a formula, an element, a law, a sequence of these, or a model.
    observation
        How the structure was observed; None: as the model says.
    mass
        m [kg] where it is known; None: as the model says, and to be identified where that says nothing. Of
        a driven base, whose force is one per mass, parameters without it are per unit mass.

    Returns
    -------
    Identification
        A parameter that is not identifiable is NaN with a finding, never an exception.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, or fewer than four points can be used.
    """
    model = join_model(law, observation, mass)
    if isinstance(surface, MultisineSpectra):
        return _with_held_out(identify_multisine(surface, model), surface)
    require(surface, ResponseSurface, "surface")
    surface, model = per_unit_mass(without_copies(surface), model)
    return _with_held_out(identify_ratios(surface, model, _identify) or _identify(surface, model), surface)


def _with_held_out(found: Identification, surface: ResponseSurface | MultisineSpectra) -> Identification:
    """An identification with what the levels that it has not seen say of it: they are part of its verdict."""
    with np.errstate(all="ignore"):
        return replace(found, findings=(*found.findings, *judge_held_out(found, surface)))


def _identify(surface: ResponseSurface, model: Model) -> Identification:
    test = prepare(surface, model)
    # what a trial makes infinite or undefined has no prediction there, and is dealt with as such
    with np.errstate(all="ignore"):
        problem, start = start_fit(test.problem)
        test = replace(test, problem=problem)
        found = fit_all_harmonics(problem, start)
        return judge(test, model, found)
