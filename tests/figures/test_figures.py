"""Figures: every one draws, says what it shows in numbers, and is the same file for the same data."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from rsgen import ResponseSurface, derive, figures, make_element, modal_table, predict
from rsgen.identification.results.result import changed
from rsgen.report.figures import Drawing, number_text
from rsgen.report.figures.drawing import project_style
from rsgen.report.figures.equivalent import backbone
from rsgen.report.page_tables import estimate_table
from tests.samples import C1, K1, KN1, cubic_identification, cubic_prediction, cubic_surface

TRUTH = {"k1": K1, "kn1": KN1, "c1": C1}
SURFACE = cubic_surface()
IDENTIFICATION = cubic_identification(SURFACE)
MODAL = modal_table(SURFACE)
PREDICTION = cubic_prediction(SURFACE, held_out=(1.0, 12.0))

DRAWINGS: dict[str, Callable[..., Drawing]] = {
    "surface": lambda ax=None: figures.draw_surface(SURFACE, ax=ax),
    "modal": lambda ax=None: figures.draw_modal(MODAL, IDENTIFICATION, ax=ax),
    "collapse": lambda ax=None: figures.draw_collapse(IDENTIFICATION, TRUTH, ax=ax),
    "forces": lambda ax=None: figures.draw_forces(IDENTIFICATION, TRUTH, ax=ax),
    "loops": lambda ax=None: figures.draw_loops(SURFACE, IDENTIFICATION, TRUTH, ax=ax),
    "energy": lambda ax=None: figures.draw_energy(SURFACE, IDENTIFICATION, TRUTH, ax=ax),
    "responses": lambda ax=None: figures.draw_responses(SURFACE, PREDICTION, ax=ax),
    "held-out": lambda ax=None: figures.draw_held_out(PREDICTION, ax=ax),
}


@cache
def drawn(name: str) -> tuple[Drawing, bytes]:
    """A drawing and its SVG, made once for all tests that only look at them."""
    drawing = DRAWINGS[name]()
    return drawing, drawing.render("svg")


def test_a_first_order_value_that_is_not_determined_has_no_predicted_bias():
    (first, *others), biases = IDENTIFICATION.first_order, IDENTIFICATION.first_order_bias
    unknown = replace(first, value=np.nan, standard_error=np.inf)
    table = estimate_table(changed(IDENTIFICATION, first_order=(unknown, *others)))
    column = table.columns.index("Its predicted bias")
    shown = {row[0]: row[column] for row in table.rows}
    assert np.isfinite(biases).all()
    assert (shown[first.name], shown[others[0].name] != "–") == ("–", True)


def test_a_force_that_varied_along_the_sweep_is_that_of_the_curve():
    (item, *_), (curve, *_) = PREDICTION.held_out, PREDICTION.curves
    dropped = replace(PREDICTION, held_out=(replace(item, force=0.9 * item.level),), curves=(curve,))
    shown = [line for axes in figures.draw_held_out(dropped).figure.axes for line in axes.lines]
    (line,) = [line for line in shown if line.get_label() == "predicted at the measured forces"]
    assert line.get_ydata() == pytest.approx(np.abs(item.predicted) * 1e3)


def test_a_force_without_a_law_that_is_known_at_rest_alone_is_not_drawn():
    restoring = IDENTIFICATION.restoring
    wide = np.where(restoring.displacement > 0, np.inf, 0.0)
    unknown = changed(IDENTIFICATION, restoring=replace(restoring, stiffness_band=wide))
    labels = [axes.get_legend_handles_labels()[1] for axes in figures.draw_forces(unknown).figure.axes]
    assert ["nonparametric" in shown for shown in labels] == [False, True]


def test_a_modal_table_of_one_amplitude_is_a_point_with_its_interval():
    omega, held = 2 * np.pi * np.linspace(9, 11, 41), np.full(41, 2e-3)
    force = (5920 + 7.5j * omega - 1.5 * omega**2) * held
    table = modal_table(ResponseSurface(held, omega / 2 / np.pi, force, held + 0j, control="response"))
    axes = figures.draw_modal(table).figure.axes[0]
    (line,) = axes.lines
    assert (len(table), line.get_marker(), len(axes.collections[-1].get_segments())) == (1, "o", 1)
    assert line.get_ydata() == pytest.approx(np.sqrt(5920 / 1.5) / 2 / np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWINGS)
def test_drawing_is_whole(name):
    drawing, svg = drawn(name)
    assert drawing.name == name
    assert drawing.caption.endswith(".")
    assert re.search(r"\d", drawing.alternative)
    assert not re.search(r"\bnan\b", drawing.alternative)
    with project_style():
        assert (mpl.rcParams["text.usetex"], mpl.rcParams["text.parse_math"]) == (False, False)
    for axes in drawing.figure.axes:
        assert not any(text.get_parse_math() for text in axes.texts)
        labels = [axis.get_label_text() for axis in axes._axis_map.values()]
        assert all(re.search(r"\[[^\]]+\]$", label) for label in labels if label), labels
        if len(axes.get_lines()) > 1:
            assert axes.get_ylabel()
    ElementTree.fromstring(svg)
    assert len(svg) < 250_000  # eleven of them must fit into a page of 2 MB


@pytest.mark.slow
@pytest.mark.parametrize("name", DRAWINGS)
def test_same_data_same_bytes_and_all_that_is_shown_lies_inside(name):
    again = DRAWINGS[name]()
    assert drawn(name)[1] == again.render("svg")
    if name != "surface":
        shown = Bbox.union([axes.get_tightbbox() for axes in again.figure.axes])
        assert Bbox.union([again.figure.bbox, shown]).bounds == again.figure.bbox.bounds


@pytest.mark.slow
@pytest.mark.parametrize("surface", [
    cubic_surface(sweep="up", gaps=True), cubic_surface(levels=1, frequencies=1),
], ids=["gaps", "one point"])  # fmt: skip
def test_any_surface_can_be_drawn(surface):
    assert figures.draw_surface(surface).render("png").startswith(b"\x89PNG")


@pytest.mark.slow
def test_stable_parts_are_solid_and_unstable_parts_dashed():
    drawing, _ = drawn("responses")
    assert not PREDICTION.curves[-1].stable.all()
    dashed = [line for line in drawing.figure.axes[0].get_lines() if line.get_linestyle() == "--"]
    shown = np.concatenate([np.asarray(line.get_xdata(), dtype=float) for line in dashed])
    unstable = np.concatenate([c.frequency[~c.stable] for c in PREDICTION.curves])
    assert set(np.round(unstable, 9)) <= set(np.round(shown, 9))


def test_backbone_of_a_cubic_spring_is_the_closed_formula():
    amplitude = np.linspace(0.001, 0.05, 7)
    model = backbone(IDENTIFICATION, TRUTH, amplitude)
    # k1 + 3/4 kn1 X^2: Liu et al., Eq. (14)
    np.testing.assert_allclose(model.stiffness, K1 + 0.75 * KN1 * amplitude**2, rtol=1e-13)
    np.testing.assert_allclose(model.damping, C1, rtol=1e-13)
    np.testing.assert_allclose(model.omega**2 * 1.5, model.stiffness, rtol=1e-12)


@given(st.floats(-1e30, 1e30, allow_subnormal=False), st.integers(2, 8))
def test_printed_numbers_can_be_read_back(value, digits):
    text = number_text(value, digits).replace("\u202f", "").replace("−", "-")
    if "×" in text:
        mantissa, power = text.split(" × 10")
        exponent = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
        text = f"{mantissa}e{exponent}"
    assert float(text) == pytest.approx(value, rel=0.5001 * 10 ** (1 - digits), abs=1e-300)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*DRAWINGS, "derivation"])
def test_a_figure_goes_on_axes_of_the_caller(name):
    figure = Figure(figsize=(7, 7))
    grid = figure.add_gridspec(2, 2)
    projection = "3d" if name == "surface" else None
    mine, other = figure.add_subplot(grid[0, 0], projection=projection), figure.add_subplot(grid[1, 1])
    before = figure.get_layout_engine()
    law = derive(make_element("law", "k*x + kn*x**3"))
    drawing = DRAWINGS[name](mine) if name in DRAWINGS else figures.draw_derivation(law, ax=mine)
    assert (drawing.figure is figure, drawing.name) == (True, name)
    assert (mine.has_data(), other.has_data()) == (True, False)
    # the caller lays out; colour bars are the only axes that are added
    assert figure.get_layout_engine() is before
    assert len(figure.axes) <= 3
    assert "image/png" not in drawing._repr_mimebundle_()[0]
    figure.canvas.draw()


def test_responses_show_the_band_and_the_levels_that_were_asked_for():
    usual = figures.draw_responses(SURFACE, predict(IDENTIFICATION, [1.0, 12.0]))
    asked = figures.draw_responses(SURFACE, predict(IDENTIFICATION, [1.0, 12.0], band=(5.0, 20.0)))
    (left, right), (low, high) = (one.figure.axes[0].get_xlim() for one in (asked, usual))
    assert left < 5.0 < low
    assert right > 20.0 > high
    # the shading begins at the largest tested amplitude, whatever levels are drawn
    for levels in ([1.0, 12.0, 18.0], [18.0]):
        prediction = predict(IDENTIFICATION, levels)
        higher = figures.draw_responses(SURFACE, prediction)
        axes, peak = higher.figure.axes[0], np.nanmax(prediction.curves[-1].amplitude)
        assert axes.get_ylim()[1] > 1e3 * peak
        begins = max(patch.get_y() for patch in axes.patches if patch.get_y())
        assert begins == pytest.approx(1e3 * SURFACE.amplitude[SURFACE.settled].max())


def test_no_movement_of_the_resonance_is_stated_where_the_band_ends_before_it():
    below = SURFACE.select(SURFACE.frequency < 0.95 * IDENTIFICATION.resonances[0].frequency)
    said = figures.draw_surface(below).alternative
    assert "it moves by" not in said
    assert "at the edge of the band, where the resonance lies or beyond which it lies" in said
    assert "it moves by" in drawn("surface")[0].alternative


def test_a_force_that_falls_near_the_resonance_moves_no_resonance():
    levels, frequency = np.repeat([1.0, 5.0], 61), np.tile(np.linspace(8, 12, 61), 2)
    omega = 2 * np.pi * frequency
    dip = np.where(levels > 1, 0.5 * np.exp(-(((frequency - 9.9) / 0.3) ** 2)), 0.0)
    force = levels * (1 - dip)
    response = force / ((20 * np.pi) ** 2 - omega**2 + 2j * omega)
    said = figures.draw_surface(ResponseSurface(levels, frequency, force, response)).alternative
    assert "largest response per force" in said
    assert "it moves by +0.00 %" in said
