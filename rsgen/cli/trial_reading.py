"""A proposed case is tried on its file, so that what it reads is seen before anything is identified."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

from rsgen.case import load_case
from rsgen.errors import CaseError, RsgenError
from rsgen.finding import Finding
from rsgen.inspection import Contents, Proposal
from rsgen.inspection.offset import has_levels, offset_findings
from rsgen.measurement import MeasuredTest, read_measurement
from rsgen.multisine import MultisineSpectra
from rsgen.surface import ResponseSurface
from rsgen.surface.plausibility import plausibility_findings
from rsgen.units.quantities import UNKNOWN

__all__ = ["Trial", "try_proposal"]

_MOST_SAMPLES = 500_000
"""Longer histories are not tried: a run takes them apart in seconds to minutes, and a look may not."""
_PLACEHOLDERS = ("test.level.value", "test.level.values")
"""Values that a proposal asks for: until they are there no size means anything."""
_MANY = 8
"""Lines from which on a periodic force is no sine with harmonics."""
_CASE = "trial.toml"


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
        What the file holds, and the guess. Free decays, which need a mass, long
        histories and those of unknown sampling rate are not tried.
    """
    test = proposal.tables["test"]
    longest = max((entry.size for entry in contents.entries), default=0)
    unknown_rate = "test.time.rate" in proposal.doubts
    long = "excitation" in test and longest > _MOST_SAMPLES
    if test.get("excitation") == "ring-down" or long or unknown_rate:
        return Trial(proposal)
    try:
        surface = _read(contents.file, proposal)
        turned = _turned(surface, proposal)
        if turned is not None:
            proposal, surface = turned, _read(contents.file, turned)
    except RsgenError as fault:
        if "excitation" in test and (other := _as_multisine(contents.file, proposal)) is not None:
            return other
        faults = fault.faults if isinstance(fault, CaseError) else (str(fault),)
        # the case is nobody's file: its name says nothing
        return Trial(proposal, fault=" ".join(faults[0].removeprefix(f"{_CASE}: ").split()))
    if isinstance(surface, MultisineSpectra):
        return Trial(proposal, surface, surface.findings)
    looked_for: dict[str, tuple[Finding, ...]] = {}
    if not set(_PLACEHOLDERS) & set(proposal.doubts):
        looked_for["sizes that no test has"] = tuple(plausibility_findings(surface))
        if has_levels(surface):
            found = tuple(offset_findings(surface))
            looked_for["a part of the response that does not depend on the force"] = found
    findings = (*surface.findings, *(f for found in looked_for.values() for f in found))
    return Trial(proposal, surface, findings, tuple(what for what, found in looked_for.items() if not found))


def _as_multisine(file: Path, proposal: Proposal) -> Trial | None:
    """Read a history as a multisine instead; None where its force does not repeat or has a few lines only."""
    tables = {name: dict(table) for name, table in proposal.tables.items() if name != "test.demodulation"}
    tables["test"]["excitation"] = "multisine"
    doubts = proposal.doubts | {"test.excitation": "the force repeats and has many lines"}
    multisine = replace(proposal, tables=tables, doubts=doubts)
    try:
        spectra = _read(file, multisine)
    except RsgenError:
        return None
    if not isinstance(spectra, MultisineSpectra) or spectra.excited().sum(axis=1).min() < _MANY:
        return None
    return Trial(multisine, spectra, spectra.findings)


def _read(file: Path, proposal: Proposal) -> ResponseSurface | MultisineSpectra:
    # both write a proposal as text
    from rsgen.cli.init_command import case_text
    from rsgen.cli.inspect_command import proposal_text

    tables = proposal.tables | {"test": proposal.tables["test"] | {"file": file.name}}
    # any force shows whether the file can be read
    text = proposal_text(Proposal(tables)).replace(f'"{UNKNOWN} N"', '"1 N"')
    with TemporaryDirectory(prefix="rsgen-") as folder:
        case = Path(folder, _CASE)
        case.write_text(case_text("trial", "k*x + c*v", "data", text), encoding="utf-8")
        return read_measurement(cast("MeasuredTest", load_case(case, file.parent).test))


def _turned(surface: ResponseSurface | MultisineSpectra, proposal: Proposal) -> Proposal | None:
    """Turn the sense of all phases where only so the structure is passive; None where it is right."""
    wrong = [f for f in surface.findings if f.code == "not-passive" and f.names["reversed"] == "phase"]
    turned = {name: table for name, table in proposal.tables.items() if "phase_sense" in table}
    if not wrong or not turned:
        return None
    sense = wrong[0].names["phase_sense"]
    # one device writes all phases in one sense
    tables = proposal.tables | {name: table | {"phase_sense": sense} for name, table in turned.items()}
    doubts = dict(proposal.doubts)
    for name in turned:
        key = f"{name}.phase_sense"
        said = f"{doubts[key]}; " if key in doubts else ""
        doubts[key] = f"{said}the other sense would feed energy into the exciter"
    return replace(proposal, tables=tables, doubts=doubts)
