"""Columns of the response surface: units, types, checks; and its levels compared with each other."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, pairwise
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, unmasked
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import RELATIVE_ERROR_DOUBTFUL, ROUND_OFF
from rsgen.data.record_set import LEVEL_TOLERANCE, MIN_POINTS_OF_RUN

SWEEPS = ("rest", "up", "down")

CONTROLS = ("force", "response", "phase", "continuation")
"""Quantity that a test holds constant within a level: force, amplitude of the response, force and phase, none
(control-based continuation, whose levels are steps of the amplitude), or the root mean square of a multisine
(whose best linear approximation is no response to a sine)."""

COLUMN_UNITS = {
    "level": "N",
    "frequency": "Hz",
    "force": "N",
    "force_harmonics": "N",
    "harmonics": "m",
    "across": "m",
    "peak": "m",
    "sweep": "",
    "outcome": "",
    "residual": "1",
    "error": "1",
    "stable": "",
    "label": "",
}
"""SI unit of every column of a test with a force; ``level_unit`` and ``force_unit`` hold for any surface."""

_DTYPES: dict[str, type | str] = {
    "force": np.complex128,
    "force_harmonics": np.complex128,
    "harmonics": np.complex128,
    "response": np.complex128,
    "across": np.complex128,
    "sweep": "U4",
    "outcome": np.int8,
    "stable": np.bool_,
}


def column(values: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return a column as a read-only copy; a single value is repeated at every point."""
    dtype = _DTYPES.get(name, np.float64)
    if dtype is np.float64 and np.iscomplexobj(values):
        of_force = "; a complex force is force=, its level the nominal amplitude" if name == "level" else ""
        raise RsgenError(f"surface.{name}: complex numbers; allowed are real ones{of_force}")
    try:
        array = np.array(unmasked(values), dtype=dtype)
    except (TypeError, ValueError) as fault:
        raise RsgenError(f"surface.{name}: {fault}") from None
    if array.ndim == 0 and len(shape) == 1:
        array = np.full(shape, array)
    if array.ndim != len(shape) or any(
        want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    ):
        expected = ", ".join("any" if size == -1 else str(size) for size in shape)
        expected += "," if len(shape) == 1 else ""
        known = ", as the frequency has them"
        if name == "frequency":
            expected, known = "n,", "; ravel all arguments where all have this shape"
        if name in ("level", "frequency"):
            known += "; of a table np.repeat the levels, np.tile the frequencies and ravel the rest"
        raise RsgenError(
            f"surface.{name}: shape {array.shape}; must be ({expected}), one row a test point{known}"
        )
    array.flags.writeable = False
    return array


def response_columns(
    response: Any, harmonics: Any, phase_known: bool, rows: int, force: Any = 0.0
) -> NDArray[Any]:
    """Return harmonics (n, H+1) [m], mean first, of a response or of harmonics; errors name the argument.

    Real amplitudes with a complex ``force`` are its phase reference, and their phase is known.
    """
    if (response is None) == (harmonics is None):
        raise RsgenError("surface: give the response once, as response= or as harmonics=")
    if harmonics is not None:
        return column(harmonics, "harmonics", (rows, -1))
    array = np.asarray(unmasked(response))
    if array.ndim > 1 and not (phase_known and array.dtype.kind in "biuf"):
        return column(array, "response", (rows, -1))
    real, turned = array.size and array.dtype.kind in "biuf", bool(np.any(np.imag(unmasked(force))))
    if real and turned:
        raise RsgenError(
            "surface.response: real numbers with a complex force; where the response is the phase "
            "reference of the force, give response = amplitude + 0j (and leave out phase_known=False); "
            "otherwise the complex fundamental X = amplitude * exp(-1j * lag)"
        )
    if phase_known and real:
        raise RsgenError(
            "surface.response: real numbers have no phase; give the complex fundamental "
            "X = amplitude * exp(-1j * lag) of shape (n,), complex harmonics (n, H+1), mean first, "
            "or phase_known=False where only amplitudes were measured"
        )
    fundamental = column(np.atleast_1d(array), "response", (rows,))
    return column(np.stack([np.zeros_like(fundamental), fundamental], axis=1), "harmonics", (rows, -1))


def force_columns(force: Any, harmonics: Any, rows: int) -> dict[str, NDArray[Any]]:
    """Return the fundamental (n,) and all recorded harmonics (n, K+1) of the force [N], mean first.

    The harmonics of ``force`` replace ``harmonics``; a fundamental alone replaces that of ``harmonics``.
    """
    name = "force" if np.ndim(force) > 1 else "force_harmonics"
    if name == "force":
        harmonics = force
    elif harmonics is None:
        harmonics = np.zeros((rows, 2))
    whole = np.array(column(harmonics, name, (rows, -1)))
    if whole.shape[1] < 2:
        raise RsgenError(f"surface.{name}: needs at least the mean and the fundamental")
    fundamental = column(whole[:, 1] if name == "force" else force, "force", (rows,))
    whole[:, 1] = fundamental
    return {"force": fundamental, "force_harmonics": column(whole, "force_harmonics", (rows, -1))}


def across_columns(across: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return harmonics (n, H+1) [m] of the motion across two sensors, of the shape that the response has.

    None, and a motion without columns, are a test with one response.
    """
    if across is None or np.shape(across)[1:] == (0,):
        return column(np.zeros((shape[0], 0)), "across", (shape[0], 0))
    return column(across, "across", shape)


def check_numbers(columns: dict[str, Any]) -> None:
    """Raise RsgenError if a frequency, a level or the number of harmonics is out of range."""
    if columns["harmonics"].shape[1] < 2:
        raise RsgenError("surface.harmonics: needs at least the mean and the fundamental")
    frequency, level = columns["frequency"], columns["level"]
    if not np.all(np.isfinite(frequency) & (frequency > 0)):
        raise RsgenError("surface.frequency: must be positive and finite everywhere")
    if not np.isfinite(level).all():
        row = int(np.argmin(np.isfinite(level)))
        raise RsgenError(f"surface.level: {level[row]} in row {row}; must be finite everywhere")
    if (level < 0).any():
        row = int(np.argmax(level < 0))
        raise RsgenError(f"surface.level: {level[row]:g} in row {row}; an amplitude must not be negative")


# ----------------------------------------------------------------------------
# Sweep direction of every test point by the order of the frequencies; groups of like forces.

MIN_TURN = 0.02
"""Change of frequency, relative to the range of the block, by which a sweep turns back; jitter is less."""


def group_forces(force: Array, spread: float) -> NDArray[np.intp]:
    """Return the number (n,) of the group of each force (n,) [N]; a relative gap above ``spread`` begins one.

    Examples
    --------
    >>> group_forces(np.array([1.0, 1.02, 2.0, 0.99]), 0.1).tolist()
    [0, 0, 1, 0]
    """
    order = np.argsort(force, kind="stable")
    ordered = force[order]
    group = np.zeros(len(force), dtype=np.intp)
    group[order[1:]] = np.cumsum(np.diff(ordered) > spread * ordered[:-1])
    return group


def monotone_runs(frequency: Array, turn: float) -> list[tuple[int, int, str]]:
    """Return runs (start, stop, direction) between turns of the frequency (n,), relative to its range.

    Examples
    --------
    >>> monotone_runs(np.array([1.0, 2.0, 2.99, 3.0, 2.99, 1.5]), 0.02)
    [(0, 4, 'up'), (4, 6, 'down')]
    """
    threshold = turn * float(np.ptp(frequency)) if len(frequency) else 0.0
    if threshold == 0:
        return [(0, len(frequency), "rest")]
    runs: list[tuple[int, int, str]] = []
    start, extreme, direction = 0, 0, ""
    for i in range(1, len(frequency)):
        move = frequency[i] - frequency[extreme]
        if direction == "":
            if abs(move) >= threshold:
                direction, extreme = ("up" if move > 0 else "down"), i
        elif move != 0 and (move > 0) == (direction == "up"):
            extreme = i
        elif abs(move) >= threshold:
            # the turning point belongs to the run before it
            runs.append((start, extreme + 1, direction))
            start, extreme, direction = extreme + 1, i, ("up" if move > 0 else "down")
    return [*runs, (start, len(frequency), direction or "rest")]


def recognise_directions(
    frequency: Array, level: Array, block: NDArray[np.int64] | None = None
) -> NDArray[np.str_]:
    """Return the sweep direction of each point by the order of the frequencies.

    A new run begins where the block or the level changes and where the frequency turns back.

    Parameters
    ----------
    frequency, level
        (n,) [Hz], [N] in the order of the test.
    block
        (n,) number of the block in the file; None: one block.

    Returns
    -------
    (n,) "up", "down", or "rest" where a run is a single frequency; "rest" everywhere if the rows are in no
    order of frequency.

    Examples
    --------
    >>> import numpy as np
    >>> f = np.array([1.0, 2.0, 3.0, 2.5, 1.5])
    >>> [str(d) for d in recognise_directions(f, np.ones(5))]
    ['up', 'up', 'up', 'down', 'down']
    """
    directions = np.full(len(frequency), "rest", dtype="U4")
    changed = np.diff(level) != 0
    if block is not None:
        changed |= np.diff(block) != 0
    edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(frequency)]
    count = 0
    for left, right in pairwise(edges):
        for start, stop, direction in monotone_runs(frequency[left:right], MIN_TURN):
            directions[left + start : left + stop] = direction
            count += 1
    # a direction needs two points: shorter runs on average are rows in no order
    if 2 * count > len(frequency):
        directions[:] = "rest"
    return directions


def levels_in_noise(
    level: Array, sweep: NDArray[np.str_], frequency: Array, receptance: ComplexArray
) -> NDArray[np.bool_]:
    """Return the mask (n,) of levels whose phases change between frequencies as those of noise do.

    The phase of a motion turns near a resonance alone, so that the cosine of its steps has a mean near 1;
    where friction holds the mass, the sensor shows its noise, with a mean near 0. None where all are so.
    """
    order = np.lexsort((frequency, sweep, level))
    names, number = np.unique(level[order], return_inverse=True)
    phase, way = np.angle(receptance[order]), sweep[order]
    noise = np.ones(len(names), dtype=np.bool_)
    # of two branches side by side every second reading is of one motion
    for step in (1, 2):
        within = (number[step:] == number[:-step]) & (way[step:] == way[:-step])
        turned, at = np.cos(phase[step:] - phase[:-step])[within], number[step:][within]
        count, total = np.bincount(at, minlength=len(names)), np.bincount(at, turned, len(names))
        noise &= (count >= MIN_POINTS_OF_RUN) & (total < count / 2)
    noise = noise[np.searchsorted(names, level)]
    return noise & ~noise.all()


def _steps(level: Array, frequency: Array, force: Array, amplitude: Array) -> tuple[Array, Array]:
    """Return the steps (k, k) of log F and log X between levels at the same frequencies; NaN if unknown.

    From a level at rest to one that moves log X rises by more than any number has; of two at rest nothing is
    known.
    """
    order = np.argsort(frequency)
    columns = [np.log(sizes, out=np.full(len(sizes), -1e3), where=sizes > 0) for sizes in (force, amplitude)]
    names = np.unique(level)
    runs = [order[level[order] == name] for name in names]
    pushed, moved = np.full((2, len(names), len(names)), nan)
    for (i, one), (j, other) in combinations(enumerate(runs), 2):
        common = one[(frequency[one] >= frequency[other[0]]) & (frequency[one] <= frequency[other[-1]])]
        if 2 * len(common) >= len(one) and (amplitude[one].any() or amplitude[other].any()):
            at = frequency[common], frequency[other]
            for steps, log in zip((pushed, moved), columns, strict=True):
                steps[i, j] = np.median(np.interp(*at, log[other]) - log[common])
                steps[j, i] = -steps[i, j]
    return pushed, moved


def responses_of_others(
    level: Array,
    sweep: NDArray[np.str_],
    frequency: Array,
    force: ComplexArray,
    response: ComplexArray,
    factors: Mapping[str, float],
) -> list[Finding]:
    """Return a finding if levels have not their own responses, or one has another unit; none or one.

    At one frequency a stable motion grows with the force: d|F|/dX > 0, and friction holds no level above one
    that moves. Between levels of 220 virtual and five measured tests log X rose by 0.35 of log F or more.

    Parameters
    ----------
    level, sweep, frequency, force, response
        (n,) of each point, in N, Hz, N, m; a response of round-off or noise is one at rest.
    factors
        By which units differ, with their names.
    """
    noise, size = levels_in_noise(level, sweep, frequency, response / force), np.abs(response)
    amplitude = np.where(noise | (size <= ROUND_OFF * size.max()), 0.0, size)
    pushed, moved = _steps(level, frequency, np.abs(force), amplitude)
    compared = np.abs(pushed) > RELATIVE_ERROR_DOUBTFUL
    falls = compared & (moved * np.sign(pushed) < -0.5 * np.fmax(np.abs(pushed), np.log(LEVEL_TOLERANCE)))
    if not falls.any():
        return []
    levels = np.unique(level)
    a, b, mends = _exchanged_levels(pushed, moved, compared, falls)
    alike = mends and abs(moved + pushed)[a, b] < np.log(LEVEL_TOLERANCE)
    if found := _level_in_other_unit(levels, moved - pushed, factors, 2 if alike else 1):
        return found
    numbers = quantities("N", low=levels[a], high=levels[b])
    numbers |= quantities(pushed=np.exp(pushed[a, b]), moved=np.exp(moved[a, b]))
    return [Finding("levels-swapped", "doubt", "", numbers, {} if mends else {"mends": "no"})]


def _exchanged_levels(
    pushed: Array, moved: Array, compared: NDArray[np.bool_], falls: NDArray[np.bool_]
) -> tuple[int, int, bool]:
    """Return the places of two levels, and whether the response rises everywhere with each other's responses.

    The steps (k, k) between levels that are ``compared`` have to rise; in those of ``falls`` they do not. Of
    several pairs the two levels are those whose responses per force are the most equal once exchanged.
    """
    pairs = np.argwhere(np.triu(falls))
    pairs = pairs[np.argsort(np.abs(moved + pushed)[tuple(pairs.T)])]
    # one exchange changes the steps of two levels alone
    for pair in pairs if len(pairs) < 2 * len(falls) else ():
        order = np.arange(len(falls))
        order[pair] = pair[::-1]
        exchanged = moved[np.ix_(order, order)]
        if not np.any(compared & (exchanged * pushed < 0.3 * pushed**2)):
            return int(pair[0]), int(pair[1]), True
    return int(pairs[0, 0]), int(pairs[0, 1]), False


def _level_in_other_unit(
    levels: Array, gains: Array, factors: Mapping[str, float], least: int
) -> list[Finding]:
    """Return a finding if the response per force of one level is a factor times that of all others, or less.

    Steps ``gains`` (k, k) are those of the logarithm of the response per force. The others are at ``least``
    so many: of two levels that were exchanged each differs from the other by the square of what it differs
    by from a third.
    """
    known = np.isfinite(gains) & ~np.eye(len(levels), dtype=bool)
    enough = known.sum(axis=1) >= least
    for near, by in factors.items():
        larger = known & (np.abs(-gains / np.log(by) - 1) < 1 / 8)
        for differing in (larger, larger.T):
            alone = enough & (differing == known).all(axis=1)
            if alone.any():
                at = int(np.argmax(alone))
                numbers = quantities("N", level=levels[at])
                numbers |= quantities(gain=np.exp(-np.median(gains[at, known[at]])))
                return [Finding("levels-disagree", "doubt", "", numbers, {"near": near})]
    return []
