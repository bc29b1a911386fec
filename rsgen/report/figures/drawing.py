"""A figure together with its caption and with what it shows in words and numbers."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from rsgen.common.errors import RsgenError, require
from rsgen.data.surface import ResponseSurface
from rsgen.describing import DescribingFunction
from rsgen.identification.modal_result import ModalTable
from rsgen.identification.prediction import Prediction
from rsgen.identification.results import Identification

# Okabe and Ito's colours, which colour-blind readers distinguish; line styles distinguish them in grey
POINT: dict[str, Any] = {"marker": "o", "ls": "none", "mfc": "none", "mec": "#0072B2", "mew": 1.1, "ms": 4.5}
REFINED: dict[str, Any] = {"color": "#D55E00", "lw": 1.5, "ls": "-"}
FIRST_ORDER: dict[str, Any] = {"color": "#009E73", "lw": 1.2, "ls": (0, (6, 1.5, 1, 1.5))}
TRUTH: dict[str, Any] = {"color": "#1b1c1e", "lw": 1.2, "ls": (0, (1, 1.6))}


def lay_out(figure: Figure) -> None:
    """Place panels made as subplots by matplotlib's constrained layout, once: laid out anew they creep."""
    # axes that were given their place keep it
    if any(axes.get_subplotspec() is not None for axes in figure.axes):
        ConstrainedLayoutEngine().execute(figure)


STYLE = Path(__file__).with_name("rsgen.mplstyle")
"""The style file of the project; ``matplotlib.style.use(rsgen.report.figures.STYLE)`` takes it over."""

P = ParamSpec("P")
R = TypeVar("R")

_KINDS = {
    "function": DescribingFunction,
    "identification": Identification,
    "prediction": Prediction,
    "surface": ResponseSurface,
    "table": ModalTable,
}
"""Type of each argument of a drawing function, by name."""

# no date, no version: the same figure gives the same bytes
_NO_METADATA = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
}


_styled: list[None] = []
"""An entry for each block that draws in the project's style now; the settings are those of a process."""


@contextmanager
def project_style() -> Iterator[None]:
    """Draw in the project's style; a block inside another changes nothing, which settings cost time to do."""
    with nullcontext() if _styled else matplotlib.style.context(STYLE, after_reset=True):
        _styled.append(None)
        try:
            yield
        finally:
            _styled.pop()


def in_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function under the style file of the project; axes of the caller keep the caller's."""

    wanted = [_KINDS.get(name) for name in signature(draw).parameters]

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        for value, kind in zip(args, wanted, strict=False):
            if kind is not None:
                require(value, kind, draw.__name__)
        with project_style() if kwargs.get("ax") is None else nullcontext():
            return draw(*args, **kwargs)

    return styled


def new_figure(width: float = 4.4, height: float = 3.3) -> Figure:
    """Make a figure [inches] that belongs to no window and no global list."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


POINTS = 240
"""Points of a curve: no corner of it can be seen."""

GivenAxes = Axes | Sequence[Axes] | NDArray[Any] | None
"""Axes to draw on: one for each panel of the figure; fewer show the first panels, None makes a figure."""


def take_axes(
    ax: GivenAxes, count: int, size: tuple[float, float], **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Return the axes of ``count`` panels, one below the other: the caller's, or those of a new figure.

    Parameters
    ----------
    size
        Width and height of the new figure [inches].
    shared
        For ``Figure.subplots``.

    Raises
    ------
    RsgenError
        What was given is no axes.
    """
    if ax is None:
        figure = new_figure(*size)
        return figure, list(figure.subplots(count, 1, squeeze=False, **shared)[:, 0])
    given = [ax] if isinstance(ax, Axes) else list(np.ravel(np.asarray(ax, dtype=object)))
    if not given or not all(isinstance(axes, Axes) for axes in given):
        raise RsgenError(f"ax: {ax!r:.80}; must be matplotlib axes, one for each panel")
    return cast(Figure, given[0].figure), given[:count]


def label_abscissa(panels: Sequence[Axes], ax: GivenAxes, text: str) -> None:
    """Label the abscissa of the lowest panel; of all panels where the caller gave axes that share none."""
    for axes in panels[-1:] if ax is None else panels:
        axes.set_xlabel(text)


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """A finished figure; a notebook shows it by itself, ``figure`` is there to be changed.

    Parameters
    ----------
    name
        Short identifier, lower case and hyphens; stable, so that pages can link to it.
    figure
        The matplotlib figure; panels stay where they are when something in it is changed.
    caption
        One sentence: what to look at.
    alternative
        What the figure shows, in numbers, for readers who do not see it.
    whole
        False where it was drawn on axes of the caller, who then lays out and shows the figure.
    """

    name: str
    figure: Figure
    caption: str
    alternative: str
    whole: bool = True

    def __post_init__(self) -> None:
        if self.whole:
            with project_style():
                lay_out(self.figure)

    def render(self, kind: str = "svg") -> bytes:
        """Return the file content, the same bytes for the same figure.

        Parameters
        ----------
        kind
            "svg", "png" or "pdf". Dense clouds are raster images inside the vector formats.
        """
        buffer = io.BytesIO()
        metadata: dict[str, Any] = dict(_NO_METADATA.get(kind, {"CreationDate": None}))
        with project_style():
            self.figure.savefig(buffer, format=kind, metadata=metadata)
        return buffer.getvalue()

    def _repr_mimebundle_(
        self, include: object = None, exclude: object = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        if not self.whole:
            return {"text/plain": self.alternative}, {}
        return {"image/png": self.render("png"), "text/plain": self.alternative}, {
            "image/png": {"alt": self.alternative}
        }
