"""Trees of results: the numbers of an array, a surface, an identification that pins keep."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import rsgen
from rsgen.common.finding import Finding
from rsgen.identification.results import Background, Estimate
from tests.pins.pinned import Tree

ENTRIES = 3
"""Of an array, evenly over its length; its root mean square sees what moves the others."""


def series(values: ArrayLike, scale: float | None = None, entries: int = ENTRIES) -> Tree:
    """Count, root mean square and some entries of an array; of truths how many hold, of texts how often.

    Where some entries are not finite, those that are finite are counted, too. Entries are compared relative
    to the root mean square, or to ``scale`` where that is given.
    """
    array = np.asarray(values)
    if array.dtype.kind in "US":
        return dict(sorted(Counter(array.ravel().tolist()).items()))
    if array.dtype.kind in "bi":
        return {"count": array.size, "sum": int(array.sum())}
    flat = array.ravel()
    size = np.abs(flat[np.isfinite(flat)])
    # no ends: they say least of a resonance
    places = np.unique(np.linspace(-0.5, len(flat) - 0.5, entries + 2)[1:-1].round().astype(int))
    at = {str(i): flat[i] if np.isfinite(flat[i]) else None for i in places if i < len(flat)}
    return {
        "count": len(flat) if len(size) == len(flat) else [len(flat), len(size)],
        "rms": float(np.sqrt(np.mean(size**2))) if len(size) else 0.0,
        **({} if scale is None else {"scale": scale}),
        **({"at": at} if at else {}),
    }


def parts(
    of: Any, plain: str = "", arrays: str = "", scale: float | None = None, entries: int = ENTRIES
) -> Tree:
    """Attributes of a result by their names: numbers and texts as they are, arrays as ``series``."""
    found = {name: getattr(of, name) for name in plain.split()}
    return found | {name: series(getattr(of, name), scale, entries) for name in arrays.split()}


def columns(harmonics: NDArray[Any], entries: int = ENTRIES) -> Tree:
    """The mean and three harmonics (n, H+1) one by one; all are compared to the fundamental."""
    scale = float(np.sqrt(np.nanmean(np.abs(harmonics[:, 1]) ** 2)))
    whole = {"1": series(harmonics[:, 1], entries=entries)}
    for order in (0, *range(2, min(harmonics.shape[1], 4))):
        # exact zeros need no entries
        column = harmonics[:, order]
        whole[str(order)] = series(column, scale, 0) if column.any() else 0
    return whole


def findings(found: Iterable[Finding]) -> Tree:
    return [" ".join(filter(None, (f.code, f.severity, f.parameter))) for f in found]


def surface(table: rsgen.ResponseSurface) -> Tree:
    given = {
        **parts(table, "", "level frequency force peak", entries=1),
        **parts(table, "", "sweep outcome stable"),
        "harmonics": columns(table.harmonics), "findings": findings(table.findings),
        "words": [table.origin, table.control, table.base],
        "known": {"per_mass": table.per_mass, "phase": table.phase_known},
    }  # fmt: skip
    if table.force_harmonics.shape[1] > 2:
        given["force_harmonics"] = columns(table.force_harmonics, 2)
    if table.across.shape[1]:
        given["across"] = columns(table.across, 2)
    return given


def plain_estimates(several: Iterable[Estimate]) -> Tree:
    return {one.name: parts(one, "value standard_error") for one in several}


def estimates(several: Iterable[Estimate], *, whole: bool = False) -> Tree:
    found = plain_estimates(several := list(several))
    for one in several:
        ends = {"lower": one.interval[0], "upper": one.interval[1], "unit": one.unit} if whole else {}
        found[one.name] |= ends | ({"finding": one.finding.code} if one.finding else {})
    return found


def background(found: Background | None) -> Tree:
    if found is None:
        return None
    return {"kind": found.kind, "estimates": estimates(found.estimates), "share": found.share}


def identification(found: rsgen.Identification) -> Tree:
    """What an identification says first: values with intervals, verdict, and what the fit leaves."""
    numbers = found.outcome.numbers
    beside = {} if found.background is None else {"background": background(found.background)}
    return {
        "refined": estimates(found.refined), **parts(found, "residual noise mass"), **beside,
        "verdict": found.verdict.state, "findings": findings(found.findings),
        "outcome": " ".join(f"{name} {each.value:g}" for name, each in numbers.items() if name != "misfit"),
    }  # fmt: skip


def fitted(table: Any, law: Any, *about: rsgen.Observation, mass: float | None = None) -> Tree:
    return identification(rsgen.identify(table, law, *about, mass=mass))


def whole_identification(found: rsgen.Identification) -> Tree:
    """All parts of an identification, with resonances, equivalent curves and forces without a law."""
    tree = identification(found) | {
        "refined": estimates(found.refined, whole=True), "first_order": plain_estimates(found.first_order),
        "paper": plain_estimates(found.paper), "levels": series(found.levels),
        "amplitude_range": list(map(float, found.amplitude_range)),
        "frequency_range": list(map(float, found.frequency_range)),
        **parts(found.curve, "", "stiffness damping used"),
        "correlation": series(_correlation(found.covariance)),
        "resonances": [
            parts(one, "level frequency damping_ratio amplitude stiffness damping jump")
            for one in found.resonances[:3]
        ],
    }  # fmt: skip
    return tree | (parts(found.restoring, "", "stiffness_force damping_force") if found.restoring else {})


def _correlation(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances of values in their standard errors: what one scale suits."""
    error = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(error, error))
