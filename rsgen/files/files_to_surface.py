"""Measured files and their plan to a response surface: displacement and force as SI peak values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError, listed, quote, shown_path
from rsgen.common.finding import Finding, quantities
from rsgen.data.free_mode import fit_mode, steady
from rsgen.data.history import (
    TimeHistory,
    from_free_decay,
    from_multisine,
    from_stepped_sine,
    from_swept_sine,
    record_findings,
)
from rsgen.data.history.record import driven_amplitude
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.record_set import MIN_POINTS_OF_RUN, below_acceleration, repeated_run
from rsgen.data.surface.columns import recognise_directions
from rsgen.data.surface.mode_findings import mixed_levels
from rsgen.data.surface.plausibility import base_findings, lag_findings, quantity_findings
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.files.column_titles import (
    UNIT_TOLERANCE,
    column_read_in,
    contradiction,
    is_angular,
    scale_doubts,
    split_title,
    unit_in,
)
from rsgen.files.file_table import Sources, Table, join_motions, read_sources
from rsgen.files.histories import read_motions
from rsgen.files.inspection.listing import list_contents
from rsgen.files.nominal_levels import (
    amplitude_steps,
    assign_levels,
    level_in_name,
    level_of_file,
    name_levels,
    runs_of_one_level,
    stable_points,
)
from rsgen.files.plan import HERTZ, HistoryRule, MeasuredTest
from rsgen.formula.units import sensor_size
from rsgen.law.motion import cycle_work

# ----------------------------------------------------------------------------
# Copies among the runs of one test.

_MIN_SHARE_OF_REPEATED_ROWS = 0.2
"""From this share of rows on that are the one before, an export wrote rows twice."""


def repeated_rows(frequency: Array, force: ComplexArray, response: ComplexArray) -> NDArray[np.bool_]:
    """(n,) True for a row that is the one before, to the last digit: written twice, not measured twice.

    None where only a few are, as at the turn of a sweep or where a display has few digits.
    """
    same = np.zeros(len(frequency), dtype=np.bool_)
    same[1:] = np.all([values[1:] == values[:-1] for values in (frequency, force, response)], axis=0)
    written_twice = same.sum() >= max(MIN_POINTS_OF_RUN, _MIN_SHARE_OF_REPEATED_ROWS * len(same))
    return same if written_twice else np.zeros_like(same)


# ----------------------------------------------------------------------------
# Passivity: force and response, as the case reads them, must be those of a structure that takes energy.
#
# A structure without a source of energy takes power from its shaker at every frequency, and its dynamic
# stiffness F/X = k(X) - m omega^2 + i omega c(X) falls with the frequency. A phase read in the wrong sense
# mirrors the second, a channel with the sign reversed both; neither shows in the quality of a fit.

_MIN_POWER_RATIO = -0.1
"""Power over the most of force and velocity in phase; errors of the phase leave a few percent."""
_MIN_CORRELATION = 0.5
"""Correlation of the real part with the square of the frequency; a falling one with scatter has less."""


def _takes_power(surface: ResponseSurface) -> bool:
    """Return True if the shaker takes power: clearly, or at nearly all points on both sides of resonance.

    Away from resonance, as where the response jumps past it, the power is small; but an error of all phases
    turns the power of one side only.
    """
    force, response = surface.force, surface.harmonics[:, 1]
    power = surface.frequency * cycle_work(force, response)
    most = surface.frequency @ (np.pi * np.abs(force) * surface.amplitude)
    below = np.real(force * response.conj()) > 0
    sides = [power[side] for side in (below, ~below)]
    small = all(len(side) >= MIN_POINTS_OF_RUN and np.quantile(side, 0.9) < 0 for side in sides)
    return small or bool(np.sum(power) < _MIN_POWER_RATIO * most)


@np.errstate(all="ignore")
def _stiffness_rises(surface: ResponseSurface) -> bool:
    """Return True if the real part of the dynamic stiffness rises with the square of the frequency.

    Absurd numbers may overflow; the answer is then False.
    """
    _, level, count = np.unique(surface.level, return_inverse=True, return_counts=True)
    chosen = surface.select(count[level] >= MIN_POINTS_OF_RUN)
    if not len(chosen):
        return False
    levels = (chosen.level[:, None] == np.unique(chosen.level)).astype(float)
    balance = steady(chosen.force, chosen.harmonics[:, 1], chosen.omega)
    fits = [fit_mode(*balance, levels, 1 / np.abs(chosen.force), mass=mass) for mass in (nan, 0.0)]
    left, whole = (float(np.sum(found.left.real**2)) for found in fits)
    return fits[0].mass < 0 and left < (1 - _MIN_CORRELATION**2) * whole


def passivity_findings(surface: ResponseSurface, sense: str | None, quantity: str) -> tuple[Finding, ...]:
    """Find what is reversed where force and response cannot be those of a passive structure; none or one.

    Parameters
    ----------
    surface
        With phase.
    sense
        How the case reads the phase of the response, "lag" or "lead"; None where it has none to read.
    quantity
        What was recorded: a velocity read in the wrong sense is a displacement mirrored and turned round.
    """
    good = surface.settled & np.isfinite(surface.phase) & (surface.amplitude > 0) & (surface.force != 0)
    if np.count_nonzero(good) < MIN_POINTS_OF_RUN:
        return ()
    chosen = surface.select(good)
    # signs do not depend on the scale; squares of absurd units would overflow
    chosen = replace(
        chosen,
        force=chosen.force / np.max(np.abs(chosen.force)),
        harmonics=chosen.harmonics / np.max(np.abs(chosen.harmonics[:, 1])),
        frequency=chosen.frequency / np.max(chosen.frequency),
    )
    fed, rises = _takes_power(chosen), _stiffness_rises(chosen)
    if not (fed or rises):
        return ()
    names = {"against": " and ".join(["power"] * fed + ["mass"] * rises)}
    if sense is not None:
        names["phase_sense"] = "lag" if sense == "lead" else "lead"
    if fed and rises:
        names["reversed"] = "channel"
    elif sense is None:
        names["reversed"] = "unknown"
    else:
        names["reversed"] = "phase" if fed == (quantity != "velocity") else "channel and phase"
    return (Finding("not-passive", "doubt", names=names),)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """The points of one file; (n, E) motions, the displacement first.

    The level is None where it follows from the forces of all files.
    """

    frequency: Array
    force: ComplexArray
    motions: ComplexArray
    level: Array | None
    block: NDArray[np.int64]
    findings: tuple[Finding, ...]
    unit_said: bool


def _level(test: MeasuredTest, number: int, table: Table) -> Array | None:
    """Return the level of each row [N]; None where it follows from the forces of all files."""
    if test.level.name is not None and len(table.entries) > 1 == len(test.files):
        named = [level_in_name(test, name, f"{table.label}: {quote(name)}") for name in table.entries]
        return np.array(named)[table.block]
    alone = level_of_file(test, number)
    if alone is not None:
        return np.full(len(table.number), alone)
    if test.level_values:
        entries = int(table.block.max()) + 1
        if entries != len(test.level_values):
            raise MeasurementError(
                f"{table.label}: {entries} entries and {len(test.level_values)} levels; a level for each "
                "entry is needed"
            )
        return np.array(test.level_values)[table.block]
    if test.level.column is None:
        return None
    factor, unit = test.level_factor, table.units.get(test.level.column, "")
    if test.level.unit is None and unit and test.calibrated:
        # a unit of something else, such as the volts of a drive, is passed over: the forces will tell
        factor *= sensor_size(unit, test.level_unit) or 1.0
    level = table.real(test.level.column) * factor
    if not test.level.labels:
        table.refuse(level <= 0, "level is not positive; levels above 0 are needed")
    return level


def _order_of_entries(test: MeasuredTest, table: Table) -> list[Finding]:
    """Find levels that are the numbers in the names of entries, such as sheets, in another order."""
    numbers = [re.findall(r"\d+(?:\.\d+)?", name) for name in table.entries]
    found = [float(one[0]) for one in numbers if len(one) == 1]
    for name, level, number in zip(table.entries, test.level.values, found, strict=False):
        if level != number and sorted(found) == sorted(test.level.values):
            names = {"file": table.label, "entry": name}
            return [Finding("levels-swapped", "doubt", numbers=quantities(level=level), names=names)]
    return []


def _level_doubts(test: MeasuredTest, table: Table) -> list[Finding]:
    """Find that levels are read in another unit than the file names for their column."""
    column, read_as = test.level.column, test.level.unit
    if column is None or test.level.labels or test.level.factor != 1 or not test.calibrated:
        return []
    doubts = scale_doubts(table.label, table.names.get(column, ""), test.level.scale)
    if read_as is None:
        return doubts
    unit = table.units.get(column, "")
    said, read = (sensor_size(one, test.level_unit) for one in (unit, read_as))
    # of another dimension, as above
    if said is None or read is None or abs(said - read) <= UNIT_TOLERANCE * read:
        return doubts
    return [*doubts, contradiction(table.label, table.names.get(column) or str(column), read_as, unit)]


def _hertz(test: MeasuredTest, table: Table) -> tuple[float, list[Finding]]:
    """Find what the numbers of the frequency are in Hz; a doubt where their title says otherwise."""
    column = cast("int | str", test.frequency)
    title, unit = table.names.get(column, ""), table.units.get(column, "")
    read_as = test.frequency_unit or unit
    factor, name = HERTZ.get(read_as, 1.0), split_title(title)[0]
    # a row of units may have added another unit to the title
    others = [one for one in (unit_in(name), unit_in(title)) if HERTZ.get(one, factor) != factor]
    doubts = [contradiction(table.label, title or str(column), read_as or "Hz", one) for one in others[:1]]
    if test.frequency_unit is not None or doubts:
        return factor, doubts
    if table.unit_of_place == "row":
        title = title.rpartition("/")[2]
    if unit in HERTZ and unit != "Hz":
        about = {"file": table.label, "column": str(column), "unit": unit, "source": "the file"}
        return HERTZ[unit], [Finding("unit-of-file", "info", names=about)]
    if unit not in HERTZ and is_angular(title):
        return 1.0, [contradiction(table.label, title, "Hz", "an angular frequency in rad/s")]
    said = "Hz" in (unit, unit_in(title))
    return 1.0, [] if said else [
        Finding("unit-of-file", "info", names={"default": column_read_in(column, "Hz")})
    ]


def _part(test: MeasuredTest, number: int) -> _Part:
    """Read the points of one file."""
    sources = read_sources(test, number)
    raw = sources.main.real(cast("int | str", test.frequency))
    sources.main.refuse(raw < 0, "frequency is negative; positive frequencies are needed")
    # exported receptances often begin at 0 Hz, where there is no harmonic test
    keep = raw > 0
    if not keep.any():
        raise MeasurementError(f"{sources.main.label}: no row with a frequency above 0")
    sources = sources.keep(keep)
    table = sources.main
    factor, doubts = _hertz(test, table)
    frequency = raw[keep] * factor
    level = _level(test, number, table)
    force, motions = _driven(sources, frequency, level)
    doubts = [*doubts, *_level_doubts(test, table), *sources.doubts(), *_order_of_entries(test, table)]
    # exactly zero is what a channel gives that was not yet read, or an amplitude below the last digit
    silent = (force == 0) | (motions == 0).any(axis=1)
    twice = repeated_rows(frequency, force, motions[:, 0]) & ~silent
    if (silent | twice).any():
        for by, rows in (("zero", silent), ("copies", twice)):
            if rows.any():
                numbers = quantities(rows=int(rows.sum()), all=len(rows))
                names = {"file": table.label, "by": by}
                doubts = [*doubts, Finding("rows-left-out", "warning", numbers=numbers, names=names)]
        kept = ~(silent | twice)
        table = table.keep(kept)
        frequency, force, motions = frequency[kept], force[kept], motions[kept]
        level = None if level is None else level[kept]
    if not test.phase_known:
        force, motions = np.abs(force) + 0j, np.abs(motions) + 0j
    findings = (*sources.findings, *doubts)
    said = test.unit_said or (test.level.column is not None and bool(table.units.get(test.level.column)))
    return _Part(frequency, force, motions, level, table.block, findings, said)


def _driven(sources: Sources, frequency: Array, level: Array | None) -> tuple[ComplexArray, ComplexArray]:
    """(n,) force [N], [N/kg] of a driven base; (n, E) displacement [m], relative to it, and others."""
    test = sources.test
    motions = np.stack([sources.sum(what, frequency) for what in test.motions], axis=1)
    if test.base is not None:
        base = sources.sum("base", frequency, level)
        if test.base.response == "absolute":
            motions[:, 0] -= base
        return (2 * np.pi * frequency) ** 2 * base, motions
    if "force" in test.made:
        force = sources.sum("force", frequency)
    else:
        # without a force the plan asks for a level, of a held response over force for the response
        force = np.asarray(cast("Array", level), dtype=np.complex128)
        if test.control == "response":
            ratio = motions[:, 0]
            force = np.divide(force, ratio, out=np.zeros_like(force), where=ratio != 0)
    if test.per_force:
        motions[:, 0] *= force
    return force, motions


def _drive(test: MeasuredTest, force: ComplexArray, frequency: Array) -> ComplexArray:
    """(n,) what levels are amounts of: the force, or the motion of the base, in the phase of the force."""
    if test.base is None:
        return force
    left = below_acceleration(test.quantity_of("base"))
    return np.asarray(force / (2 * np.pi * frequency) ** left)


def _amplitudes(test: MeasuredTest) -> ResponseSurface:
    """Read a table of amplitudes, a row a point: channels of all files, levels, sweeps, what is doubtful."""
    parts = [_part(test, number) for number in range(len(test.files))]
    frequency = np.concatenate([part.frequency for part in parts])
    force = np.concatenate([part.force for part in parts])
    motions = np.concatenate([part.motions for part in parts])
    displacement, far = motions[:, 0], motions[:, 1:]
    counts = np.cumsum([0, *(int(part.block[-1]) + 1 for part in parts)])
    block = np.concatenate([part.block + count for part, count in zip(parts, counts, strict=False)])
    levels = [part.level for part in parts if part.level is not None]
    known = bool(levels)
    run = np.concatenate(levels) if known else None
    # where the response was held each file is a run, or each entry that a * of the plan stands for
    places = (test.frequency, *(column for source in test.sources for column in source.columns))
    starred = any("*" in place for place in places if isinstance(place, str))
    held = block if starred else np.repeat(np.arange(len(parts)), [len(part.frequency) for part in parts])
    findings = [finding for part in parts for finding in part.findings]
    if test.control == "phase" and not test.phase_known:
        # a phase-locked loop holds 90 degrees
        displacement = np.asarray(np.abs(displacement) * np.exp(-0.5j * np.pi))
        findings.append(Finding("phase-lag", "warning", names={"by": "assumed"}))
    drive, size = np.abs(_drive(test, force, frequency)), np.abs(displacement)
    level = assign_levels(test, frequency, drive, size, run, block, held)
    followed = test.control == "continuation"
    recognised = test.sweep.direction == "recognise"
    ordered = recognise_directions(frequency, level, block)
    told = ordered if recognised else test.sweep.direction
    if test.sweep.direction == "up" and set(ordered) == {"down"}:
        # tables are sorted in ascending order only
        findings.append(Finding("direction-from-branch", "doubt", names={"by": "rows"}))
    sweep = "rest" if followed else told
    nominal = test.level.column is not None and np.array_equal(drive, np.concatenate(levels))
    if nominal or not test.driven:
        ratio = "held" if test.control == "response" else "ratio"
        by = {"by": ratio} if test.per_force else {"by": "equality"} if test.driven else {}
        signal = "force" if test.base is None else "base"
        findings.append(Finding("not-recorded", "warning", names={"signal": signal, **by}))
    surface = ResponseSurface(
        level=level,
        frequency=frequency,
        force=force,
        response=displacement.astype(np.complex128),
        # no such test measures a mean
        across=np.concatenate([0 * far, far], axis=1),
        per_mass=test.base is not None,
        base="" if test.base is None else test.quantity_of("base"),
        sweep=sweep,
        phase_known=test.phase_known or test.control == "phase",
        control=test.control,
        stable=stable_points(frequency, drive, size) if followed else None,
        findings=tuple(findings),
    )
    files = map(shown_path, test.response.files or test.files)
    blocks = [(file, range(count)) for file, count in zip(files, np.diff(counts), strict=True)]
    parted = len(test.files) == 1
    names = [f"{file}, part {n + 1}" if parted else file for file, entries in blocks for n in entries]
    of_runs = _run_findings(test, surface, names, block, drive if known else None)
    surface = replace(surface, findings=(*surface.findings, *of_runs))
    if followed or test.level.spread is not None or (run is None and test.control != "response"):
        return surface
    return name_levels(surface, test, known, any(part.unit_said for part in parts))


def _run_findings(
    test: MeasuredTest,
    surface: ResponseSurface,
    names: Sequence[str],
    block: NDArray[np.intp],
    drive: Array | None,
) -> list[Finding]:
    """Find runs that are the same, and with the drive (n,) of known levels those whose drives contradict."""
    points = np.stack([surface.frequency, surface.harmonics[:, 1]], axis=1)
    runs_of = np.stack(
        [block, *(np.unique(one, return_inverse=True)[1] for one in (surface.level, surface.sweep))]
    )
    _, run = np.unique(runs_of, axis=1, return_inverse=True)
    # of response over force a linear structure has the same at every level
    rows_of_runs = [] if test.per_force else [np.flatnonzero(run == n) for n in range(run.max() + 1)]
    consistent = repeated_run(
        (names[block[at[0]]], points[at]) for at in rows_of_runs if len(at) >= MIN_POINTS_OF_RUN
    )
    if drive is not None and test.control in ("force", "phase"):
        rows = [block == number for number in range(len(names))]
        runs = [
            (name, float(surface.level[at][0]), float(np.median(drive[at])))
            for name, at in zip(names, rows, strict=True)
            if at.any() and len(set(surface.level[at])) == 1
        ]
        consistent += runs_of_one_level(runs, surface.level_unit)
    return consistent


def _levels_of_histories(
    surface: ResponseSurface, test: MeasuredTest, histories: list[TimeHistory]
) -> ResponseSurface:
    """Say what was held, and settle the levels that the plan gives."""
    surface = replace(surface, control=test.control)
    if surface.control == "continuation":
        return replace(surface, level=amplitude_steps(surface.amplitude, test.level.spread))
    if any(history.level is None for history in histories):
        return surface
    runs = [(one.label, cast("float", one.level), driven_amplitude(one.reference)) for one in histories]
    found = runs_of_one_level(runs, surface.level_unit) if surface.control in ("force", "phase") else []
    surface = replace(surface, findings=(*surface.findings, *found))
    return name_levels(surface, test, True, test.unit_said)


def _findings_of(histories: list[TimeHistory]) -> list[Finding]:
    """Find records with equal responses, and faults of each."""
    copies = repeated_run((one.label, one.response) for one in histories)
    return copies + [found for one in histories for found in record_findings(one)]


def _from_multisine(test: MeasuredTest, rule: HistoryRule) -> MultisineSpectra:
    histories, *across = read_motions(test)
    labels = [history.level for history in histories] if test.level.labels else [None]
    if test.level.labels:
        histories = [replace(history, level=None) for history in histories]
    base = "" if test.base is None else "acceleration"
    spectra = from_multisine(
        histories, period=rule.period, transient=rule.transient, base=base, across=across[0] if across else ()
    )
    records = _findings_of(histories)
    # a force that is not in N has no amount that a level could be
    kept = [f for f in spectra.findings if test.calibrated or f.code != "levels-in-other-unit"]
    if None not in labels:
        spectra = replace(spectra, label=np.array(labels, dtype=np.float64))
    return replace(spectra, findings=(*records, *kept))


def _from_histories(test: MeasuredTest, rule: HistoryRule) -> ResponseSurface:
    motions = read_motions(test)
    histories, surface = motions[0], join_motions(*(_demodulated(one, test, rule) for one in motions))
    if test.base is not None:
        # the kilogram of a force per mass is no mass of the structure
        findings = tuple(map(_without_mass, surface.findings))
        surface = replace(surface, per_mass=True, base="acceleration", findings=findings)
    if rule.excitation != "ring-down":
        surface = _levels_of_histories(surface, test, histories)
    said = [found for history in histories for found in history.findings]
    return replace(surface, findings=(*_findings_of(histories), *said, *surface.findings))


def _without_mass(found: Finding) -> Finding:
    numbers = {name: number for name, number in found.numbers.items() if name != "mass"}
    return replace(found, numbers=numbers, names={n: text for n, text in found.names.items() if n != "mass"})


def _demodulated(histories: list[TimeHistory], test: MeasuredTest, rule: HistoryRule) -> ResponseSurface:
    """Follow swept or stepped sines, else free decays, which are what is left of ``Excitation``."""
    # the force on a driven base is one on a kilogram
    mass = rule.mass if test.base is None else 1.0
    given = {} if rule.harmonics is None else {"harmonics": rule.harmonics}
    if rule.excitation == "swept-sine":
        return from_swept_sine(
            histories, band=rule.band, law=rule.law, bandwidth=rule.bandwidth, mass=mass, **given
        )
    if rule.excitation == "stepped-sine":
        return from_stepped_sine(histories, band=rule.band, **given)
    return from_free_decay(histories, mass=mass, band=rule.band, start=rule.start, **given)


def read_measurement(test: MeasuredTest) -> ResponseSurface | MultisineSpectra:
    """Read a measured test.

    Velocity and acceleration are integrated in the frequency domain, X = V/(i omega) = -A/omega^2. The
    phase of the response counts from the force. Rows at 0 Hz are skipped. The mean is not measured by
    such a test and stands as 0; peaks, residual and error are unknown (NaN).

    Parameters
    ----------
    test
        Which files, and where in them what is found.

    Returns
    -------
    ResponseSurface or MultisineSpectra
        For tables of amplitudes one row a row of the files, in their order, with origin "measured"; of a
        periodic multisine its spectra.

    Raises
    ------
    MeasurementError
        A file cannot be read as the plan says; the message names file and line or row.
    """
    table = _read(test)
    findings = _join_files(_without_folders(table.findings, test.all_files))
    # units that were not stated, of all files in one note
    default = dict.fromkeys(text for found in findings if (text := found.names.get("default")))
    stated = [found for found in findings if "default" not in found.names]
    hertz = [text for text in default if text.endswith(" read in Hz")]
    if amounts := [text for text in default if text not in hertz]:
        stated.append(Finding("unit-of-file", "doubt", names={"default": "; ".join(amounts)}))
    if hertz:
        stated.append(Finding("unit-of-file", "info", names={"default": "; ".join(hertz)}))
    if test.base is not None and not test.level.known:
        stated.append(Finding("not-recorded", "info", names={"signal": "levels"}))
    return replace(table, findings=tuple(stated))


def _without_folders(findings: tuple[Finding, ...], files: tuple[Path, ...]) -> tuple[Finding, ...]:
    """Name files in findings, which go into results, without the folder that they had on this computer."""
    for path in files:
        findings = tuple(
            replace(f, names={k: text.replace(shown_path(path), path.name) for k, text in f.names.items()})
            for f in findings
        )
    return findings


def _join_files(findings: Iterable[Finding]) -> list[Finding]:
    """Join findings that differ in their file alone."""
    files: dict[Finding, list[str]] = {}
    for found in findings:
        names = {name: text for name, text in found.names.items() if name != "file"}
        files.setdefault(replace(found, names=names), []).append(found.names.get("file", ""))
    return [
        replace(found, names={**found.names, "file": listed(list(dict.fromkeys(of)))}) if any(of) else found
        for found, of in files.items()
    ]


def _read(test: MeasuredTest) -> ResponseSurface | MultisineSpectra:
    if test.history is not None and test.history.excitation == "multisine":
        return _from_multisine(test, test.history)
    if test.history is not None and test.history.excitation == "ring-down":
        return _from_histories(test, test.history)
    surface = _amplitudes(test) if test.history is None else _from_histories(test, test.history)
    sense = None if test.history is not None else "lag" if test.sources[-1].lags else "lead"
    quantity = cast("str", test.quantity)
    if test.base is None:
        other = tuple(quantity_findings(surface, quantity))
    else:
        # a force per mass and a motion relative to the base are made of several measured quantities
        absolute = test.base.response == "absolute"
        other = base_findings(surface, absolute=absolute, senses=test.history is None)
    # a base that was misread feeds or mirrors by that
    passive = () if test.base is not None and other else passivity_findings(surface, sense, quantity)
    lag = lag_findings(surface)
    mixed = mixed_levels(surface) if test.history is None else []
    if mixed:
        columns = [entry.title or entry.path for entry in list_contents(test.file).entries if entry.size > 1]
        mixed = [replace(one, names={**one.names, "columns": listed(columns)}) for one in mixed]
    return replace(surface, findings=(*surface.findings, *passive, *other, *lag, *mixed))
