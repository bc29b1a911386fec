"""A figure with its caption and what it shows in words; colours of levels, and the surface itself."""

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
import matplotlib.ticker
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import TightLayoutEngine
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError, require
from rsgen.data.surface.mode_findings import force_changes
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.describing.function import DescribingFunction
from rsgen.formula.units import SWEEPS, choose_scale, number_text, quantity_text
from rsgen.identification.modal_result import ModalTable
from rsgen.identification.prediction import Prediction
from rsgen.identification.results import Identification, MultisineIdentification
from rsgen.report.sentences import surface_sentence

# Okabe and Ito's colours, which colour-blind readers distinguish; line styles distinguish them in grey
BLUE = "#0072B2"
ORANGE = "#D55E00"
POINT: dict[str, Any] = {"marker": "o", "ls": "none", "mfc": "none", "mec": BLUE, "mew": 1.1, "ms": 4.5}
REFINED: dict[str, Any] = {"color": ORANGE, "lw": 1.5, "ls": "-"}
TRUTH: dict[str, Any] = {"color": "#1b1c1e", "lw": 1.2, "ls": (0, (1, 1.6))}


def lay_out(figure: Figure) -> None:
    """Place panels made as subplots by matplotlib's tight layout, once."""
    # axes that were given their place keep it
    if any(axes.get_subplotspec() is not None for axes in figure.axes):
        # given no rectangle it measures all texts once, not twice, for the same places
        TightLayoutEngine(pad=0.4, rect=cast(Any, None)).execute(figure)


STYLE = Path(__file__).with_name("rsgen.mplstyle")
"""The style file of the project; ``matplotlib.style.use(rsgen.report.figures.STYLE)`` takes it over."""

P = ParamSpec("P")
R = TypeVar("R")

_KINDS = {
    "found": MultisineIdentification,
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


_SETTINGS: Any = {
    name: value for name, value in matplotlib.rc_params_from_file(STYLE).items() if name != "backend"
}
"""Those of the style file, and matplotlib's defaults of all others."""

_styled: list[None] = []
"""An entry for each block that draws in the project's style now; the settings are those of a process."""


@contextmanager
def project_style() -> Iterator[None]:
    """Draw in the project's style; a block inside another changes nothing, which settings cost time to do."""
    with nullcontext() if _styled else matplotlib.rc_context(_SETTINGS):
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


_MAX_TICKS_OF_LEVELS = 4
"""Intervals between ticks of a colour bar; a panel has at most twice as many."""


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
        panels = list(figure.subplots(count, 1, squeeze=False, **shared)[:, 0])
        for axes in panels:
            # ticks that came after the layout, with more digits, moved titles beyond the edge
            axes.locator_params(axis="y", nbins=2 * _MAX_TICKS_OF_LEVELS)
        return figure, panels
    given = [ax] if isinstance(ax, Axes) else list(np.ravel(np.asarray(ax, dtype=object)))
    if not given or not all(isinstance(axes, Axes) for axes in given):
        raise RsgenError(f"ax: {ax!r:.80}; must be matplotlib axes, one for each panel")
    return cast(Figure, given[0].figure), given[:count]


def label_abscissa(panels: Sequence[Axes], ax: GivenAxes, text: str) -> None:
    """Label the abscissa of the lowest panel; of all panels where the caller gave axes that share none."""
    for axes in panels[-1:] if ax is None else panels:
        axes.set_xlabel(text)


def _course(name: str, x: ArrayLike, y: ArrayLike) -> str:
    """Say where a line begins, ends and is highest."""
    place, height = (np.asarray(values, dtype=np.float64) for values in (x, y))
    known = np.isfinite(place) & np.isfinite(height)
    if not known.any():
        return f"{name}: not known"
    points = list(zip(place[known].tolist(), height[known].tolist(), strict=True))
    ends = dict.fromkeys((points[0], points[-1]))
    text = " to ".join(f"{number_text(at[1])} at {number_text(at[0], 5)}" for at in ends)
    top = max(points, key=lambda at: at[1])
    highest = "" if top in ends else f", highest {number_text(top[1])} at {number_text(top[0], 5)}"
    return f"{name}: {text}{highest}"


def in_numbers(figure: Figure) -> str:
    """Say what a figure shows, for readers who do not see it: the course of each line of its legends.

    Of panels without a legend every line is said. Parts of a line are named as it is, after an underscore.
    """
    said = []
    for axes in figure.axes:
        lines = {line: str(line.get_label()) for line in axes.get_lines()}
        named = {line: label for line, label in lines.items() if not label.startswith("_")}
        courses = []
        for line, label in named.items():
            parts = (line, *(one for one in lines if lines[one] == f"_{label}"))
            courses.append(
                _course(label, *np.concatenate([np.array(one.get_data()) for one in parts], axis=1))
            )
        courses = courses or [_course("line", *line.get_data()) for line in lines]
        if courses:
            over = " over ".join(filter(None, [axes.get_ylabel(), axes.get_xlabel()]))
            said.append(f"{axes.get_title(loc='left')} {over}: {'; '.join(courses)}.".strip())
    return " ".join(said) or "0 values are known."


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
    whole
        False where it was drawn on axes of the caller, who then lays out and shows the figure.
    alternative
        What the figure shows, in numbers, for readers who do not see it; "": the course of its lines.
    """

    name: str
    figure: Figure
    caption: str
    whole: bool = True
    alternative: str = ""

    def __post_init__(self) -> None:
        if not self.alternative:
            object.__setattr__(self, "alternative", in_numbers(self.figure))
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

    def _repr_mimebundle_(self, **wanted: object) -> tuple[dict[str, Any], dict[str, Any]]:
        shown: dict[str, Any] = {"text/plain": self.alternative}
        if not self.whole:
            return shown, {}
        return {"image/png": self.render("png"), **shown}, {"image/png": {"alt": self.alternative}}


# ----------------------------------------------------------------------------
# The response surface itself: amplitude over frequency and level, in three dimensions.


def level_colours() -> LinearSegmentedColormap:
    """The colours of levels and amplitudes: viridis without its darkest and palest ends.

    Its lightness rises evenly, so that it survives grey print, and both ends stand out from light and dark
    paper.
    """
    viridis = matplotlib.colormaps["viridis"]
    return LinearSegmentedColormap.from_list("rsgen", viridis(np.linspace(0.12, 0.92, 64)))


def colour_bar(axes: Axes, norm: Normalize, label: str) -> None:
    """Add a colour bar right of a panel."""
    place, colours = axes.inset_axes((1.03, 0, 0.03, 1)), ScalarMappable(norm, level_colours())
    # a number of ticks that does not depend on the height, which the layout changes after it measured them
    bar = axes.figure.colorbar(colours, cax=place, ticks=matplotlib.ticker.MaxNLocator(_MAX_TICKS_OF_LEVELS))
    bar.set_label(label)
    bar.outline.set_visible(False)
    if bar.solids is not None:
        bar.solids.set_rasterized(True)


def largest_answer(surface: ResponseSurface) -> float:
    """Return the largest settled answer, SI; 1 where there is none, so that scales have an end."""
    return float(np.max(surface.answer, where=surface.settled, initial=0.0)) or 1.0


def level_word(surface: ResponseSurface) -> str:
    """Name the levels of a test: forces, amplitudes that were held, or those of a driven base, no force."""
    if surface.response_held:
        return "Level X"
    return "Level" if surface.base else "Level F"


def _answer_word(surface: ResponseSurface) -> str:
    return "Force F" if surface.response_held else "Amplitude X"


def _what(surface: ResponseSurface, words: str) -> str:
    if surface.response_held:
        return "force that holds the amplitude of the fundamental"
    return f"amplitude of the fundamental, {words}"


def _grid(surface: ResponseSurface) -> tuple[Array, Array, Array] | None:
    """Return frequency, level (both 1-D) and answer (level x frequency) where the points fill a grid."""
    level, frequency = np.unique(surface.level), np.unique(surface.frequency)
    if len(level) < 2 or len(frequency) < 2 or len(surface) != len(level) * len(frequency):
        return None
    amplitude = np.full((len(level), len(frequency)), np.nan)
    rows, columns = np.searchsorted(level, surface.level), np.searchsorted(frequency, surface.frequency)
    amplitude[rows, columns] = np.where(surface.settled, surface.answer, np.nan)
    unsettled = int(np.count_nonzero(~surface.settled))
    return (frequency, level, amplitude) if np.isnan(amplitude).sum() == unsettled else None


def peaks_by_level(surface: ResponseSurface) -> list[int]:
    """Return for each level the index of its settled point at resonance, levels ascending.

    It is where the amplitude is largest, or, where the force changes near the resonance, the amplitude per
    force; where the amplitude was held, the force is least.
    """
    peaks, changes = [], force_of_levels_changes(surface)
    for level in surface.levels:
        points = np.flatnonzero((surface.level == level) & surface.settled)
        if points.size:
            answer = surface.answer[points] / (np.abs(surface.force[points]) if changes else 1.0)
            at = np.argmin(answer) if surface.response_held else np.argmax(answer)
            peaks.append(int(points[at]))
    return peaks


def force_of_levels_changes(surface: ResponseSurface) -> bool:
    """Return whether a level has another force near its resonance, as of a shaker without control."""
    if surface.response_held or surface.decays:
        return False
    runs = [(surface.level == level) & surface.settled for level in surface.levels]
    return any(force_changes(surface.amplitude[run], surface.force[run]) for run in runs if run.any())


def _alternative(surface: ResponseSurface) -> str:
    peaks = peaks_by_level(surface)
    if not peaks:
        return "No test point settled, so there is no surface to show."
    extreme = "least force" if surface.response_held else "largest amplitude"
    extreme = "amplitude at the largest response per force" if force_of_levels_changes(surface) else extreme
    low, high = (
        f"{quantity_text(surface.answer[i], surface.answer_unit, 3)} at "
        f"{quantity_text(surface.frequency[i], 'Hz', 5)}"
        for i in (peaks[0], peaks[-1])
    )
    if len(peaks) == 1:
        return f"{surface_sentence(surface)} The {extreme} is {low}."
    shift = surface.frequency[peaks[-1]] / surface.frequency[peaks[0]] - 1
    course = f"it moves by {100 * shift:+.2f} %"
    of_level = (surface.frequency[surface.level == surface.level[i]] for i in (peaks[0], peaks[-1]))
    places = zip(surface.frequency[[peaks[0], peaks[-1]]], of_level, strict=True)
    if any(place in (run.min(), run.max()) for place, run in places if len(run) > 2):
        course = "at the edge of the band, where the resonance lies or beyond which it lies"
    return (
        f"{surface_sentence(surface)} The {extreme} rises from {low} (lowest level) to {high} (highest "
        f"level): {course}."
    )


@in_style
def draw_surface(surface: ResponseSurface, *, ax: Any = None) -> Drawing:
    """Draw the response surface in three dimensions.

    A full grid is drawn as a sheet; points that are no grid, as measured ones are, as one line a level.
    Where both sweeps were made, the sweep up is shown.

    Parameters
    ----------
    surface
        Any surface; points that did not settle leave holes.
    ax
        Axes made with ``projection="3d"``; None makes a figure.

    Raises
    ------
    RsgenError
        The axes are not three-dimensional.
    """
    if ax is None:
        figure = new_figure(4.4, 3.7)
        # matplotlib has no types for its 3-D axes
        axes: Any = figure.add_axes((-0.05, 0.04, 0.96, 0.98), projection="3d")
    else:
        figure, (axes,) = take_axes(ax, 1, (4.4, 3.7))
        if axes.name != "3d":
            raise RsgenError('ax: these axes are flat; make them with projection="3d", or use draw_responses')
    sweep = next(name for name in SWEEPS if np.any(surface.sweep == name))
    shown = surface.select(surface.sweep == sweep)
    scale = choose_scale(shown.answer[shown.settled], shown.answer_unit)
    force = choose_scale(shown.level, shown.level_unit)
    norm, colours = Normalize(0, largest_answer(shown) / scale.factor), level_colours()
    grid = _grid(shown)
    if grid is not None:
        _draw_sheet(axes, *grid, force.factor, scale.factor, lambda height: colours(norm(height)))
    else:
        _draw_levels(axes, shown, force.factor, scale.factor, lambda height: colours(norm(height)))
    axes.set_xlabel("Frequency [Hz]", labelpad=4)
    axes.set_ylabel(force.label(level_word(shown)), labelpad=4)
    axes.set_zlabel(scale.label(_answer_word(shown)), labelpad=2)
    axes.tick_params(pad=0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_facecolor("none")
        axis.set_major_locator(matplotlib.ticker.MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    axes.view_init(elev=28, azim=-58)
    axes.set_box_aspect((1.25, 1.0, 0.8), zoom=1.0)
    reached = "along free decays" if surface.decays else "every point from rest"
    words = reached if sweep == "rest" else SWEEPS[sweep]
    caption = f"Response surface: {_what(shown, words)}."
    return Drawing("surface", figure, caption, ax is None, _alternative(shown))


def _draw_sheet(
    axes: Any,
    frequency: Array,
    level: Array,
    amplitude: Array,
    per_level: float,
    per_height: float,
    colour: Callable[[Any], Any],
) -> None:
    """Draw a full grid of points as a sheet, in the units of the axes."""
    height = amplitude / per_height
    sheet = axes.plot_surface(
        *np.meshgrid(frequency, level / per_level),
        height,
        facecolors=colour(np.nan_to_num(height)),
        rcount=min(60, len(level)),
        ccount=min(120, len(frequency)),
        linewidth=0.15,
        edgecolor=(0.1, 0.1, 0.1, 0.35),
        shade=False,
        antialiased=True,
    )
    sheet.set_rasterized(True)


def _draw_levels(
    axes: Any, shown: ResponseSurface, per_level: float, per_height: float, colour: Callable[[Any], Any]
) -> None:
    """Draw the settled points of each level as a line, in the units of the axes."""
    for value in shown.levels[::-1]:
        line = shown.select((shown.level == value) & shown.settled)
        if not len(line):
            continue
        order = np.argsort(line.frequency, kind="stable")
        height = line.answer[order] / per_height
        axes.plot(
            line.frequency[order],
            line.level[order] / per_level,
            height,
            color=colour(height.max()),
            # one point has no line
            marker="o" if len(line) == 1 else "",
            ms=3,
            lw=1.1,
        )
