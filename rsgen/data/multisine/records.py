"""Which records of a multisine test an identification may use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import RsgenError
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.observation import Observation
from rsgen.data.oscillator import Model

__all__ = ["check_records", "held_out_records", "refuse_across"]


def refuse_across(model: Model) -> None:
    """Refuse a law that acts across two sensors: the spectra have the motion of one.

    Raises
    ------
    RsgenError
        An element says so.
    """
    names = ", ".join(element.name for element in model.elements if element.across)
    if names:
        raise RsgenError(
            f"element: {names}: acts across two sensors, but a multisine is identified with the motion of "
            "one; make the response that difference, or measure stepped or swept sines"
        )


def check_records(spectra: MultisineSpectra, observation: Observation) -> NDArray[np.bool_]:
    """(r,) records that are held out.

    Raises
    ------
    RsgenError
        A held-out level was not tested, none remains, a background is asked for, or nothing moved.
    """
    if observation.background != "none":
        raise RsgenError(
            f"identify.background: {observation.background!r}; a multisine test is identified without a "
            "background: leave it out, and take a band around the mode"
        )
    silent = np.flatnonzero(spectra.rms_response() == 0)
    if len(silent):
        raise RsgenError(
            f"record {silent[0] + 1} of {len(spectra)}: the response is zero; a motion is needed"
        )
    held = held_out_records(spectra, observation.hold_out)
    if held.all():
        raise RsgenError("identify.hold_out: holds every level back; at least one must remain")
    return held


def held_out_records(spectra: MultisineSpectra, levels: tuple[float, ...]) -> NDArray[np.bool_]:
    """(r,) records of the held-out levels, by their labels or amounts [N].

    Raises
    ------
    RsgenError
        A level was not tested.
    """
    held = np.zeros(len(spectra), dtype=bool)
    for level in levels:
        labelled = spectra.label is not None and np.isin(level, spectra.label)
        rows = np.flatnonzero(spectra.label == level) if labelled else spectra.at_level(level)
        if not len(rows):
            known = ", ".join(f"{one:.4g}" for one in spectra.levels)
            raise RsgenError(f"identify.hold_out: {level:g} N is not tested; tested are {known} N")
        held[rows] = True
    return held
