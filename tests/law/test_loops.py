"""Motions against direct sums; forces along them against time stepping, differences, describing functions."""

import numpy as np
import pytest

from rsgen import derive, laws
from rsgen.formula.reading import parse
from rsgen.law.loops import _OpenLoops, _weight, find_reversals
from rsgen.law.memory import with_memory
from rsgen.law.motion import Motion, fourier_series, project
from rsgen.law.numeric import ForceLaw, compile_law

LAWS = {
    "bouc-wen": (
        "k*x + c*v + z", {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"},
        {"alpha": 2.0, "bd": -0.6, "bg": 1.3, "c": 0.01, "k": 1.0},
    ),
    "lugre": (
        "k*x + s0*z + s1*v", {"z": "v - s0*abs(v)/(Fc + (Fs - Fc)*exp(-(v/w)**2))*z"},
        {"Fc": 0.5, "Fs": 0.8, "k": 1.0, "s0": 40.0, "s1": 0.01, "w": 3.0},
    ),
    "two states": (
        "x**3 + y*x + z", {"y": "a*v - b*y + r*z", "z": "y - g*z*abs(z)"},
        {"a": 9.0, "b": 8.0, "g": 0.5, "r": -20.0},
    ),
    "sliders": (
        "k*x + masing(Min(kt*x, Fs)) + masing(Min(2*kt*x, Fs/3))", {}, {"Fs": 0.7, "k": 1.0, "kt": 2.0},
    ),
    "power": ("x*masing(K*x - R*x**p) + structural(h)", {}, {"K": 3.0, "R": 0.5, "h": 0.2, "p": 1.5}),
}  # fmt: skip


def _law(name: str) -> tuple[ForceLaw, np.ndarray]:
    text, memory, values = LAWS[name]
    law = compile_law(with_memory(parse(text), memory) if memory else parse(text))
    return law, law.ordered(values)


def _motion(third: float, count: int = 4) -> Motion:
    generator = np.random.default_rng(3)
    harmonics = np.zeros((count, 4), dtype=complex)
    harmonics[:, 0] = 0.1
    harmonics[:, 1] = np.geomspace(0.4, 4.0, count)
    harmonics[:, 2:] = 0.05 * harmonics[:, 1:2] * np.exp(2j * np.pi * generator.random((count, 2)))
    harmonics[:, 3] *= third / 0.05
    return Motion(np.geomspace(1.0, 5.0, count), harmonics)


@pytest.mark.slow
@pytest.mark.parametrize("third", [0.05, 0.6])
def test_a_masing_loop_is_that_of_its_sliders(third):
    """With a third harmonic this large the motion has minor loops."""
    law, values = _law("sliders")
    motion, samples = _motion(third), 4096
    at = dict(zip(law.parameters, values, strict=True))
    x = np.tile(motion.waveforms(samples)[0], 3)
    sliders = np.zeros((2, len(motion)))
    spring = np.array([[at["kt"]], [2 * at["kt"]]])
    most = np.array([[at["Fs"]], [at["Fs"] / 3]])
    forces = np.zeros_like(x)
    for j in range(1, x.shape[1]):
        sliders = np.clip(sliders + spring * (x[:, j] - x[:, j - 1]), -most, most)
        forces[:, j] = at["k"] * x[:, j] + sliders.sum(axis=0)
    loop = law.along(motion, values, samples).force
    # a loop that is not gone through symmetrically keeps what it began with; its middle is no property of it
    stepped = forces[:, -samples:]
    if third > 0.5:
        turns = np.diff(np.sign(np.diff(x[:, :samples], axis=1)), axis=1) != 0
        assert np.all(turns.sum(axis=1) > 3)
    wide = np.ptp(motion.waveforms(samples)[0], axis=1) > 4 * at["Fs"] / at["kt"]
    assert wide.any()
    assert not wide.all()
    difference = loop - stepped
    difference -= np.where(wide, 0.0, difference.mean(axis=1))[:, None]
    assert np.abs(difference).max() < 2e-3 * np.abs(stepped).max()
    fine = project(loop, 1) - project(stepped, 1)
    assert np.abs(fine).max() < 1e-4 * np.abs(project(stepped, 1)).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_slopes_of_a_loop_are_differences(name):
    """By every parameter and every coordinate of the motion, to the order of a corner in a sample."""
    law, values = _law(name)
    motion, samples = _motion(0.1, 2), 1024
    series = fourier_series((0, 1, 2, 3), samples, half=False)
    omega = motion.omega

    def projected(at: np.ndarray, values: np.ndarray) -> np.ndarray:
        return law.along(Motion(omega, series.complex(at)), values, samples).force @ series.project

    at = series.real(motion.harmonics)
    sample = law.along(motion, values, samples)
    tangent = sample.tangent(series, omega)
    size = np.abs(tangent).max(axis=(1, 2))[:, None]
    for i in range(at.shape[1]):
        change = 3e-3 * np.eye(at.shape[1])[i] * np.abs(motion.harmonics[:, 1:2])
        slope = (projected(at + change, values) - projected(at - change, values)) / (2 * change[:, [i]])
        assert np.all(np.abs(tangent[:, :, i] - slope) < 0.01 * size), i
    for i, by in enumerate(sample.by_parameter):
        step = np.eye(len(values))[i] * 1e-3 * values[i]
        slope = (projected(at, values + step) - projected(at, values - step)) / (2 * step[i])
        assert np.abs(by @ series.project - slope).max() < 2e-3 * np.abs(slope).max(), law.parameters[i]


def test_a_loop_that_does_not_close_is_no_number():
    """z' = v^2 grows for ever; the neighbour that closes is not touched."""
    law = compile_law(with_memory(parse("k*x + z"), {"z": "v**2 - r*z"}))
    motion = _motion(0.05)
    assert np.isnan(law.along(motion, np.array([1.0, 0.0]), 64).force).all()
    assert np.isfinite(law.along(motion, np.array([1.0, 0.5]), 64).force).all()


def test_a_state_that_hardly_forgets_where_it_began_has_no_mean():
    """In small motions the power of Bouc and Wen's law takes 1e-11 of the state in a period."""
    memory = {"z": "(v - (b*abs(v)*z + (1 - b)*v*abs(z))*abs(z)**(n - 1))/xs"}
    law = compile_law(with_memory(parse("Fs*z"), memory))
    values = law.ordered({"Fs": 1.0, "b": 0.6, "n": 8.0, "xs": 1.0})
    motion = Motion(np.ones(2), np.array([[0.0, 0.03], [0.0, 0.1]], dtype=complex))
    force = law.along(motion, values, 128).force
    assert np.allclose(force, motion.waveforms(128)[0], rtol=0, atol=1e-3 * 0.1)


@pytest.mark.parametrize("power", [4.0, 8.0, 20.0, 100.0])
def test_a_state_stays_within_its_bound(power, monkeypatch):
    """Where b is a half, z of Bouc and Wen's law goes from -1 to 1, however far it is moved.

    Steps that are halved in some loops cost nothing in the others: no place is evaluated twice.
    """
    evaluate, seen = _OpenLoops._lack, []

    def spy(self, rows, unknowns):
        seen.extend((*self.values, row, place.tobytes()) for row, place in zip(rows, unknowns, strict=True))
        return evaluate(self, rows, unknowns)

    monkeypatch.setattr(_OpenLoops, "_lack", spy)
    memory = {"z": "(v - (b*abs(v)*z + (1 - b)*v*abs(z))*abs(z)**(n - 1))/xs"}
    law = compile_law(with_memory(parse("Fs*z"), memory))
    values = law.ordered({"Fs": 1.0, "b": 0.5, "n": power, "xs": 1.0})
    motion = Motion(np.ones(40), np.geomspace(0.05, 22.0, 40)[:, None] * np.array([[0.0, 1.0 + 0.0j]]))
    for samples in (64, 128):
        force = law.along(motion, values, samples).force
        assert np.abs(force).max() < 1.01
        assert len(set(seen)) == len(seen)
        seen.clear()


@pytest.mark.parametrize("name", LAWS)
def test_no_motion_has_no_force(name):
    """A fit whose loops close at no point asks for it."""
    law, values = _law(name)
    sample = law.along(Motion(np.zeros(0), np.zeros((0, 2), dtype=complex)), values, 16)
    assert sample.force.shape == (0, 16)


def test_steps_of_a_state_are_weighed_for_an_exponential():
    # theta of Liniger and Willoughby, SIAM J. Numer. Anal. 7 (1970) 47: 1/(1 - exp(-d)) - 1/d; its series is
    # 1/2 + d/12 - d^3/720
    decay = np.array([1e-6, 1e-4, 9e-3, 2e-2, 1.0, 30.0])
    exact = [0.5 + d / 12 - d**3 / 720 if d < 0.1 else 1 / (1 - np.exp(-d)) - 1 / d for d in decay]
    assert _weight(decay) == pytest.approx(exact, abs=1e-8)


def test_reversals_between_samples_are_found_to_fourth_order():
    # cos(t + 0.3) turns at +-1, a part of a sample beside the nearest one: a parabola leaves less than h^4/8
    for samples in (32, 64, 128):
        motion = Motion(np.ones(1), np.array([[0.0, np.exp(0.3j)]]))
        places = find_reversals(*motion.waveforms(samples), motion.interval(samples)).place
        assert np.sort(places) == pytest.approx([-1.0, 1.0], abs=(2 * np.pi / samples) ** 4 / 8)


@pytest.mark.slow
@pytest.mark.parametrize("law", laws, ids=lambda law: law.name)
def test_the_force_along_a_harmonic_motion_is_the_describing_function(law):
    amplitude, omega = np.array([0.4, 1.3, 2.7]), np.array([0.7, 1.1, 2.0])
    exact = derive(law).evaluate(amplitude, omega, law.example)
    known = np.isfinite(exact.mean) & np.isfinite(exact.stiffness)
    mean = np.where(known, exact.mean, 0.0)
    motion = Motion(omega, np.stack([mean, amplitude.astype(complex)], axis=1))
    compiled = compile_law(law.force)
    values = np.array([law.example[name] for name in compiled.parameters])
    found = project(compiled.along(motion, values, 8192).force, 1) / amplitude
    wanted = exact.stiffness + 1j * omega * exact.damping
    # a jump or a corner between two samples is met to the square of their distance, a root to its power 3/2
    assert np.all(np.abs(found - wanted)[known] <= 2e-6 * np.abs(wanted[known]).max(initial=0.0))
    assert known.any()


def _random(count: int, orders: tuple[int, ...], seed: int) -> np.ndarray:
    values = np.random.default_rng(seed).normal(size=(2, count, len(orders)))
    harmonics = values[0] + 1j * values[1]
    harmonics[:, np.array(orders) == 0] = harmonics.real[:, np.array(orders) == 0]
    return harmonics


@pytest.mark.parametrize(("orders", "samples", "half"), [
    ((1, 0, 2, 3), 64, False), ((0, 1, 2), 32, False), ((1, 3, 5, 7), 64, True), ((1,), 64, True),
])  # fmt: skip
def test_a_series_is_its_sum_and_comes_back(orders, samples, half):
    series = fourier_series(orders, samples, half)
    harmonics = _random(5, orders, 1)
    phase = series.step * np.arange(series.shape.shape[1])
    assert phase[-1] + series.step == pytest.approx(np.pi if half else 2 * np.pi)
    turns = [(1j * np.array(orders)) ** n for n in range(3)]
    for turn, matrix in zip(turns, (series.shape, series.rate, series.bend), strict=True):
        direct = (harmonics[:, :, None] * turn[:, None] * np.exp(1j * np.outer(orders, phase))).real.sum(1)
        assert series.real(harmonics) @ matrix == pytest.approx(direct, abs=1e-12)
    signal = series.real(harmonics) @ series.shape
    assert series.complex(signal @ series.project) == pytest.approx(harmonics, abs=1e-13)


def test_waveforms_are_the_sum_and_its_derivatives():
    motion, samples = Motion(np.array([1.0, 2.0, 30.0, 400.0]), _random(4, (0, 1, 2, 3), 5)), 16
    time = motion.interval(samples) * np.arange(samples)
    for power, wave in enumerate(motion.waveforms(samples)):
        rate = 1j * motion.orders * motion.omega[:, None]
        phase = np.exp(1j * motion.orders[None, :, None] * motion.omega[:, None, None] * time[:, None, :])
        direct = ((motion.harmonics * rate**power)[:, :, None] * phase).real.sum(axis=1)
        assert wave == pytest.approx(direct, rel=1e-12, abs=1e-12 * np.abs(direct).max())
    # a turn is a shift in time: a quarter period of the fundamental is four of sixteen samples
    turned = motion.turned(np.full(4, np.pi / 2))
    for one, other in zip(turned.waveforms(samples), motion.waveforms(samples), strict=True):
        assert one == pytest.approx(np.roll(other, -4, axis=1), abs=1e-9 * np.abs(other).max())
