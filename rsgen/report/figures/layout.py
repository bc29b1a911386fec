"""The layout of a figure: panels one below the other, colours beside them, a heading above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.text import Text

from rsgen.common.arrays import Array

__all__ = ["lay_out"]

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
    for axes, (beside, below) in zip((*panels, *bars), labels, strict=True):
        # drawing would look for them again each time, by measuring all numbers of the axis
        axes.yaxis.set_label_coords(_is_right(axes) + beside / axes.bbox.width, 0.5)
        axes.xaxis.set_label_coords(0.5, below / axes.bbox.height)


def _is_right(axes: Axes) -> bool:
    # its type names the places of an abscissa
    return str(axes.yaxis.get_label_position()) == "right"


def _label_places(axes: Axes) -> tuple[float, float]:
    """Pixels by which the ordinate's label is right of its edge, and the abscissa's above its own."""
    beside, below = axes.yaxis.label.get_position()[0], axes.xaxis.label.get_position()[1]
    return float(beside - (axes.bbox.x1 if _is_right(axes) else axes.bbox.x0)), float(below - axes.bbox.y0)


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
    """Give panels and scale the room that their decorations leave."""
    width, height = figure.bbox.width, figure.bbox.height
    room = height - around.heading - float(np.sum(around.above + around.below)) - 2 * pad * len(panels)
    each = room / len(panels)
    edges = height - around.heading - np.cumsum(around.above + each + around.below + 2 * pad)
    bottoms = edges + around.below + pad
    lowest, highest = float(bottoms[-1]), float(bottoms[0]) + each
    thick = max((float((highest - lowest) / (axes.get_box_aspect() or 1)) for axes in bars), default=0.0)
    # the gap is a share of the panels' width, which is what all else leaves
    across = width - 2 * pad - around.left - around.right - thick - around.scale
    across /= 1 + (_BAR_GAP if bars else 0.0)
    if min(each, across) <= 0:
        # labels and heading leave no room: overlapping panels show more than none
        return
    left = pad + around.left
    places = [(left, float(bottom), across, each) for bottom in bottoms]
    start = left + across * (1 + _BAR_GAP) + around.right
    places += [(start, lowest, thick, highest - lowest)] * len(bars)
    for axes, (x, y, wide, high) in zip((*panels, *bars), places, strict=True):
        axes.set_position((x / width, y / height, wide / width, high / height))
        # matplotlib leaves axes that were placed out of the box that a tight figure has
        axes.set_in_layout(True)
