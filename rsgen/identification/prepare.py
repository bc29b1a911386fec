"""From a surface and a model to points that can be used, and what is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import Points, select_points
from rsgen.identification.fitting.problem import Problem
from rsgen.identification.fitting.repeats import Repeats, gather_repeats

__all__ = ["Prepared", "prepare"]


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A surface of means, the readings they are made of, its usable points, and what is fitted to them."""

    surface: ResponseSurface
    repeats: Repeats | None
    points: Points
    problem: Problem


def prepare(surface: ResponseSurface, model: Model) -> Prepared:
    """Join repeats, select the points that count, and compile the law along the motions that were measured.

    Raises
    ------
    RsgenError
        As for ``identify``; a background is asked for beside a motion across two sensors.
    """
    surface, repeats = gather_repeats(surface)
    points = select_points(surface, model)
    across = points.across is not None and bool(np.any(points.across[:, 0]))
    law = law_of(model.elements, across=points.across is not None, means=(0 in points.measured, across))
    if law.acts_across and model.observation.background not in ("none", "phase"):
        raise RsgenError(
            f"background: {model.observation.background!r} beside a motion across two sensors, in which "
            "other modes take part already; 'none' or 'phase' is needed"
        )
    if law.odd and points.asymmetric and not law.acts_across:
        # an odd law has motions that are not: in one well of two, or after the symmetry breaks
        law = replace(law, odd=False)
    observed = Observed.of(points, model.observation.background, phase_known=surface.phase_known)
    return Prepared(surface, repeats, points, Problem(model.elements, law, observed, model.mass))
