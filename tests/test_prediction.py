from __future__ import annotations

import numpy as np
import pytest

from rsgen.errors import RsgenError
from rsgen.identification import identify
from rsgen.prediction import Prediction, predict
from tests.oracles.virtual_test import changed, model, surface

EXACT = 1e-5
"""Predicted from exact data with all harmonics; what is left is the identification's own error."""


@pytest.fixture(scope="module")
def quintic() -> tuple[object, Prediction]:
    table = surface("quintic", levels=np.array([2.0, 4, 6, 8, 10, 12, 14]))
    found = identify(table, model("quintic", hold_out=(6.0, 10.0)))
    return table, predict(found, surface=table)


def test_held_out_levels_are_predicted(quintic: tuple[object, Prediction]) -> None:
    _, prediction = quintic
    assert [item.level for item in prediction.held_out] == [6.0, 10.0]
    for item in prediction.held_out:
        assert item.missing == 0
        assert item.error < EXACT
        assert item.largest_error < EXACT
        assert np.all(np.diff(item.frequency) > 0)


def test_curves_pass_through_the_measured_points(quintic: tuple[object, Prediction]) -> None:
    table, prediction = quintic
    for curve in prediction.curves:
        rows = np.flatnonzero(table.level == curve.level)
        for row in rows[::5]:
            # nearest point of the curve in units of both axes; its points lie apart by a few per cent
            apart = np.hypot(
                (curve.frequency / table.frequency[row] - 1) * 20, curve.amplitude / table.amplitude[row] - 1
            )
            assert np.nanmin(apart) < 0.15


def test_folds_bound_the_unstable_branch(quintic: tuple[object, Prediction]) -> None:
    _, prediction = quintic
    low, high = prediction.curves[0], prediction.curves[-1]
    assert len(low.folds) == 0
    assert low.stable.all()
    assert len(high.folds) == 2
    unstable = high.amplitude[~high.stable]
    assert high.folds[:, 1].min() * 0.95 <= unstable.min()
    assert unstable.max() <= high.folds[:, 1].max() * 1.05
    # a hardening spring is ambiguous between the two jumps, the one down at the higher frequency
    between = high.frequency[~high.stable]
    assert high.folds[:, 0].min() * 0.999 <= between.min()
    assert between.max() <= high.folds[:, 0].max() * 1.001


def test_linear_resonance_has_its_closed_form() -> None:
    table = surface("cubic", values={"k": 5920.0, "kn": 0.0, "c": 3.8})
    found = identify(table, model("cubic"))
    curve = predict(found, [5.0]).curves[0]
    omega = 2 * np.pi * curve.frequency
    exact = 5.0 / np.abs(5920 - 1.5 * omega**2 + 3.8j * omega)
    assert curve.amplitude == pytest.approx(exact, rel=1e-4)
    lag = np.angle(5920 - 1.5 * omega**2 + 3.8j * omega)
    assert curve.phase == pytest.approx(lag, abs=1e-3)
    assert curve.stable.all()


def test_extrapolation_is_marked(quintic: tuple[object, Prediction]) -> None:
    table, _ = quintic
    found = identify(table, model("quintic"))
    prediction = predict(found, [1.0, 60.0])
    inside, beyond = prediction.curves
    assert beyond.extrapolated.any()
    assert not inside.extrapolated[inside.amplitude > found.amplitude_range[0]].any()
    assert any("extrapolation" in remark and "60" in remark for remark in prediction.remarks)


@pytest.mark.parametrize("law", ["coulomb", "bilinear"])
def test_rough_laws_are_predicted_too(law: str) -> None:
    table = surface(law)
    found = identify(table, model(law, hold_out=(8.0,)))
    prediction = predict(found, [4.0, 8.0], table)
    # the balance leaves the motion at the switches to few harmonics
    assert prediction.held_out[0].error < 5e-3
    for curve in prediction.curves:
        # the grid of frequencies misses the very top
        top = table.amplitude[table.level == curve.level].max()
        assert np.nanmax(curve.amplitude) == pytest.approx(top, rel=0.03)


def test_bands_widen_with_the_noise(quintic: tuple[object, Prediction]) -> None:
    table, _ = quintic
    generator = np.random.default_rng(1)
    widths = []
    for relative in (0.002, 0.02):
        noise = relative * generator.normal(size=(len(table), 2)) @ np.array([1, 1j])
        found = identify(changed(table, force=table.force * (1 + noise)), model("quintic"))
        curve = predict(found, [4.0]).curves[0]
        widths.append(np.nanmedian((curve.upper - curve.lower) / curve.amplitude))
    assert 5 < widths[1] / widths[0] < 20


def test_a_level_must_be_positive(quintic: tuple[object, Prediction]) -> None:
    found = identify(quintic[0], model("quintic"))
    with pytest.raises(RsgenError, match="positive and finite"):
        predict(found, [-1.0])
