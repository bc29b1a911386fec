"""What the values that a case reads say against it: the sense of phases, the quantity, what was held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.columns import QUANTITIES
from rsgen.data.surface.phase_lag import at_phase_resonance
from rsgen.files.inspection.clues import OVER_FORCE
from rsgen.files.inspection.proposal import Proposal

__all__ = ["with_base", "with_control", "with_quantity", "with_sense"]

_MOTIONS = ("test.response", "test.channels.")
_FORCE_HELD = 'or "force"'
_FEW_ROWS, _MANY_ROWS = 4, 60
"""Rows of a table of resonances, one a level: fewer show nothing, and sweeps have more."""
_OWN = 0.01
"""Forces of two levels differ by more than this; a controller holds one force as well as that."""
_RANGE = 1.5
"""Largest over smallest force of a test with several levels: shakers lose less than that at a resonance."""


def with_sense(surface: ResponseSurface, proposal: Proposal) -> Proposal | None:
    """Turn the sense of all phases where only so the structure is passive; None where it is right."""
    wrong = [f for f in surface.findings if f.code == "not-passive" and f.names["reversed"] == "phase"]
    turned = {name: table for name, table in proposal.tables.items() if "phase_sense" in table}
    if not wrong or not turned:
        return None
    sense = {"phase_sense": wrong[0].names["phase_sense"]}
    # one device writes all phases in one sense
    return _changed(proposal, list(turned), sense, "the other sense would feed energy into the exciter")


def with_base(surface: ResponseSurface, proposal: Proposal) -> Proposal | None:
    """Read a driven base in the sense or against the reference in which it moves a structure; None if so."""
    found = [f.names["is"] for f in surface.findings if f.code == "base-misread"]
    mistake = found[0] if found else ""
    if mistake == "reference":
        old = proposal.tables["test.base"]["response"]
        new = {"response": "relative" if old == "absolute" else "absolute"}
        return _changed(proposal, ["test.base"], new, f"read as {old}, no structure moves so")
    if not mistake.startswith("sense"):
        return None
    of = {"sense-base": ("test.base",), "sense-response": _MOTIONS}.get(mistake, ("test.",))
    turned = [
        name for name, table in proposal.tables.items() if "phase_sense" in table and name.startswith(of)
    ]
    senses = {proposal.tables[name]["phase_sense"] for name in turned}
    if len(senses) != 1:
        return None
    sense = {"phase_sense": "lag" if "lead" in senses else "lead"}
    return _changed(proposal, turned, sense, "in the other sense no structure moves so")


def with_quantity(surface: ResponseSurface, proposal: Proposal) -> Proposal | None:
    """Take the quantity that the phases show, where the file names no unit; None where it does."""
    shown = [
        f.names["is"] for f in surface.findings if f.code == "another-quantity" and f.names["sure"] == "yes"
    ]
    if not shown:
        return None
    if shown[0] == "radian":
        named = [name for name, table in proposal.tables.items() if "phase" in table]
        return _changed(proposal, named, {"phase_unit": "rad"}, "in degrees no law fits")
    places = [
        name
        for name, table in proposal.tables.items()
        if "quantity" in table
        and not name.endswith("base")
        and "not in the file" in proposal.doubts.get(f"{name}.unit", "")
    ]
    if not places:
        return None
    per = {name: "/N" if "per_force" in proposal.tables[name] else "" for name in places}
    doubts = {key: doubt for key, doubt in proposal.doubts.items() if not key.endswith(".quantity")}
    what = OVER_FORCE[shown[0]] if any(per.values()) else shown[0]
    why = f"{what} by its phase; no name or unit says so"
    found = _changed(replace(proposal, doubts=doubts), places, {"quantity": shown[0]}, why)
    units = {name: found.tables[name] | {"unit": f"{QUANTITIES[shown[0]]}{per[name]}"} for name in places}
    return replace(found, tables=found.tables | units)


def with_control(surface: ResponseSurface, proposal: Proposal) -> Proposal | None:
    """Write what was held where it is not the force: the phase of resonance, the response, a branch."""
    test = proposal.tables["test"]
    if "control" in test:
        return None
    held, why = surface.control, f"recognised by its values; {_FORCE_HELD}"
    if held == "force" and not surface.per_mass:
        if surface.phase_known and at_phase_resonance(surface.force / surface.harmonics[:, 1]):
            held = "phase"
        elif not surface.phase_known and _is_backbone(surface):
            held, why = (
                "phase",
                f"no phase, but every row has a force of its own and the motion follows; {_FORCE_HELD}",
            )
    if held == "force":
        return None
    tables = proposal.tables | {"test": test | {"control": held}}
    return replace(proposal, tables=tables, doubts=proposal.doubts | {"test.control": why})


def _is_backbone(surface: ResponseSurface) -> bool:
    """Whether each row of a test without phases has a force of its own, and the motion grows with it.

    In a sweep the force stays where it is, or falls where the motion is large.
    """
    force, amplitude = np.abs(surface.force), surface.amplitude
    order = np.argsort(force)
    rises = np.diff(force[order]) > _OWN * force[order][1:]
    return (
        _FEW_ROWS <= len(force) <= _MANY_ROWS
        and bool(rises.all())
        and bool(force.max() > _RANGE * force.min())
        and bool(np.all(np.diff(amplitude[order]) > 0))
    )


def _changed(proposal: Proposal, places: list[str], keys: dict[str, str], why: str) -> Proposal:
    """Change keys in tables of a proposal, and say why."""
    tables = proposal.tables | {name: proposal.tables[name] | keys for name in places}
    doubts = dict(proposal.doubts)
    for name in places:
        for key in keys:
            said = doubts.get(f"{name}.{key}")
            doubts[f"{name}.{key}"] = f"{said}; {why}" if said else why
    return replace(proposal, tables=tables, doubts=doubts)
