"""Multisines whose sensor sees more than the mode: the background comes out, and the law beside it."""

import json
from dataclasses import replace

import numpy as np
import pytest

import rsgen
from rsgen.common.arrays import Array
from rsgen.dynamics.linear_part import background_of_lines
from rsgen.identification.lines.line_balance import Balance, BalanceNoise, SpectralLines
from rsgen.law.numeric import compile_law
from tests.multisine.test_line_balance import LINES, records
from tests.multisine.test_multisine import LAW, MASS, SIZES, TRUE, duffing, linear, spectra
from tests.surfaces import errors

VALUES = {
    "phase": (0.03,), "constant": (0.03, 2e-5, 1e-5), "residuals": (0.03, 4e-5, 1e-5, 5e-5, -1e-5),
    "residuals+offset": (0.03, 2e-5, 1e-5, 3e-5, -1e-5, 1e-5, 2e-5),
    "neighbour": (0.03, 2e-5, 1e-5, 3e-5, -1e-5, 0.03, 0.01, 16.0, 0.02),
}  # fmt: skip


def seen(mode: rsgen.MultisineSpectra, kind: str) -> rsgen.MultisineSpectra:
    """Return what sensors read of a mode beside a background: Y = X + B F, and F with a phase error."""
    excited = mode.frequency[mode.excited().any(axis=0)]
    terms = background_of_lines(kind, mode, (float(excited[0]), float(excited[-1])))
    values, moving = np.array(VALUES[kind]), mode.lines > 0
    part = terms.receptance(values).reshape(len(mode), 1, -1) * mode.force * moving
    turned = np.where(moving, mode.force / terms.turn(values), mode.force)
    return replace(mode, force=turned, response=mode.response + part, origin="measured")


def with_noise(test: rsgen.MultisineSpectra, seed: int) -> rsgen.MultisineSpectra:
    """Add one per cent of noise to every period of force and response."""
    generator = np.random.default_rng(seed)

    def noisy(one: np.ndarray) -> np.ndarray:
        size = 0.01 * np.sqrt(0.5 * np.sum(np.abs(one[:, :1, 1:]) ** 2, axis=2, keepdims=True))
        drawn = generator.standard_normal((2, *one.shape)) / np.sqrt(one.shape[2] - 1)
        return one + size * (drawn[0] + 1j * drawn[1])

    return replace(test, force=noisy(test.force), response=noisy(test.response))


@pytest.mark.parametrize(("kind", "law"), [
    *((kind, law) for kind in VALUES if kind != "neighbour" for law in (LAW, "k*x + c*v")),
    # a mode in the band, found from no start
    pytest.param("neighbour", LAW, marks=pytest.mark.slow),
])  # fmt: skip
def test_exact_records_give_law_and_background_to_round_off(kind, law):
    mode = spectra(duffing if law == LAW else linear, SIZES)
    found = rsgen.identify(seen(mode, kind), law, rsgen.Observation(background=kind))
    assert max(errors(found, {e.name: {**TRUE, "m": MASS}[e.name] for e in found}).values()) < 1e-9
    assert found.background.values == pytest.approx(VALUES[kind], rel=1e-7 if kind == "neighbour" else 1e-8)


@pytest.mark.parametrize(("text", "values", "first", "mean_known"), [
    ("k*x + k2*x**2 + c*v", (4.0, 5000.0, 6e4), 1, True),
    ("k*x + k2*x**2 + c*v", (4.0, 5000.0, 6e4), 1, False),
    # lines that the law moves follow by its mean slopes: exactly under a linear one
    ("k*x + c*v", (4.0, 5000.0), 4, True),
    ("k*x + c*v + F*sign(v)", (0.05, 4.0, 5000.0), 1, True),
    ("k*x + c*v + masing(Min(kt*x, F))", (3.0, 4.0, 5000.0, 3000.0), 1, True),
])  # fmt: skip
def test_slopes_are_those_of_the_balance(text, values, first, mean_known):
    test = records(of_force=0.0, of_response=0.0, mean_known=mean_known)
    background = background_of_lines("residuals+offset", test, (1.0, 8.0))
    at = np.array([0.02, 1e-5, -2e-5, 3e-6, 1e-5, 1e-6, -2e-6])
    place = np.array([first]), np.array([LINES])
    measured = SpectralLines(test, test.lines[None] > 0, 4096, *place, LINES, background, np.zeros(7))
    law = compile_law(rsgen.Law(text).force)
    whole = np.concatenate([values, [MASS], at])

    def balance(of: Array) -> Balance:
        count = len(values)
        lines = measured.mode(of[count + 1 :])
        return Balance.of(lines, law, of[:count], of[count], BalanceNoise.unknown(lines, count))

    found = balance(whole).slopes[0]
    for number, value in enumerate(whole):
        step = np.zeros(len(whole))
        step[number] = 1e-4 * value
        up, down = (balance(whole + one).residual[0, 1:] for one in (step, -step))
        slope = (down - up) / (2 * step[number])
        assert np.abs(found[number, 1:] - slope).max() < 2e-3 * np.abs(slope).max(), number


@pytest.mark.slow
def test_a_spring_with_noise_beside_a_background():
    truth = {"k": 5920.0, "k3": 3e5, "c": 6.0}
    oscillator = rsgen.Oscillator(MASS, "k*x + k3*x**3 + c*v", truth)
    plan = rsgen.MultisineTest((3.0, 5.0, 8.0), (2.5, 20.0), 4.0, periods=8, seed=1)
    test = with_noise(seen(rsgen.simulate(oscillator, plan), "residuals"), 1)
    held = float(test.levels[1])
    facts = rsgen.Observation(background="residuals", hold_out=(held,))
    found = rsgen.identify(test, "k*x + k3*x**3 + c*v", facts)
    assert found.verdict.usable
    names = found.background.shape(np.ones(1), np.ones(1)).names
    expected = {**truth, "m": MASS, **dict(zip(names, VALUES["residuals"], strict=True))}
    for estimate in (*found, *found.background.estimates):
        assert abs(estimate.value - expected[estimate.name]) < 4 * estimate.standard_error, estimate.name
    assert found.held_out[0].error < 2 * found.held_out[0].noise
    blind = rsgen.identify(test, "k*x + k3*x**3 + c*v")
    assert not blind.verdict.usable
    (missing,) = [finding for finding in blind.findings if finding.code == "background-missing"]
    assert missing.names["kind"] in ("constant", "residuals")


def test_page_and_numbers_state_the_background(tmp_path):
    test = seen(spectra(duffing, SIZES), "constant")
    rsgen.write_report(tmp_path, test, rsgen.identify(test, LAW, rsgen.Observation(background="constant")))
    told = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["background"]
    assert [row["value"] for row in told["estimates"]] == pytest.approx(VALUES["constant"], rel=1e-8)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Background, 0.5 to 58.5 Hz" in page


def test_the_modal_table_is_that_of_the_mode():
    test = seen(spectra(linear, SIZES), "residuals")
    table = rsgen.modal_table(test, rsgen.Observation(background="residuals"))
    np.testing.assert_allclose(table.stiffness, TRUE["k"], rtol=1e-6)
    np.testing.assert_allclose(table.damping, TRUE["c"], rtol=1e-5)
    assert table.test.background.values == pytest.approx(VALUES["residuals"], rel=1e-6)
