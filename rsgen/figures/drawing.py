"""A figure together with its caption and with what it shows in words and numbers."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib
import matplotlib.style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

__all__ = ["STYLE", "Drawing", "in_style", "new_figure"]

STYLE = Path(__file__).with_name("rsgen.mplstyle")
"""The style file of the project; ``matplotlib.style.use(rsgen.figures.STYLE)`` takes it over."""

P = ParamSpec("P")
R = TypeVar("R")

# no date, no version: the same figure gives the same bytes
_NO_METADATA = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
}


@contextmanager
def _style() -> Iterator[None]:
    with matplotlib.style.context(STYLE, after_reset=True):
        yield


def in_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function under the style file of the project, whatever the caller's settings are."""

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        with _style():
            return draw(*args, **kwargs)

    return styled


def new_figure(width: float = 4.4, height: float = 3.3, layout: str | None = "constrained") -> Figure:
    """Make a figure [inches] that belongs to no window and no global list."""
    figure = Figure(figsize=(width, height))
    if layout == "constrained":
        figure.set_layout_engine("constrained")
    FigureCanvasAgg(figure)
    return figure


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """A finished figure; a notebook shows it by itself, ``figure`` is for whoever wants to change it.

    Parameters
    ----------
    name
        Short identifier, lower case and hyphens; stable, so that pages can link to it.
    figure
        The matplotlib figure.
    caption
        One sentence: what to look at.
    alternative
        What the figure shows, in numbers, for readers who do not see it.
    """

    name: str
    figure: Figure
    caption: str
    alternative: str

    def __post_init__(self) -> None:
        # the layout is made once: made anew at each saving it would creep by fractions of a point
        with _style():
            self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")

    def render(self, kind: str = "svg") -> bytes:
        """Give the file content, the same bytes for the same figure.

        Parameters
        ----------
        kind
            "svg", "png" or "pdf". Dense clouds are raster images inside the vector formats.
        """
        buffer = io.BytesIO()
        metadata: dict[str, Any] = dict(_NO_METADATA.get(kind, {"CreationDate": None}))
        with _style():
            self.figure.savefig(buffer, format=kind, metadata=metadata)
        return buffer.getvalue()

    def _repr_mimebundle_(
        self, include: object = None, exclude: object = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"image/png": self.render("png"), "text/plain": self.alternative}, {
            "image/png": {"alt": self.alternative}
        }
