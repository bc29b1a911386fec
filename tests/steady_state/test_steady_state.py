"""Steady states against independent answers: DOP853 with events, closed forms, brute force."""

from pathlib import Path

import numpy as np
import pytest

from rsgen import Oscillator, RsgenError, load_case
from rsgen.dynamics.fixed_point import attraction, correction
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.formula.reading import parse
from tests.oracles import events
from tests.oracles.events import Law

CASES = Path(__file__).parents[2] / "cases"
ASKED = 1e-4  # what the main job promises on every case
POINTS = 12


def oscillator(law: str, mass: float = 1.5, **values: float) -> Oscillator:
    return Oscillator(mass, law, values)


x_itself, v_itself = (lambda x, v: x), (lambda x, v: v)


def _piecewise(c4: float, k4: float, k5: float, b: float) -> Law:
    def n(x: float, v: float, modes: tuple[bool, ...]) -> float:
        if modes[0]:
            return c4 * v + k5 * x + (k4 - k5) * b
        return c4 * v + (k4 * x if modes[1] else k5 * x - (k4 - k5) * b)

    return Law(n, (lambda x, v: x - b, lambda x, v: x + b))


# the laws once more, written by hand from the paper's equations (13) to (26)
PAPER = {
    "cubic": lambda c1, k1, kn1: Law(lambda x, v, _: c1 * v + k1 * x + kn1 * x**3),
    "quintic": lambda c2, k2, kn2: Law(lambda x, v, _: c2 * v + k2 * x + kn2 * x**5),
    "coulomb": lambda c3, k3, Ff: Law(
        lambda x, v, modes: c3 * v + k3 * x + (Ff if modes[0] else -Ff), (v_itself,), 0
    ),
    "piecewise": _piecewise,
    "bilinear": lambda c5, k6, k7: Law(
        lambda x, v, modes: c5 * v + (k6 if modes[0] else k7) * x, (x_itself,)
    ),
    "combined": lambda c6, cn6, k8, kn8: Law(
        lambda x, v, _: c6 * v + cn6 * v * abs(v) + k8 * x + kn8 * x**3, (v_itself,)
    ),
    "joint": lambda a1, a2, a3, a4, a5, d1, d2, d3, d4: Law(
        lambda x, v, _: (
            a1 * x + a2 * x * abs(x) + a3 * x**3 + a4 * x**3 * abs(x) + a5 * x**5
            + d1 * v + d2 * v * abs(v) + d3 * v**3 + d4 * v**3 * abs(v)
        ),
        (x_itself, v_itself),
    ),
}  # fmt: skip


def worst(o, law, force, frequency, accuracy, harmonics=7) -> tuple[float, float, float]:
    """Largest relative error of the fundamental, of all harmonics and of the peaks."""
    asked = solve_steady_states(o, force, frequency, accuracy=accuracy, harmonics=harmonics)
    # the reference starts close by, only to save its time: it goes on until it repeats by itself
    near = solve_steady_states(o, force, frequency, accuracy=1e-9, harmonics=harmonics)
    assert asked.settled.all()
    errors = []
    for i, (F, f) in enumerate(zip(force, frequency, strict=True)):
        mode = law.mode_at(near.state[i], float(np.real(F)))
        structure, omega = events.switched(o.mass, law), 2 * np.pi * f
        _, wave = events.settle(structure, F, omega, start=near.state[i], mode=mode, samples=2048)
        X = np.fft.rfft(wave[:-1])[: harmonics + 1] * 2 / 2048
        X[0] /= 2
        peak = [wave.max(), wave.min()]
        size = abs(X[1])
        if size == 0:
            assert np.all(asked.harmonics[i, 1:] == 0)
            continue
        change = np.abs(asked.harmonics[i] - X) / size
        errors.append((change[1], change.max(), np.abs(asked.peak[i] - peak).max() / size))
    return tuple(np.max(errors, axis=0))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PAPER, "cubic-hardening"])
def test_cases_agree_with_dop853(name):
    case = load_case(CASES / f"{name}.toml")
    o, test = case.oscillator, case.test
    law = PAPER[name.removesuffix("-hardening")](**o.values)
    random = np.random.default_rng(11)
    force = random.choice(test.level, POINTS)
    frequency = random.choice(test.frequency, POINTS)
    # always among them: the least level (light sticking) and the strongest resonance
    force[:2] = test.level.min(), test.level.max()
    grid = solve_steady_states(o, np.full(test.frequency.shape, test.level.max()), test.frequency)
    frequency[1] = test.frequency[np.nanargmax(np.abs(grid.harmonics[:, 1]))]
    fundamental, harmonics, peak = worst(o, law, force, frequency, ASKED)
    assert max(fundamental, harmonics) <= ASKED
    assert peak <= ASKED + 2e-6  # the reference is sampled at 2048 times a period


OTHERS = {
    "friction that grows with x": (
        oscillator("k*x + c*v + (Ff + mu*x**2)*sign(v)", k=6e3, c=4.0, Ff=0.5, mu=1e5),
        Law(lambda x, v, m: 6e3 * x + 4 * v + (0.5 + 1e5 * x * x) * (1 if m[0] else -1), (v_itself,), 0),
    ),
    "a one-sided stop with friction": (
        oscillator("k*x + c*v + Max(k2*(x - g), 0) + Ff*sign(v)", k=6e3, c=4.0, k2=2e4, g=1e-3, Ff=0.4),
        Law(
            lambda x, v, m: 6e3 * x + 4 * v + (2e4 * (x - 1e-3) if m[0] else 0) + (0.4 if m[1] else -0.4),
            (lambda x, v: x - 1e-3, v_itself),
            1,
        ),
    ),
    "a switch in x and v together": (
        oscillator("k*x + c*v + a*sign(x + d*v)", k=6e3, c=14.0, a=0.05, d=-0.002),
        Law(lambda x, v, m: 6e3 * x + 14 * v + (0.05 if m[0] else -0.05), (lambda x, v: x - 0.002 * v,)),
    ),
    "a product of switches": (
        oscillator("k*x + c*v + Piecewise((a*x, x*v > 0), (0, True))", k=6e3, c=4.0, a=400.0),
        Law(lambda x, v, m: 6e3 * x + 4 * v + (400 * x if m[0] == m[1] else 0), (x_itself, v_itself)),
    ),
    "Hertzian contact behind a gap": (
        oscillator("k*x + c*v + a*Max(x - g, 0)**1.5", k=3e3, c=4.0, a=1e5, g=1e-3),
        Law(lambda x, v, m: 3e3 * x + 4 * v + 1e5 * max(x - 1e-3, 0.0) ** 1.5, (lambda x, v: x - 1e-3,)),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_other_laws_agree_with_dop853(name):
    o, law = OTHERS[name]
    force, frequency = np.array([0.9, 2.0, 5.0]), np.array([9.0, 10.2, 12.5])
    assert max(worst(o, law, force, frequency, 1e-5)[:2]) <= 1e-5


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-9])
def test_linear_oscillator_has_the_exact_receptance(accuracy):
    o = oscillator("k*x + c*v", k=5920.0, c=3.8)
    frequency = np.linspace(2, 20, 90)
    omega = 2 * np.pi * frequency
    force = np.linspace(0.5, 8, 90) * np.exp(1j * np.linspace(0, 6, 90))
    exact = force / (5920 - 1.5 * omega**2 + 3.8j * omega)
    states = solve_steady_states(o, force, frequency, accuracy=accuracy)
    assert np.max(np.abs(states.harmonics[:, 1] / exact - 1)) <= accuracy
    assert np.max(np.abs(states.harmonics[:, [0, 2, 3]])) <= accuracy * np.abs(exact).max()
    assert np.allclose(states.state[:, 0], exact.real, rtol=0, atol=accuracy * np.abs(exact))
    assert np.allclose(states.peak, np.abs(exact)[:, None] * [1, -1], rtol=2 * accuracy)
    assert np.nanmax(states.error) <= accuracy


@pytest.mark.parametrize(("law", "values", "state"), [
    ("c*v + k*x + kn*x**3", {"c": 4.0, "k": 5e3, "kn": 3e8}, [3e-3, 0.1]),
    ("c*v + k*x + Max(k2*(x - g), 0)", {"c": 4.0, "k": 5e3, "k2": 1e4, "g": 1e-3}, [3e-3, 0.1]),
    ("c*v + k*x + Ff*sign(v)", {"c": 4.0, "k": 5e3, "Ff": 2.0}, [3e-3, 0.1]),
    ("c*v + k*x + Ff*sign(v)", {"c": 4.0, "k": 5e3, "Ff": 5.0}, [2e-4, 0.0]),
], ids=["smooth", "corner", "friction", "stick"])  # fmt: skip
def test_convergence_is_of_fourth_order(law, values, state):
    """One period against one with many steps; the start is fixed, no fixed point is involved."""
    kernel = compile_kernel(parse(law))
    order = np.array([values[name] for name in kernel.parameters])
    F, omega = np.array([[6.0, 1.0]]), np.array([2 * np.pi * 9])
    y = np.array([[state[0]], [state[1] / omega[0]]])
    # over all of the range: single halvings scatter with the place of the events within their steps
    coarse, fine, best = (
        kernel.integrate(np.array([0]), y, F, omega, 1.5, order, steps=steps, periods=1).state[:, 0]
        for steps in (64, 1024, 16384)
    )
    ratio = np.linalg.norm(coarse - best) / np.linalg.norm(fine - best)
    assert 3.6 <= np.log(ratio) / np.log(16) <= 5.0


def test_a_mass_that_friction_holds_does_not_move():
    o = oscillator("c*v + k*x + Ff*sign(v)", c=3.8, k=5920.0, Ff=0.8)
    states = solve_steady_states(o, [0.3, 0.79, 0.81], [10.0, 10.0, 10.0])
    assert states.settled.all()
    assert np.all(states.harmonics[:2] == 0)
    assert np.abs(states.harmonics[2, 1]) > 0


@pytest.mark.parametrize(("changed", "place"), [
    ({"force": np.ones(3)}, "force, frequency: shapes"), ({"force": [1.0, np.nan]}, "force: "),
    ({"frequency": [1.0, -1.0]}, "frequency: "), ({"frequency": [1.0, np.nan]}, "frequency: "),
    ({"harmonics": 0}, "harmonics: "), ({"accuracy": -1.0}, "accuracy: "),
    ({"start": np.ones(3)}, "start: shape"), ({"start": np.full((2, 2), np.nan)}, "start: "),
])  # fmt: skip
def test_what_has_no_steady_states_is_refused_by_its_name(changed, place):
    given = {"force": np.ones(2), "frequency": np.ones(2), **changed}
    with pytest.raises(RsgenError, match=f"^{place}"):
        solve_steady_states(Oscillator(1.0, "k*x + c*v", {"k": 50.0, "c": 1.0}), **given)


def test_what_never_settles_has_an_outcome_and_no_numbers():
    undamped = solve_steady_states(oscillator("k*x", k=5920.0), [1.0], [8.0])
    assert list(undamped.outcome) == [1]
    falling = solve_steady_states(oscillator("c*v - k*x", k=5920.0, c=3.0), [1.0], [8.0])
    assert list(falling.outcome) == [3]
    assert np.isnan(undamped.harmonics).all()
    assert np.isnan(falling.peak).all()


@pytest.mark.slow
def test_period_two_is_recognised():
    # the one-sided stop at twice its natural frequency: the classical period doubling of an impact oscillator
    o = oscillator("k*x + c*v + Max(kw*x, 0)", k=600.0, c=1.0, kw=6e5)
    states = solve_steady_states(o, np.full(60, 5.0), np.linspace(5, 16, 60))
    two = np.flatnonzero(states.outcome == 2)
    assert len(two)
    kernel, omega = compile_kernel(o.force), 2 * np.pi * np.linspace(5, 16, 60)[two]
    values = np.array([o.values[name] for name in kernel.parameters])
    moved = kernel.integrate(
        np.arange(len(two)), np.zeros((2, len(two))), np.tile([5.0, 0.0], (len(two), 1)),
        omega, 1.5, values, steps=256, periods=3000,
    )  # fmt: skip
    size = np.hypot(*moved.state)
    twice = np.hypot(*(moved.state - moved.history[0])) / size
    once = np.hypot(*(moved.state - moved.history[1])) / size
    assert np.median(twice) < 1e-4
    assert np.median(once) > 1e-2


@pytest.mark.parametrize("size", [2, 3, 4, 5])
def test_corrections_solve_their_equations_also_where_a_pivot_vanishes(size):
    random = np.random.default_rng(size)
    jacobian = random.normal(size=(size, size, 50))
    jacobian[0, 0, :10] = 1.0  # I - J begins with a zero
    jacobian[:, :, 20:30] *= 0.3
    residual = random.normal(size=(size, 50))
    matrix = np.moveaxis(np.eye(size)[:, :, None] - jacobian, 2, 0)
    exact = np.linalg.solve(matrix, residual.T[:, :, None])[..., 0].T
    loss = np.linalg.cond(matrix)
    # without exchange of rows a pivot of 1e-4 may cost four digits more than the condition does
    assert np.all(np.abs(correction(jacobian, residual) - exact) < 1e-11 * loss * np.abs(exact).max(axis=0))


def test_a_singular_point_moves_by_its_residual_and_spoils_no_other():
    jacobian = np.zeros((3, 3, 3))
    jacobian[:, :, 1] = np.eye(3)
    residual = np.arange(9.0).reshape(3, 3)
    assert np.array_equal(correction(jacobian, residual), residual)


@pytest.mark.parametrize("size", [2, 3, 4])
def test_a_point_attracts_where_all_eigenvalues_are_inside_the_unit_circle(size):
    generator = np.random.default_rng(size)
    jacobian = generator.normal(size=(size, size, 400)) / np.sqrt(size)
    largest = np.abs(np.linalg.eigvals(np.moveaxis(jacobian, -1, 0))).max(axis=1)
    inside = attraction(jacobian) > 0
    assert 50 < np.count_nonzero(inside) < 350
    assert np.array_equal(inside, largest < 1)
