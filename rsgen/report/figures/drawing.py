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
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from rsgen.common.arrays import Array
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


# ----------------------------------------------------------------------------
# The layout of a figure: panels one below the other, colour bars right of them, a heading above.

_PAD = 3.0
"""Points between what a panel shows and its neighbours, and around the figure: the gap between two words."""

_BAR_GAP = 0.02
"""Of the panels' width, between them and the scale of their colours: enough to see that they are two."""

_BAR_LABEL = "<colorbar>"
"""How matplotlib labels the axes of a scale of colours."""

_PASSES = 2
"""The second one only where other ticks came out of the first: other ticks have other labels."""

_TICK = 3.5
"""Points of a tick mark; a panel whose ticks have no numbers needs room for the marks all the same."""

_LINE = 12.7
"""Points of a line of text, for a guess: so near to what is measured that the ticks stay as they are."""

_LEFT = 38.0
"""Points of the numbers and the label of an ordinate, for that guess."""


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """Room that decorations take, in pixels: above and below each panel, left and right of all of them.

    Parameters
    ----------
    above, below
        (n,) of each panel, from the uppermost down.
    left, right
        Of the panels.
    scale
        Right of the scale of colours, without the scale itself.
    heading
        From the upper edge of the figure.
    """

    above: Array
    below: Array
    left: float
    right: float
    scale: float
    heading: float


def lay_out(figure: Figure) -> None:
    """Place the panels of a figure that were made as subplots; axes that have a place of their own keep it.

    All panels have the same size. Labels, ticks and titles are measured; legends lie inside their panels.
    """
    panels = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    bars = [axes for axes in figure.axes if axes.get_label() == _BAR_LABEL]
    if not panels:
        return
    # the canvas of every figure of ours; its functions have no types
    canvas: Any = figure.canvas
    renderer: RendererBase = canvas.get_renderer()
    points = figure.dpi / 72
    pad = _PAD * points
    heading = 0.0
    for text in figure.texts:
        text.set_y(1 - pad / figure.bbox.height)
        heading = max(heading, text.get_window_extent(renderer).height + 2 * pad)
    _place(figure, panels, bars, _guessed(panels, points, heading), pad)
    for _ in range(_PASSES):
        ticks = _ticks(panels)
        around = _measured(panels, bars, renderer, points, heading)
        labels = [_label_places(axes) for axes in (*panels, *bars)]
        _place(figure, panels, bars, around, pad)
        if _ticks(panels) == ticks:
            break
    for axes, (right, below) in zip((*panels, *bars), labels, strict=True):
        # drawing would look for them again each time, by measuring all numbers of the axis
        axes.yaxis.set_label_coords(_is_right(axes) + right / axes.bbox.width, 0.5)
        axes.xaxis.set_label_coords(0.5, below / axes.bbox.height)


def _is_right(axes: Axes) -> bool:
    # its type names the places of an abscissa
    return str(axes.yaxis.get_label_position()) == "right"


def _label_places(axes: Axes) -> tuple[float, float]:
    """Pixels by which the ordinate's label is right of its edge, and the abscissa's above its own."""
    right, below = axes.yaxis.label.get_position()[0], axes.xaxis.label.get_position()[1]
    return float(right - (axes.bbox.x1 if _is_right(axes) else axes.bbox.x0)), float(below - axes.bbox.y0)


def _ticks(panels: Sequence[Axes]) -> list[list[float]]:
    return [axis.get_majorticklocs().tolist() for axes in panels for axis in (axes.xaxis, axes.yaxis)]


def _guessed(panels: Sequence[Axes], points: float, heading: float) -> _Around:
    """Guess what decorations take, from the texts that there are; ``points`` has the pixels of one."""
    shown = [axes.xaxis.get_tick_params().get("labelbottom", True) for axes in panels]
    lines = np.array([has + bool(axes.get_xlabel()) for has, axes in zip(shown, panels, strict=True)])
    titles = np.array([bool(axes.get_title("left")) for axes in panels])
    below, above = points * (_TICK + _LINE * lines), points * _LINE * titles
    return _Around(above, below, points * _LEFT, 0.0, points * _LEFT, heading)


def _measured(
    panels: Sequence[Axes], bars: Sequence[Axes], renderer: RendererBase, points: float, heading: float
) -> _Around:
    """Measure how far the decorations reach beyond the panels, with 0 where they do not."""
    left, below, right, above = np.array([_beyond(axes, renderer) for axes in panels]).T
    below = np.maximum(below, _TICK * points)
    scale = 0.0
    for axes in bars:
        _, under, scale, over = _beyond(axes, renderer)
        above[0], below[-1] = max(above[0], over), max(below[-1], under)
    return _Around(above, below, float(left.max()), float(right.max()), scale, heading)


def _beyond(axes: Axes, renderer: RendererBase) -> tuple[float, float, float, float]:
    """Pixels by which what an axes shows reaches beyond it: left, below, right, above."""
    texts = [artist for artist in axes.get_default_bbox_extra_artists() if isinstance(artist, Text)]
    inner = axes.get_window_extent(renderer)
    outer = axes.get_tightbbox(renderer, bbox_extra_artists=texts, for_layout_only=True)
    if outer is None:
        return 0.0, 0.0, 0.0, 0.0
    return inner.x0 - outer.x0, inner.y0 - outer.y0, outer.x1 - inner.x1, outer.y1 - inner.y1


def _place(figure: Figure, panels: Sequence[Axes], bars: Sequence[Axes], around: _Around, pad: float) -> None:
    """Return panels and scale the room that their decorations leave."""
    width, height = figure.bbox.width, figure.bbox.height
    room = height - around.heading - float(np.sum(around.above + around.below)) - 2 * pad * len(panels)
    each = room / len(panels)
    edges = height - around.heading - np.cumsum(around.above + each + around.below + 2 * pad)
    bottoms = edges + around.below + pad
    lowest, highest = float(bottoms[-1]), float(bottoms[0]) + each
    thick = max((float((highest - lowest) / (axes.get_box_aspect() or 1)) for axes in bars), default=0.0)
    # the gap is a share of the panels' width, which is what all else leaves
    panel = width - 2 * pad - around.left - around.right - thick - around.scale
    panel /= 1 + (_BAR_GAP if bars else 0.0)
    if min(each, panel) <= 0:
        # labels and heading leave no room: overlapping panels show more than none
        return
    left = pad + around.left
    places = [(left, float(bottom), panel, each) for bottom in bottoms]
    start = left + panel * (1 + _BAR_GAP) + around.right
    places += [(start, lowest, thick, highest - lowest)] * len(bars)
    for axes, (x, y, wide, high) in zip((*panels, *bars), places, strict=True):
        axes.set_position((x / width, y / height, wide / width, high / height))
        # matplotlib leaves axes that were placed out of the box that a tight figure has
        axes.set_in_layout(True)


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
        The matplotlib figure; panels and labels stay where they are when something in it is changed.
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
        # once: a figure that is laid out anew at each saving creeps by fractions of a point
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
