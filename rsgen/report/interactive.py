"""A page to turn the response surface and read values; plotly draws it, from inside the file."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

import rsgen
from rsgen.common.errors import RsgenError
from rsgen.data.surface import ResponseSurface, load_surface
from rsgen.formula.units.quantities import SWEEPS, choose_scale
from rsgen.report.figures.overview import largest_answer
from rsgen.report.provenance import page_environment
from rsgen.report.result_json import read_result

__all__ = ["render_interactive"]

_DIGITS = 6


def _plotly() -> str:
    """Give the source of plotly.js that the Python package carries."""
    try:
        return str(importlib.import_module("plotly.offline").get_plotlyjs())
    except ImportError:
        raise RsgenError('plotly is not installed; get it by: pip install "rsgen[show]"') from None


def _rounded(values: Any) -> Any:
    return [None if not np.isfinite(value) else float(f"{value:.{_DIGITS}g}") for value in values]


def _traces(surface: ResponseSurface) -> tuple[list[dict[str, Any]], dict[str, str]]:
    amplitude = choose_scale(surface.answer[surface.settled], surface.answer_unit)
    force = choose_scale(surface.level, surface.level_unit)
    held, found = ("X", "F") if surface.response_held else ("F", "X")
    axes = {
        "x": "Frequency [Hz]",
        "y": force.label(f"Level {held}"),
        "z": amplitude.label("Amplitude X" if found == "X" else "Force F"),
    }
    colour = {"colorscale": "Viridis", "cmin": 0, "cmax": largest_answer(surface) / amplitude.factor}
    hover = (
        f"%{{x:.5g}} Hz<br>{held} = %{{y:.4g}} {force.unit}<br>{found} = %{{z:.5g}} {amplitude.unit}"
        "<br>phase = %{customdata:.4g} °"
    )
    traces: list[dict[str, Any]] = []
    for sweep, words in SWEEPS.items():
        part = surface.select((surface.sweep == sweep) & surface.settled)
        rows = [np.flatnonzero(part.level == level) for level in part.levels]
        rows = [index[np.argsort(part.frequency[index], kind="stable")] for index in rows]
        grid = len(rows) > 1 and all(
            len(index) == len(rows[0]) and np.array_equal(part.frequency[index], part.frequency[rows[0]])
            for index in rows
        )
        height, lag = part.answer / amplitude.factor, np.degrees(part.phase)
        if grid:
            traces.append(
                {
                    "type": "surface",
                    "name": words,
                    "showlegend": True,
                    "x": _rounded(part.frequency[rows[0]]),
                    "y": _rounded(part.levels / force.factor),
                    "z": [_rounded(height[index]) for index in rows],
                    "customdata": [_rounded(lag[index]) for index in rows],
                    "showscale": not traces,
                    "colorbar": {"title": {"text": axes["z"]}},
                    "hovertemplate": hover,
                    **colour,
                }
            )
            continue
        for number, index in enumerate(rows):
            traces.append(
                {
                    "type": "scatter3d",
                    "mode": "lines+markers",
                    # one entry of the legend shows or hides all levels of a sweep
                    "name": words,
                    "legendgroup": sweep,
                    "showlegend": number == 0,
                    "x": _rounded(part.frequency[index]),
                    "y": _rounded(part.level[index] / force.factor),
                    "z": _rounded(height[index]),
                    "customdata": _rounded(lag[index]),
                    "hovertemplate": hover,
                    "marker": {"size": 2, "color": _rounded(height[index]), **colour},
                    "line": {"width": 3, "color": _rounded(height[index]), **colour},
                }
            )
    return traces, axes


def render_interactive(folder: str | Path) -> str:
    """Render the page of one result: one file of about 5 MB with a script inside, no network.

    Parameters
    ----------
    folder
        ``reports/<case>``, where a run has left surface.h5 and result.json.

    Raises
    ------
    RsgenError
        There is no result, its surface cannot be read, or plotly is not installed.
    """
    place = Path(folder)
    entry = read_result(place / "result.json")
    if entry is None:
        raise RsgenError(f"{place}: holds no result of rsgen; give reports/<case>")
    if "multisine" in entry.result:
        raise RsgenError(
            f"{place}: a multisine has no response surface to turn; its report.html has all figures"
        )
    source = _plotly()
    traces, axes = _traces(load_surface(place / "surface.h5"))
    data = json.dumps({"traces": traces, "axes": axes}, allow_nan=False)
    # inside a script element only its end tag and comments mean anything to HTML
    data = data.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    context = {
        "title": entry.result["title"],
        "verdict": entry.verdict["headline"],
        "plotly": Markup(source.replace("</script", "<\\/script")),  # noqa: S704 - the package's own source
        "data": Markup(data),  # noqa: S704 - JSON without a "<"
        "version": rsgen.__version__,
    }
    return page_environment().get_template("report/interactive.html").render(context)
