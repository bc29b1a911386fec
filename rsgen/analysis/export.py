"""Frequency response functions as a universal file, for the programs of modal analysis.

Source of the format: the published descriptions of universal file data sets 151, "Header", 164, "Units", and
58, "Function at Nodal DOF".
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError, require
from rsgen.common.output import write_atomic
from rsgen.data.surface import ResponseSurface
from rsgen.identification.prediction import Prediction, ResonanceCurve

_LONGEST = 80
"""Characters of a line of text in the format."""
_WIDTH = 13
"""Columns of a frequency; as many digits as fit are written, where the format's own E13.5 has six."""
_MOST_DIGITS = _WIDTH - 2
_FUNCTION, _COMPLEX_DOUBLE, _UNEVEN = 4, 6, 0
_FREQUENCY, _DISPLACEMENT, _FORCE, _NOTHING = 18, 8, 13, 0


@dataclass(frozen=True, slots=True)
class _Function:
    title: str
    frequency: Array
    receptance: ComplexArray


def _measured(surface: ResponseSurface) -> Iterator[_Function]:
    """Return X/F of each level and sweep, frequencies ascending."""
    surface.require_phase("surface", "a frequency response has amplitudes and phases")
    kept = surface.select(surface.settled & (surface.force != 0))
    if not len(kept):
        raise RsgenError("surface: has no settled point under a force; at least one is needed")
    for level in kept.levels:
        for sweep in np.unique(kept.sweep[kept.level == level]):
            run = kept.select((kept.level == level) & (kept.sweep == sweep))
            order = np.argsort(run.frequency, kind="stable")
            title = f"receptance, {level:.6g} {kept.level_unit}, {sweep}, {kept.origin}"
            yield _Function(title, run.frequency[order], (run.harmonics[:, 1] / run.force)[order])


def _parts(curve: ResonanceCurve) -> Iterator[slice]:
    """Cut a curve into stable parts along which the frequency rises or falls."""
    usable = curve.stable & np.isfinite(curve.frequency) & np.isfinite(curve.amplitude)
    turns = np.sign(np.diff(curve.frequency, prepend=np.nan))
    begin = None
    for place in range(len(usable) + 1):
        ends = place == len(usable) or not usable[place]
        if begin is not None and (ends or (place - begin > 1 and turns[place] != turns[place - 1])):
            if place - begin > 1:
                yield slice(begin, place)
            begin = None
        if begin is None and not ends:
            begin = place


def _predicted(prediction: Prediction) -> Iterator[_Function]:
    """Return X/F of each stable part of each resonance curve, frequencies ascending."""
    for curve in prediction.curves:
        for number, part in enumerate(_parts(curve), start=1):
            order = np.argsort(curve.frequency[part], kind="stable")
            response = curve.amplitude[part] * np.exp(-1j * curve.phase[part]) / curve.level
            title = f"receptance, {curve.level:.6g} N, stable part {number}, predicted"
            yield _Function(title, curve.frequency[part][order], response[order])


def _hertz(value: float) -> str:
    """Write a frequency with as many digits as its columns hold."""
    texts = (f"{value:.{digits}g}" for digits in range(_MOST_DIGITS, 0, -1))
    return next(text for text in texts if len(text) < _WIDTH).rjust(_WIDTH)


def _axis(kind: int, label: str = "NONE", unit: str = "NONE") -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20} {unit:<20}"


def _set(number: str, lines: Iterable[str]) -> str:
    return "\n".join(["    -1", f"{number:>6}", *lines, "    -1"]) + "\n"


def _function(function: _Function) -> str:
    if not (np.isfinite(function.frequency).all() and np.isfinite(function.receptance).all()):
        raise RsgenError(f"{function.title}: a number that is not finite; finite ones are needed")
    place = f"{_FUNCTION:5d}{0:10d}{1:5d}{0:10d}" + f" {'NONE':<10}{0:10d}{0:4d}" * 2
    count = f"{_COMPLEX_DOUBLE:10d}{len(function.frequency):10d}{_UNEVEN:10d}" + f"{0.0:13.5E}" * 3
    return _set(
        "58",
        [
            function.title[:_LONGEST], *["NONE"] * 4, place, count,
            _axis(_FREQUENCY, "Frequency", "Hz"),
            _axis(_DISPLACEMENT, "Displacement", "m"),
            _axis(_FORCE, "Excitation force", "N"),
            _axis(_NOTHING),
            *(
                f"{_hertz(f)}{h.real:20.12E}{h.imag:20.12E}"
                for f, h in zip(function.frequency.tolist(), function.receptance.tolist(), strict=True)
            ),
        ],
    )  # fmt: skip


def save_frf(path: str | os.PathLike[str], *results: ResponseSurface | Prediction) -> None:
    """Write receptances X/F as a universal file in SI, atomically: data sets 151, 164, and a 58 for each.

    Of a surface each level and sweep is a function of the frequency, of a prediction each stable part of a
    resonance curve. Where the structure is nonlinear, a function holds at its level alone, which its title
    names.

    Parameters
    ----------
    path
        The file, usually .uff.
    results
        Surfaces and predictions, in the order to write them.

    Raises
    ------
    RsgenError
        Nothing to write, a surface without phases, or the file cannot be written.

    Examples
    --------
    >>> import tempfile, rsgen as rs
    >>> surface = rs.ResponseSurface(2.0, [9, 10, 11], 2.0, [1e-3, 2e-3 - 4e-3j, -1e-3 - 1e-4j])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_frf(f"{folder}/joint.uff", surface)
    """
    if not results:
        raise RsgenError("results: none given; a ResponseSurface or a Prediction is needed")
    functions: list[_Function] = []
    for result in results:
        require(result, (ResponseSurface, Prediction), "results")
        functions += _measured(result) if isinstance(result, ResponseSurface) else _predicted(result)
    if not functions:
        raise RsgenError("results: no stable part of a resonance curve in them; nothing to write")
    header = _set("151", ["NONE", "receptances by level", "rsgen", *["NONE"] * 2, "rsgen", "NONE"])
    factors = "".join(f"{1.0:25.17E}".replace("E", "D") for _ in range(3))
    units = _set(
        "164", [f"{1:10d}{'SI: Meter (newton)':<20}{2:10d}", factors, f"{273.15:25.17E}".replace("E", "D")]
    )
    write_atomic(path, (header + units + "".join(map(_function, functions))).encode("ascii"))
