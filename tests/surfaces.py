"""Small virtual tests for identification: exact steady states, and noise on top of them."""

import functools
from dataclasses import fields

import numpy as np

from rsgen import Identification, Oscillator, ResponseSurface, SimulatedTest, identify, make_element, simulate
from rsgen.data.oscillator import Model, Observation

LAWS: dict[str, tuple[str, dict[str, float]]] = {
    "cubic": ("k*x + kn*x**3 + c*v", {"k": 5920.0, "kn": -2.2e5, "c": 3.8}),
    "quintic": ("k*x + kn*x**5 + c*v", {"k": 5920.0, "kn": 4e8, "c": 3.8}),
    "coulomb": ("k*x + c*v + Ff*sign(v)", {"k": 5920.0, "c": 3.8, "Ff": 0.8}),
    "piecewise": (
        "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True)) + c*v",
        {"k4": 5920.0, "k5": 7000.0, "b": 0.01, "c": 3.8},
    ),
    "bilinear": ("Piecewise((k6*x, x > 0), (k7*x, True)) + c*v", {"k6": 5000.0, "k7": 7000.0, "c": 3.8}),
    "combined": ("k*x + kn*x**3 + c*v + cn*v*abs(v)", {"k": 5920.0, "kn": 3e5, "c": 2.0, "cn": 1.2}),
    "power": ("k*x + kp*abs(x)**q*sign(x) + c*v", {"k": 5920.0, "kp": 5e4, "q": 2.4, "c": 3.8}),
    "tanh": ("k*x + c*v + A*tanh(v/w)", {"k": 5920.0, "c": 3.8, "A": 0.7, "w": 0.3}),
    "two-gaps": (
        "k*x + c*v + Piecewise((0, x < b1), (k1*(x - b1), True))"
        " + Piecewise((0, x > -b2), (k2*(x + b2), True))",
        {"k": 5920.0, "k1": 1000.0, "k2": 2000.0, "b1": 0.01, "b2": 0.015, "c": 3.8},
    ),
}
MASS = 1.5
ACCURACY = 1e-7
Grid = tuple[float, ...]


def model(law: str, mass: float | None = None, hold_out: tuple[float, ...] = ()) -> Model:
    return Model((make_element("law", LAWS[law][0]),), mass, Observation(hold_out=hold_out))


def truth(law: str) -> dict[str, float]:
    """Its values, with the mass."""
    return {**LAWS[law][1], "m": MASS}


def surface(law, levels=None, frequencies=None, accuracy=ACCURACY, values=None) -> ResponseSurface:
    """Steady states from rest over a small grid, each solved once."""
    levels = np.linspace(2, 12, 6) if levels is None else levels
    frequencies = np.linspace(8, 12, 41) if frequencies is None else frequencies
    return _solve(law, tuple(levels), tuple(frequencies), accuracy, tuple((values or LAWS[law][1]).items()))


@functools.cache
def _solve(law: str, levels: Grid, frequencies: Grid, accuracy: float, values: tuple) -> ResponseSurface:
    test = SimulatedTest(levels, frequencies, harmonics=7, accuracy=accuracy)
    return simulate(Oscillator(MASS, LAWS[law][0], dict(values)), test)


def changed(table: ResponseSurface, **columns: object) -> ResponseSurface:
    return ResponseSurface(**{f.name: getattr(table, f.name) for f in fields(table)} | columns)


def joined(*tables: ResponseSurface) -> ResponseSurface:
    """The points of several surfaces, one after the other."""
    names = [f.name for f in fields(tables[0]) if isinstance(getattr(tables[0], f.name), np.ndarray)]
    columns = {name: np.concatenate([getattr(one, name) for one in tables]) for name in names}
    return changed(tables[0], **columns)


def beside(table: ResponseSurface, motion: np.ndarray | complex, **columns: object) -> ResponseSurface:
    """The same surface, a motion [m] added to each fundamental, with some columns replaced."""
    harmonics = np.array(table.harmonics)
    harmonics[:, 1] += motion
    return changed(table, harmonics=harmonics, **columns)


def noisy(table: ResponseSurface, relative: float, seed: int) -> ResponseSurface:
    """Complex Gaussian noise on the force and on every harmonic, relative to |F| and |X_1|."""
    generator = np.random.default_rng(seed)

    def noise(shape: tuple[int, ...]) -> np.ndarray:
        return (generator.normal(size=shape) + 1j * generator.normal(size=shape)) / np.sqrt(2)

    harmonics = table.harmonics + relative * table.amplitude[:, None] * noise(table.harmonics.shape)
    harmonics[:, 0] = harmonics[:, 0].real
    return changed(table, harmonics=harmonics, force=table.force * (1 + relative * noise((len(table),))))


def distorted(table: ResponseSurface) -> ResponseSurface:
    """A shaker whose third harmonic is 2 % of its force, as a linear spring and ``MASS`` respond to it."""
    force, harmonics = np.zeros((len(table), 4), dtype=complex), np.array(table.harmonics)
    force[:, 1], force[:, 3] = table.force, 0.02j * table.force
    harmonics[:, 3] += force[:, 3] / (5920.0 - 9 * MASS * table.omega**2)
    return ResponseSurface(table.level, table.frequency, force, harmonics, sweep="rest")


def without_phase(table: ResponseSurface) -> ResponseSurface:
    """What an instrument keeps that shows amplitudes only."""
    sizes = np.zeros((len(table), 2), dtype=complex)
    sizes[:, 1] = table.amplitude
    return changed(table, harmonics=sizes, force=np.abs(table.force).astype(complex), phase_known=False)


@functools.cache
def identified(law: str, noise: float = 0.0, seed: int = 1) -> Identification:
    """The law identified from its own surface, once for all tests that look at the result."""
    table = surface(law)
    return identify(noisy(table, noise, seed) if noise else table, model(law))


def errors(found: Identification, true: dict[str, float], stage: str = "") -> dict[str, float]:
    """Relative errors of the values that are known, of any stage that is named; infinite of no number."""
    by_name = {e.name: e for e in getattr(found, stage)} if stage else found
    off = {name: abs(by_name[name].value / value - 1) for name, value in true.items()}
    return {name: np.inf if np.isnan(error) else error for name, error in off.items()}


def distances(found: Identification, true: dict[str, float]) -> np.ndarray:
    """Errors of the same values in their standard errors."""
    return np.array(
        [(found[name].value - value) / found[name].standard_error for name, value in true.items()]
    )


def codes(found: object) -> set[str]:
    return {finding.code for finding in found.findings}  # type: ignore[attr-defined]


def severities(found: object) -> dict[str, str]:
    return {finding.code: finding.severity for finding in found.findings}  # type: ignore[attr-defined]
