import numpy as np
import pytest

from rsgen.describing import derive
from rsgen.formula import parse
from rsgen.law import laws
from rsgen.law.motion import Motion, project
from rsgen.law.numeric import compile_law

TEXTS = {
    "cubic": "k*x + kn*x**3 + c*v",
    "friction": "k*x + Ff*sign(v)",
    "gap": "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
    "bilinear": "Piecewise((k6*x, x > 0), (k7*x, True))",
    "quadratic": "cn*v*abs(v) + k*x",
    "power": "kp*abs(x)**q*sign(x)",
    "tanh": "A*tanh(v/w) + k*x",
}


@pytest.mark.parametrize("name", TEXTS)
def test_force_and_slopes_agree_with_the_law(name):
    expression = parse(TEXTS[name])
    law = compile_law(expression)
    generator = np.random.default_rng(3)
    x, v = generator.uniform(-2, 2, (2, 50))
    values = generator.uniform(0.5, 1.5, len(law.parameters))
    still = np.zeros_like(x)

    def direct(x: float, v: float, values: np.ndarray) -> float:
        known = dict(zip(law.parameters, values, strict=True)) | {"x": x, "v": v}
        return float(expression.subs({s: known[s.name] for s in expression.free_symbols}))

    for i in range(10):
        assert law.force(x[i : i + 1], v[i : i + 1], values)[0] == pytest.approx(
            direct(x[i], v[i], values), rel=1e-12
        )
    sample, h = law.sample(x, v, still, still, values), 1e-6
    assert sample.by_x == pytest.approx(
        (law.force(x + h, v, values) - law.force(x - h, v, values)) / (2 * h), rel=1e-6, abs=1e-8
    )
    assert sample.by_v == pytest.approx(
        (law.force(x, v + h, values) - law.force(x, v - h, values)) / (2 * h), rel=1e-6, abs=1e-8
    )
    for j, slope in enumerate(sample.by_parameter):
        step = h * np.eye(len(values))[j]
        assert slope == pytest.approx(
            (law.force(x, v, values + step) - law.force(x, v, values - step)) / (2 * h), rel=1e-6, abs=1e-8
        )


def test_sampled_steps_converge_with_the_square_of_the_step():
    law = compile_law(parse("Ff*sign(v)"))
    shift, errors = 0.3, []
    for samples in (64, 128, 256):
        angle = 2 * np.pi * np.arange(samples) / samples + shift * 2 * np.pi / samples
        x, v, a = np.sin(angle), np.cos(angle), -np.sin(angle)
        n = law.sample(x, v, a, np.full(1, 2 * np.pi / samples), np.ones(1)).force
        errors.append(abs(2 * np.mean(n * np.cos(angle)) - 4 / np.pi))  # Liu et al., Eq. (18)
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.2)


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
