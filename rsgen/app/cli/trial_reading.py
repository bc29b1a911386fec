"""A proposed case is tried on its file, so that what it reads is seen before anything is identified."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rsgen.cases.measured_test import load_measured
from rsgen.common.errors import CaseError, RsgenError
from rsgen.common.finding import Finding
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.files import MeasuredTest, read_measurement
from rsgen.files.inspection import Contents, Proposal
from rsgen.files.inspection.corrections import with_base, with_control, with_quantity, with_sense
from rsgen.files.inspection.offset import has_levels, offset_findings
from rsgen.formula.units.quantities import UNKNOWN

__all__ = ["Trial", "try_proposal"]

_MOST_SAMPLES = 500_000
"""Longer histories are not tried: a run takes them apart in seconds to minutes, and a look may not."""
_PLACEHOLDERS = ("test.level.value", "test.level.values")
"""Values that a proposal asks for: until they are there no size means anything."""
_MANY = 8
"""Lines from which on a periodic force is no sine with harmonics."""
_Correction = Callable[[ResponseSurface, Proposal], Proposal | None]
_CONTRADICTIONS = {"base-misread", "base-scaled", "not-passive", "another-quantity", "phase-not-resonant"}
"""Findings that a correction must not bring in."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What a proposed case reads.

    Parameters
    ----------
    proposal
        With the sense of the phase turned where only so the structure takes energy from the exciter.
    surface
        None where nothing was tried or the file could not be read so; spectra of a multisine.
    findings
        About reading, sizes, and a part of the response that does not depend on the force.
    not_found
        What was looked for and is not there, in words.
    fault
        Why it could not be read; "" otherwise.
    """

    proposal: Proposal
    surface: ResponseSurface | MultisineSpectra | None = None
    findings: tuple[Finding, ...] = ()
    not_found: tuple[str, ...] = ()
    fault: str = ""


def try_proposal(contents: Contents, proposal: Proposal) -> Trial:
    """Read a file as a proposal says, and look at what comes out.

    Parameters
    ----------
    contents, proposal
        What the file holds, and the guess. Long histories are not tried; of those of unknown sampling rate
        only the excitation is recognised.
    """
    history = "excitation" in proposal.tables["test"]
    longest = max((entry.size for entry in contents.entries), default=0)
    unknown = UNKNOWN in str(proposal.tables.get("test.time", {}).get("rate", ""))
    if history and longest > _MOST_SAMPLES:
        return Trial(proposal)
    if history and unknown:
        return Trial(_excitation_in_samples(contents.file, proposal))
    try:
        if history:
            return _try_history(contents.file, proposal)
        surface = _read(contents.file, proposal)
        proposal, surface = _improved(contents.file, proposal, surface)
    except RsgenError as fault:
        return Trial(proposal, fault=_said(fault))
    return _judged(proposal, surface)


def _said(fault: RsgenError) -> str:
    faults = fault.faults if isinstance(fault, CaseError) else (str(fault),)
    return " ".join(faults[0].split())


def _judged(proposal: Proposal, surface: ResponseSurface | MultisineSpectra) -> Trial:
    """Look for what no test has, and for an offset."""
    if isinstance(surface, MultisineSpectra):
        return Trial(proposal, surface, surface.findings)
    looked_for: dict[str, tuple[Finding, ...]] = {}
    decay = proposal.tables["test"].get("excitation") == "ring-down"
    # of a decay forces are those of the mass, which only the user knows
    if not decay and not set(_PLACEHOLDERS) & set(proposal.doubts):
        looked_for["sizes that no test has"] = tuple(plausibility_findings(surface))
        if has_levels(surface):
            found = tuple(offset_findings(surface))
            looked_for["a part of the response that does not depend on the force"] = found
    findings = (*surface.findings, *(f for found in looked_for.values() for f in found))
    return Trial(proposal, surface, findings, tuple(what for what, found in looked_for.items() if not found))


_CHOICES = "swept-sine, stepped-sine, multisine or ring-down"
_SEEN = {
    "swept-sine": "the frequency of the force moves; else",
    "stepped-sine": "the frequency of the force moves in steps; else",
    "multisine": "the force repeats and has many lines; else",
    "ring-down": "the force is a blow, or ends; else",
}
"""What the values of the force show."""


def _try_history(file: Path, proposal: Proposal) -> Trial:
    """Recognise the excitation of records by their values, and read them so."""
    # a look at a table needs nothing of what takes histories apart
    from rsgen.files.histories import read_histories
    from rsgen.files.inspection.excitation import dies_away, excitation_of

    histories = read_histories(_test(file, proposal))
    driven = "test.force" in proposal.tables or "test.base" in proposal.tables
    if not driven and not all(dies_away(history.response) for history in histories):
        doubt = "no force was found, and the response does not die away: name the force, or the base"
        return Trial(replace(proposal, doubts=proposal.doubts | {"test.excitation": doubt}))
    guessed = _excited(proposal, {excitation_of(history) for history in histories} if driven else set())
    try:
        surface = _read(file, guessed)
        few = isinstance(surface, MultisineSpectra) and surface.excited().sum(axis=1).min() < _MANY
        guessed, surface = _improved(file, guessed, surface, (with_base, with_quantity))
    except RsgenError as fault:
        return Trial(guessed, fault=_said(fault))
    return _judged(guessed, surface) if not few else _judged(proposal, _read(file, proposal))


def _excitation_in_samples(file: Path, proposal: Proposal) -> Proposal:
    """Recognise the excitation of records whose sampling rate nobody knows: in samples it shows as well."""
    from rsgen.files.histories import read_histories
    from rsgen.files.inspection.excitation import excitation_of

    if "test.force" not in proposal.tables:
        return proposal
    time = proposal.tables["test.time"] | {"rate": "1 Hz"}
    try:
        histories = read_histories(
            _test(file, replace(proposal, tables=proposal.tables | {"test.time": time}))
        )
    except RsgenError:
        # what else is wrong is said when the rate is known
        return proposal
    return _excited(proposal, {excitation_of(history) for history in histories})


def _excited(proposal: Proposal, kinds: set[str]) -> Proposal:
    """Propose the excitation that all records show, if they show one."""
    kind = next(iter(kinds)) if len(kinds) == 1 else ""
    if not kind:
        return proposal
    others = ", ".join(other for other in _CHOICES.replace(" or", ",").split(", ") if other != kind)
    test = proposal.tables["test"] | {"excitation": kind}
    doubts = proposal.doubts | {"test.excitation": f"{_SEEN[kind]} {others}"}
    return replace(proposal, tables=proposal.tables | {"test": test}, doubts=doubts)


def _improved(
    file: Path,
    proposal: Proposal,
    surface: ResponseSurface | MultisineSpectra,
    corrections: tuple[_Correction, ...] = (with_sense, with_base, with_quantity, with_control),
) -> tuple[Proposal, ResponseSurface | MultisineSpectra]:
    """Correct what the values contradict, and say what was held."""
    before = {finding.code for finding in surface.findings}
    for correct in corrections:
        # of a relative response in the other sense the reference shows once the sense is right
        steps = (correct, with_base) if correct is with_sense else (correct,)
        other, read = proposal, surface
        for step in steps:
            changed = step(read, other) if isinstance(read, ResponseSurface) else None
            if changed is None:
                continue
            try:
                other, read = changed, _read(file, changed)
            except RsgenError:
                break
            if not _CONTRADICTIONS & {finding.code for finding in read.findings} - before:
                proposal, surface = other, read
                break
    return proposal, surface


def _read(file: Path, proposal: Proposal) -> ResponseSurface | MultisineSpectra:
    return read_measurement(_test(file, proposal))


def _test(file: Path, proposal: Proposal) -> MeasuredTest:
    from rsgen.app.cli.inspect_command import proposal_text  # it shows what is tried here

    tables = proposal.tables | {"test": proposal.tables["test"] | {"file": file.name}}
    # any force shows whether the file can be read
    text = proposal_text(Proposal(tables)).replace(f'"{UNKNOWN} N"', '"1 N"')
    # a decay is one of any mass
    mass = 1.0 if proposal.tables["test"].get("excitation") == "ring-down" else None
    return load_measured(text, file.parent, mass)
