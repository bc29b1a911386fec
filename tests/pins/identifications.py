"""Identifications with pinned numbers: cases of the paper, measured tests, fifty random ones with noise."""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import rsgen
from rsgen.data.oscillator import Model, Observation
from rsgen.files.files_to_surface import read_measurement
from tests.pins import trees
from tests.pins.pinned import SMOOTH, Pin, Tree, stored

ROOT = Path(__file__).parents[2]
MASS = 1.5

LAWS: dict[str, tuple[str, dict[str, float]]] = {
    "cubic-quadratic": ("k3*x**3 + cq*v*abs(v)", {"k3": -2.0e5, "cq": 1.2}),
    "cubic-coulomb": ("k3*x**3 + Ff*sign(v)", {"k3": 2.0e5, "Ff": 0.5}),
    "cubic-quintic": ("k3*x**3 + k5*x**5", {"k3": -2.0e5, "k5": 1.5e8}),
    "cubic-cubic-damper": ("k3*x**3 + c3*v**3", {"k3": 2.0e5, "c3": 0.4}),
    "power": ("kp*abs(x)**p*sign(x)", {"kp": 5.0e4, "p": 2.4}),
    "stiffening-drag": ("k2*x*abs(x) + cq*v*abs(v)", {"k2": 3.0e4, "cq": 1.0}),
    "quadratic-cubic": ("k2*x**2 + k3*x**3", {"k2": 2.0e4, "k3": 4.0e5}),
    "gap": ("Piecewise((kd*(x - b), x > b), (kd*(x + b), x < -b), (0, True))", {"kd": 900.0, "b": 0.012}),
    "bilinear": ("Piecewise((kb*x, x > 0), (0, True)) + k3*x**3", {"kb": 900.0, "k3": 2.0e5}),
    "tanh-friction": ("A*tanh(v/w) + k3*x**3", {"A": 0.6, "w": 0.3, "k3": -1.5e5}),
}
"""Terms that are added to k*x + c*v, with typical values [SI] for motions of 5 to 50 mm near 10 Hz."""

AMPLITUDES_SUFFICE = {
    "cubic-quadratic", "cubic-coulomb", "cubic-quintic", "cubic-cubic-damper", "stiffening-drag",
}  # fmt: skip
"""Symmetric laws without exponents and widths; the search for those takes half a minute without phase."""

BACKGROUNDS = ("none", "phase", "constant", "residuals")
NOISES = (0.0, 0.001, 0.01, 0.03)


def identify_draw(seed: int) -> rsgen.Identification:
    """Simulate, add the background, add noise, forget the phase, identify; every law comes up five times."""
    generator = np.random.default_rng([20261122, seed])
    law = list(LAWS)[seed % len(LAWS)]
    typical = {"k": 5920.0, "c": 3.8, **LAWS[law][1]}
    values = {name: value * generator.uniform(0.8, 1.25) for name, value in typical.items()}
    # a test without phase knows a constant background, but no error of the phase
    phase_known = bool(generator.uniform() < 0.6) or law not in AMPLITUDES_SUFFICE
    background = str(generator.choice(BACKGROUNDS if phase_known else ("none", "constant")))
    relative, mass_known, held_out = generator.choice(NOISES), *(generator.uniform(size=2) < 0.2)
    elements = (rsgen.make_element("law", f"k*x + c*v + {LAWS[law][0]}"),)
    levels = np.array([2.0, 4.0, 7.0, 10.0])
    test = rsgen.SimulatedTest(level=levels, frequency=np.linspace(8, 12, 21), harmonics=5, accuracy=1e-7)
    surface = rsgen.simulate(rsgen.Oscillator(MASS, elements, values), test)
    generator = np.random.default_rng([20261122, seed, 1])

    def noise(shape: tuple[int, ...]) -> np.ndarray:
        parts = generator.standard_normal((*shape, 2))
        return relative / np.sqrt(2) * (parts[..., 0] + 1j * parts[..., 1])

    b0 = 2e-4 * np.exp(1j * generator.uniform(-np.pi, np.pi)) if background != "phase" else 0.0
    b1 = 0.5 * np.exp(1j * generator.uniform(-np.pi, np.pi)) if background == "residuals" else 0.0
    psi = generator.uniform(-0.5, 0.5)
    force, harmonics = np.array(surface.force), np.array(surface.harmonics)
    omega = 2 * np.pi * surface.frequency
    if background != "none":
        harmonics[:, 1] += (b0 + b1 / omega**2) * force
        force = force * np.exp(-1j * psi)
    size = np.abs(harmonics[:, 1])[:, None]
    harmonics = harmonics + size * noise(harmonics.shape)
    harmonics[:, 0] = harmonics[:, 0].real
    force = force + np.abs(force) * noise(force.shape)
    if not phase_known:
        amplitude = np.abs(harmonics[:, 1])
        harmonics = np.zeros((len(amplitude), 2), dtype=complex)
        harmonics[:, 1] = amplitude
        force = np.abs(force).astype(complex)
    seen = replace(surface, force=force, harmonics=harmonics, phase_known=phase_known)
    observation = Observation(background=background, hold_out=(4.0,) if held_out else ())
    return rsgen.identify(seen, Model(elements, MASS if mass_known else None, observation))


def _identify_case(name: str, noise: float) -> rsgen.Identification:
    case = rsgen.load_case(ROOT / "cases" / f"{name}.toml")
    test = replace(case.test, noise_relative=noise, seed=1)
    return rsgen.identify(rsgen.simulate(case.oscillator, test), case.model)


def _identify_measured(name: str) -> rsgen.Identification:
    case = rsgen.load_case(ROOT / "tests" / "cases" / f"{name}.toml", data=Path(os.environ["RSGEN_DATA"]))
    return rsgen.identify(read_measurement(case.test), case.model)


PAPER = ("bilinear", "combined", "coulomb", "cubic", "cubic-hardening", "joint", "piecewise", "quintic")
MEASURED = {"bouc_wen": "bouc_wen", "clamp": "frid_clamp", "f16": "f16", "nlbeam": "nlbeam", "wire": "wire"}
"""Cases and the folders of their data."""

RANDOM = 50
OFTEN = 20
"""Of the random ones in `make test`: every law twice."""


def numbers(identified: Callable[[], rsgen.Identification]) -> Tree:
    found = identified()
    stages = ("refined", "first_order", "paper")
    return {"noise": found.noise} | {each: trees.plain_estimates(getattr(found, each)) for each in stages}


IDENTIFICATIONS: dict[str, Callable[[], rsgen.Identification]] = {
    **{
        f"case/{name}/{kind}": partial(_identify_case, name, noise)
        for name in PAPER
        for kind, noise in (("exact", 0.0), ("noisy", 0.01))
    },
    **{f"measured/{name}": partial(_identify_measured, name) for name in MEASURED},
    **{f"random/{seed:02d}": partial(identify_draw, seed) for seed in range(RANDOM)},
}

OF_MEASURED = 3e-4
"""Of a standard error: of the many parameters of measured tests those of the F-16 move by 1.2e-4 between
processors, and their standard errors by 1.0e-4."""

LAST_STEP = 1e-12
"""Of the response: exact data has as noise what the last step of a fit leaves. It differs from processor to
processor, and standard errors with it."""

NUMBERS = stored("identifications")


def _pin(key: str) -> Pin:
    data = MEASURED.get(key.split("/")[1], "")
    noise = NUMBERS.get(key, {}).get("noise") or 1.0
    allowed = replace(
        SMOOTH, of_standard_error=OF_MEASURED if data else SMOOTH.of_standard_error,
        error=OF_MEASURED if data else max(SMOOTH.error, LAST_STEP / noise), left=LAST_STEP,
    )  # fmt: skip
    rarely = key == "measured/f16" or key >= f"random/{OFTEN}"
    return Pin(partial(numbers, IDENTIFICATIONS[key]), allowed, slow=True, thorough=rarely, data=data)


PINS = {key: _pin(key) for key in IDENTIFICATIONS}
