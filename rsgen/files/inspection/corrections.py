"""What the values that a case reads say against it: the sense of phases, the quantity, what was held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import NOTICEABLE
from rsgen.data.free_mode import fit_powers
from rsgen.data.history import TimeHistory
from rsgen.data.history.multisine_records import find_period
from rsgen.data.history.record import kind_of_force
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.columns import QUANTITIES
from rsgen.data.surface.phase_lag import at_phase_resonance
from rsgen.data.surface.plausibility import driven_points
from rsgen.files.inspection.clues import OVER_FORCE
from rsgen.files.inspection.proposal import Proposal

__all__ = [
    "dies_away",
    "excitation_of",
    "has_levels",
    "moves_in_steps",
    "offset_findings",
    "with_base",
    "with_control",
    "with_quantity",
    "with_sense",
]


# ----------------------------------------------------------------------------
# How a structure was excited, by the values of its records: sweep, steps, many lines, a blow, or release.

_CYCLES = (1, 2, 4, 8, 16, 32, 64)
"""Lengths of the pieces, in cycles, over which the frequency is taken: noise asks for long ones."""
_WINDOW = 8
"""Pieces in a row through which two steps and a line are laid."""
_FEWEST_WINDOWS = 4
"""Windows, at least."""
_NEARER = 0.64
"""Distance that two steps leave over that which a line leaves: of noise alone 0.9; of up to twelve sweeps
one after the other 0.65 and more, as each window that moves leaves the steps more than the line; of steps
0.63 and less unless noise hides them, for a piece may lie between two, and a step at the end of a window."""
_OFF = 1.5
"""A cycle this many times as long as both its neighbours has a silence in it: no sine changes so for one."""
_ROUND_OFF = 1e-6
"""Changes of a frequency below this share are none: a generator that stands still."""
_FEWEST = 24
"""Cycles from which on a force shows what it is."""
_REGULAR = 0.1
"""Lengths of the cycles of a sine differ from one to the next by less than this share, with noise."""
_LIKE = 0.1
"""Peaks of a sine differ from cycle to cycle by less than this share, with noise."""
_MARGIN = 0.2
"""Share of the rms value about zero in which noise makes no cycles."""
_ENDED = 0.2
"""Share of the largest amplitude below which there is no force but noise."""
_ENDS = 0.75
"""A force that ends before this share of its record was switched off, so that the decay is seen."""
_PIECE = 8
"""Cycles that are measured together, against noise."""
_ONE = 1.02
"""Longest over shortest of them where the frequency is one."""
_BLOCKS = 60
"""Parts of a record whose amplitudes are compared."""
_LOUD = 0.3
"""Share of the largest amplitude from which on a part is loud."""
_RISES = 2
"""Parts in which a structure that is released or struck gets loud; a resonance that is passed takes more."""
_QUIET = 0.5
"""Share of the largest amplitude below which a decay ends: a structure that is driven keeps its amplitude."""


def excitation_of(history: TimeHistory) -> str:
    """Name the excitation of a record by its force, as a case does; "" where it is none that is read."""
    force = np.asarray(history.reference, dtype=np.float64)
    force = force - force.mean()
    if kind_of_force(force) in ("constant", "blow"):
        return "ring-down" if force.any() else ""
    driven, ends = _driven(force)
    instants = _cycles(driven)
    if len(instants) < _FEWEST:
        return ""
    if ends and _is_one_frequency(instants):
        return "ring-down"
    duration = np.diff(instants)
    irregular = float(np.median(np.abs(np.diff(np.log(duration)))))
    if (irregular > _REGULAR or _beats(driven, instants)) and _repeats(force):
        return "multisine"
    if irregular > _REGULAR:
        return ""
    return "stepped-sine" if moves_in_steps(instants) else "swept-sine"


def _cycles(force: Array) -> Array:
    """(c,) instants, in samples, at which a force (n,) without mean rises: noise about zero is no cycle."""
    margin = _MARGIN * float(np.sqrt(np.mean(force**2)))
    side = np.where(force > margin, 1, np.where(force < -margin, -1, 0))
    known = np.flatnonzero(side)
    up = np.flatnonzero((side[known][1:] > 0) & (side[known][:-1] < 0)) + 1
    at = known[up]
    return np.asarray(at - (force[at] - margin) / (force[at] - force[at - 1]))


def _driven(force: Array) -> tuple[Array, bool]:
    """Give the part of a force between quiet ends, and whether it ends long before its record."""
    if len(force) < 4 * _BLOCKS:
        return force, False
    loud = _loudness(force)
    active = np.flatnonzero(loud > _ENDED * loud.max())
    length = len(force) // _BLOCKS
    return force[active[0] * length : (active[-1] + 1) * length], bool(active[-1] < _ENDS * _BLOCKS)


def _is_one_frequency(instants: Array) -> bool:
    pieces = np.diff(instants[::_PIECE])
    low, high = np.quantile(pieces, [0.1, 0.9])
    return bool(high < _ONE * low)


def _beats(force: Array, instants: Array) -> bool:
    """Whether the peaks of a force change from cycle to cycle, as those of many lines do."""
    peaks = np.maximum.reduceat(np.abs(force), instants.astype(np.intp))[:-1]
    return bool(np.median(np.abs(np.diff(np.log(peaks)))) > _LIKE)


def _repeats(force: Array) -> bool:
    try:
        find_period(force)
    except MeasurementError:
        return False
    return True


def moves_in_steps(instants: Array) -> bool:
    """Whether the frequency of a sine stands still and jumps, by the instants (c,) at which its cycles begin.

    A few pieces in a row lie on two steps then, rather than on a line; in a sweep it is the other way round,
    and noise lies on neither. Noise asks for long pieces, and short steps for short ones: all are looked at.
    """
    instants = _without_silence(instants)
    return any(
        _on_steps(cycles / np.diff(instants[::cycles]))
        for cycles in _CYCLES
        if len(instants) > _WINDOW * cycles * _FEWEST_WINDOWS
    )


def _without_silence(instants: Array) -> Array:
    """Instants at which cycles (c,) begin, on a clock that stops where the force was off between two runs."""
    cycles = np.diff(instants)
    off = np.zeros(len(cycles), dtype=bool)
    off[1:-1] = cycles[1:-1] > _OFF * np.maximum(cycles[:-2], cycles[2:])
    return np.concatenate([[0.0], np.cumsum(cycles[~off])])


def _on_steps(frequency: Array) -> bool:
    """Whether windows of a frequency (p,) lie much nearer to two steps each than to a line.

    Every window counts by its distance, not by the square of it: of two sweeps in one record a single window
    has the jump back, of many times the size of all others, and the others are sweeps.
    """
    rows = sliding_window_view(frequency, _WINDOW)
    place = np.arange(_WINDOW) - (_WINDOW - 1) / 2
    away = rows - rows.mean(axis=1, keepdims=True)
    line = np.sum(away**2, axis=1) - (away @ place) ** 2 / (place @ place)
    two = [
        away[:, :cut].var(axis=1) * cut + away[:, cut:].var(axis=1) * (_WINDOW - cut)
        for cut in range(2, _WINDOW - 1)
    ]
    of_steps, of_line = (
        float(np.sum(np.sqrt(np.maximum(left, 0.0)))) for left in (np.min(two, axis=0), line)
    )
    return of_steps < _NEARER * of_line and of_line > _ROUND_OFF * float(frequency.mean()) * len(rows)


def _loudness(values: Array) -> Array:
    """(b,) root mean squares of parts of a record."""
    values = values - values.mean()
    length = len(values) // _BLOCKS
    return np.asarray(np.sqrt(np.mean(values[: length * _BLOCKS].reshape(_BLOCKS, length) ** 2, axis=1)))


def dies_away(response: Array) -> bool:
    """Whether a response (n,) gets loud at once and dies away: a decay, not a passage through a resonance."""
    if len(response) < 4 * _BLOCKS:
        return True
    loud = _loudness(np.asarray(response, dtype=np.float64))
    top = int(np.argmax(loud))
    first = int(np.argmax(loud > _LOUD * loud[top]))
    return top - first <= _RISES and bool(loud[-1] < _QUIET * loud[top])


# ----------------------------------------------------------------------------
# Whether a response has a part that does not depend on the force, found before any law is chosen.

_POWERS = (-1, 0, 1, 2, 3)
"""Powers of the amplitude in k(X) and c(X); the first is dry friction. Laws of one mode are nearly made up of
them at one harmonic."""
_FEWEST_FOR_OFFSET = 40
"""Points, at least: some three for each value that is fitted."""
_MOST = 400
"""Points looked at, spread over the test."""
_SPREAD = 1.3
"""Ratio of the forces above which a part that follows the force and one that does not differ."""
_WEAKEST = 0.3
"""Share of the points, those of least force, from whose median a search begins: an offset is large there."""
_LEFT = 0.5
"""The offset must leave less than this share of the misfit, and of the misfit beside a background."""


def has_levels(surface: ResponseSurface) -> bool:
    """Whether a test can show an offset: phases, levels of different force, points enough."""
    force = np.abs(surface.force[driven_points(surface)])
    enough = surface.phase_known and len(surface.levels) > 1 and len(force) >= _FEWEST_FOR_OFFSET
    return enough and bool(force.max() > _SPREAD * force.min())


def offset_findings(surface: ResponseSurface) -> list[Finding]:
    """Find a displacement of one size and phase at every point, whatever the force; one finding or none.

    Any law obeys F/X = k(X) - m omega^2 + i omega c(X) at one harmonic. What X = x - b leaves of that is
    compared with what X = x leaves, and with what a linear background in proportion to the force leaves.

    Parameters
    ----------
    surface
        Measured; without phases or with one level nothing is found.
    """
    if not has_levels(surface):
        return []
    rows = driven_points(surface)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST)).astype(int)]
    force, response = surface.force[rows], surface.harmonics[rows, 1]
    force = force / np.abs(force).max()
    rate = surface.omega[rows] / surface.omega[rows].max()
    response = response / np.median(np.abs(response))
    weak = response[np.abs(force) <= np.quantile(np.abs(force), _WEAKEST)]
    # a large offset is not found from zero
    begin = np.array([np.median(weak.real), np.median(weak.imag)])
    misfit = _misfit(force, response, rate)
    # most tests end here
    if misfit < NOTICEABLE:
        return []
    constant = [np.ones_like(force)]
    left = min(_best_misfit(force, response, rate, constant, start) for start in (np.zeros(2), begin))
    background = _best_misfit(force, response, rate, [force, force / rate**2], np.zeros(4))
    if left > _LEFT * min(misfit, background):
        return []
    numbers = quantities(misfit=misfit, left=left)
    return [Finding("offset-possible", "info", numbers=numbers, names={"kind": "phase+offset"})]


def _misfit(force: ComplexArray, response: ComplexArray, rate: Array) -> float:
    """Relative misfit of the best law."""
    return fit_powers(force, response, rate, _POWERS, 1 / np.abs(force)).misfit


def _best_misfit(
    force: ComplexArray, response: ComplexArray, rate: Array, parts: list[ComplexArray], begin: Array
) -> float:
    """Relative misfit of the best law, the best multiples of ``parts``, sought from ``begin``, taken off."""
    typical, weight = float(np.median(np.abs(response))), 1 / np.abs(force)
    columns = np.array([part / np.median(np.abs(part)) for part in parts])

    def rest(values: Array) -> ComplexArray:
        taken: ComplexArray = typical * (values[::2] + 1j * values[1::2]) @ columns
        return response - taken

    def residual(values: Array) -> Array:
        left = fit_powers(force, rest(values), rate, _POWERS, weight).left
        return np.concatenate([left.real, left.imag])

    # loaded here first: a third of a second, and needed where any law misfits
    values = scipy.optimize.least_squares(residual, begin, x_scale=0.1, max_nfev=60).x
    return _misfit(force, rest(values), rate)


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
