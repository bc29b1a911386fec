"""The command `rsgen inspect`: the tree of a data file, and the [test] table of a case that would read it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from rsgen.app.cli.options import Json
from rsgen.app.cli.terminal import print_faults, print_json, print_line
from rsgen.cases.measured_test import load_measured
from rsgen.common.errors import CaseError, RsgenError
from rsgen.common.finding import Finding
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.files import MeasuredTest, read_measurement
from rsgen.files.histories import read_histories
from rsgen.files.inspection import Contents, Entry, Proposal, list_contents, propose
from rsgen.files.inspection.corrections import (
    dies_away,
    excitation_of,
    has_levels,
    offset_findings,
    with_base,
    with_control,
    with_quantity,
    with_sense,
)
from rsgen.files.sandbox import reading_fault
from rsgen.files.tree import TEXT
from rsgen.formula.units.quantities import UNKNOWN
from rsgen.report.wording import next_step, sentence

__all__ = ["Trial", "inspect_command", "proposal_text", "trial_lines", "try_proposal"]


MOST = 60
"""Arrays shown in a table; --all and --json list all."""
_UNITS_OF_DOUBT = 60


def _text(value: str) -> str:
    """Write a text as a TOML string; a file's names may hold any sign."""
    # half a surrogate pair is no Unicode, and a file may hold it
    legal = "".join("\ufffd" if 0xD800 <= ord(sign) <= 0xDFFF else sign for sign in value)
    escaped = legal.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(s if s.isprintable() else f"\\U{ord(s):08x}" for s in escaped) + '"'


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return _text(value) if isinstance(value, str) else str(value)


def proposal_text(proposal: Proposal) -> str:
    """Write a proposal as TOML, with a comment where the user must look."""
    lines: list[str] = []
    for name, table in proposal.tables.items():
        lines.append(f"[{name}]")
        width = max((len(key) for key in table), default=0)
        for key, value in table.items():
            doubt = proposal.doubts.get(f"{name}.{key}", "")
            line = f"{key:<{width}} = {_value(value)}"
            plain = "".join(sign if sign.isprintable() else "?" for sign in doubt)
            lines.append(f"{line:<36} # {plain}" if doubt else line)
        lines.append("")
    return "\n".join(lines)


def _shape(entry: Entry) -> str:
    return " x ".join(map(str, entry.shape)) or ("1" if entry.dtype else "-")


def _unit(entry: Entry) -> str:
    return f"{entry.unit} ({entry.unit_source})" if entry.unit and entry.unit_source else entry.unit or "-"


def _row(entry: Entry) -> tuple[str, ...]:
    if entry.dtype == TEXT:
        return entry.path, "-", TEXT, "-", repr(entry.remark)
    if entry.fault:
        return entry.path, _shape(entry), entry.dtype or "-", _unit(entry), entry.fault[:_UNITS_OF_DOUBT]
    more = ", ..." if entry.size > len(entry.first) else ""
    values = ", ".join(entry.first) + more
    title = "" if entry.path.endswith(entry.title) or entry.title in entry.remark else entry.title
    about = ", ".join(filter(None, (title, entry.remark)))
    if about:
        values += f"  ({about[:_UNITS_OF_DOUBT]})"
    return entry.path, _shape(entry), entry.dtype, _unit(entry), values


def _show(contents: Contents, trial: Trial | None, everything: bool) -> None:
    usable = [entry for entry in contents.entries if entry.dtype and not entry.fault]
    shown = list(contents.entries)
    if len(shown) > MOST and not everything:
        # rows of numbers say more than the settings of an instrument
        shown = sorted(shown, key=lambda entry: (bool(entry.fault), entry.size < 2))[:MOST]
    print_line(f"{contents.file.name}: {contents.format}, {len(usable)} arrays of numbers")
    header = ("path", "shape", "kind", "unit", "values")
    rows = [_row(entry) for entry in shown]
    widths = [max(len(row[place]) for row in (header, *rows)) for place in range(4)]
    for row in (header, *rows):
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        print_line("  ".join([*cells, row[4]]).rstrip())
    # a fault of many arrays is printed once, and in full
    long = {entry.fault: entry.path for entry in reversed(shown) if len(entry.fault) > _UNITS_OF_DOUBT}
    for fault, path in reversed(long.items()):
        print_line(fault if fault.startswith(f"{contents.file.name}:") else f"{path}: {fault}")
    if contents.remark:
        print_line(contents.remark)
    if len(contents.entries) > len(shown):
        print_line(f"... and {len(contents.entries) - len(shown)} more: --all lists them")
    print_line()
    if trial is None:
        print_line(
            "No frequency, force and response were recognised in it; name them in a [test] table yourself."
        )
        return
    print_line("# a guess by names, units and order, for a case file: rsgen init --from writes it")
    for line in proposal_text(trial.proposal).split("\n"):
        print_line(line)
    for line in trial_lines(trial):
        print_line(line)


def trial_lines(trial: Trial) -> list[str]:
    """Say what a proposed case reads, and what is odd about it."""
    if trial.fault:
        return [f"Read so, the file is refused: {trial.fault}"]
    surface = trial.surface
    if surface is None:
        return []
    levels = f"{len(surface.levels)} level{'' if len(surface.levels) == 1 else 's'}"
    frequency, points = surface.frequency, f"{len(surface)} points"
    if isinstance(surface, MultisineSpectra):
        frequency = frequency[surface.excited().any(axis=0)]
        points = f"{len(frequency)} lines of {surface.periods} periods"
    band = f"{frequency.min():.5g} to {frequency.max():.5g} Hz"
    lines = [f"Read so, the file gives {points} at {levels}, {band}"]
    lines += [f"  {finding.severity}: {sentence(finding)}" for finding in trial.findings]
    lines += [f"  next: {next_step(f)}" for f in trial.findings if f.severity == "doubt"]
    if trial.not_found:
        lines.append(f"  looked for and not found: {', '.join(trial.not_found)}")
    return lines


def inspect_command(
    file: Annotated[Path, typer.Argument(help="A measured file of any format.", show_default=False)],
    everything: Annotated[bool, typer.Option("--all", help="List every array.")] = False,
    json: Json = False,
) -> int:
    """Show what is in a data file (text, MATLAB, universal, TDMS, Excel, ...), and propose a [test] table.

    \b
    Examples:
      rsgen inspect sweep.mat
      rsgen inspect receptances.uff --json
    """
    contents = list_contents(file)
    _print_reading_fault(contents.format)
    proposal = propose(contents)
    trial = try_proposal(contents, proposal) if proposal else None
    if json:
        print_json(
            {
                "file": str(file),
                "format": contents.format,
                "remark": contents.remark,
                "entries": [asdict(entry) for entry in contents.entries],
                "test": trial.proposal.tables if trial else None,
                "doubts": trial.proposal.doubts if trial else {},
                "trial": trial_lines(trial) if trial else [],
                "findings": [finding.to_dict() for finding in trial.findings] if trial else [],
            }
        )
    else:
        _show(contents, trial, everything)
    return 0


def _print_reading_fault(form: str) -> None:
    """Say at the first look into a binary file what this system does not limit while it is read."""
    fault = None if form == "csv" else reading_fault()
    if fault is not None:
        print_faults(
            [
                f"note: of the process that reads a binary file this system limits {fault}; "
                "open files of strangers on Linux"
            ]
        )


# ----------------------------------------------------------------------------
# A proposed case is tried on its file, so that what it reads is seen before anything is identified.

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
    tables = proposal.tables | {"test": proposal.tables["test"] | {"file": file.name}}
    # any force shows whether the file can be read
    text = proposal_text(Proposal(tables)).replace(f'"{UNKNOWN} N"', '"1 N"')
    # a decay is one of any mass
    mass = 1.0 if proposal.tables["test"].get("excitation") == "ring-down" else None
    return load_measured(text, file.parent, mass)
