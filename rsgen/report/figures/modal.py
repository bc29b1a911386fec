"""The modal table as a figure: resonance frequency and damping over the amplitude, without a law."""

from __future__ import annotations

import numpy as np

from rsgen.formula.units.scale import choose_scale, number_text, quantity_text
from rsgen.identification.modal import ModalTable
from rsgen.identification.results import Identification
from rsgen.report.figures.curves import POINT, REFINED
from rsgen.report.figures.drawing import Drawing, GivenAxes, in_style, label_abscissa, take_axes
from rsgen.report.figures.equivalent import backbone, calm_limits, solution_of

__all__ = ["draw_modal"]

_DRAWN = 121
"""Amplitudes of the line: no corner of a curve can be seen."""

_LABELS = {
    "frequency": "Resonance frequency [Hz]",
    "damping_ratio": "Damping ratio [%]",
    "damping": "Damping c",
}
"""Panels: damping ratio where it is known, else the damping itself."""


@in_style
def draw_modal(
    table: ModalTable, identification: Identification | None = None, *, ax: GivenAxes = None
) -> Drawing:
    """Draw resonance frequency and damping ratio over the amplitude, with 95 % bands.

    Parameters
    ----------
    table
        From ``rsgen.modal_table``; no law is in it.
    identification
        Its refined model is drawn beside it: a law that is right lies within the bands.
    ax
        Axes for frequency and damping; None makes a figure.
    """
    grid = np.geomspace(table.amplitude[0], table.amplitude[-1], _DRAWN if len(table) > 1 else 1)
    fine = table.at(grid)
    names = ["frequency", "damping_ratio" if "damping_ratio" in table.known else "damping"]
    names = [name for name in names if name in table.known]
    figure, panels = take_axes(ax, len(names), (4.4, 1.95 * len(names)), sharex=True)
    x = choose_scale(grid, "m")
    model = None
    if identification is not None and len(grid) > 1:
        model = backbone(identification, solution_of(identification), grid)
    for axes, name in zip(panels, names, strict=False):
        value, low, high = (getattr(fine, f"{name}{end}") for end in ("", "_lower", "_upper"))
        scale = choose_scale(value, "N*s/m")
        factor = {"frequency": 1.0, "damping_ratio": 0.01}.get(name, scale.factor)
        axes.fill_between(grid / x.factor, low / factor, high / factor, color="#0072B2", alpha=0.2, lw=0)
        axes.plot(
            grid / x.factor, value / factor, color=POINT["mec"], lw=1.3, label="without a law, 95 % band"
        )
        shown = [value / factor]
        if model is not None:
            line = getattr(model, name) / factor
            shown.append(line)
            axes.plot(
                grid / x.factor, line, label="refined model", **{**REFINED, "lw": 1.1, "ls": (0, (5, 2))}
            )
        calm_limits(axes, shown, least=0.01 if name == "frequency" else 0.2)
        axes.set_ylabel(scale.label(_LABELS[name]) if name == "damping" else _LABELS[name])
    label_abscissa(panels, ax, x.label("Amplitude X"))
    panels[0].legend(loc="best")
    caption = (
        "Modal table: what the points near resonance say of the mode at each amplitude, whatever the law."
    )
    return Drawing("modal", figure, caption, _words(table), ax is None)


def _words(table: ModalTable) -> str:
    first, last = (dict(row) for row in (next(iter(table)), list(table)[-1]))
    frequency = [quantity_text(row["frequency"], "Hz", 6) for row in (first, last)]
    text = (
        f"From {quantity_text(first['amplitude'], 'm', 3)} to {quantity_text(last['amplitude'], 'm', 3)} the "
        f"resonance frequency goes from {frequency[0]} to {frequency[1]}"
    )
    if "damping_ratio" in table.known:
        ratio = [number_text(100 * row["damping_ratio"], 3) for row in (first, last)]
        return f"{text} and the damping ratio from {ratio[0]} to {ratio[1]} %."
    if "damping" in table.known:
        damping = [quantity_text(row["damping"], "N*s/m", 3) for row in (first, last)]
        return f"{text} and the damping from {damping[0]} to {damping[1]}."
    return f"{text}."
