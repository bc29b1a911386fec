"""Small virtual tests that several tables of pins read; each is solved once."""

from functools import cache

import numpy as np

import rsgen
from rsgen.data.surface.response_surface import ResponseSurface
from tests import surfaces
from tests.pins.pinned import ACCURACY

LEVELS = np.array([3.0, 6.0, 10.0])
FREQUENCIES = np.linspace(8.6, 11.6, 15)
NOISE = 0.01

SMOOTH_LAWS = frozenset({"cubic", "quintic", "combined", "tanh", "power"})
"""Of ``tests.surfaces.LAWS``: without switches, or with some at zero speed and displacement only."""

FINE = 1e-9
"""Accuracy of motions of smooth laws: what simulators disagree about is then less than pins see."""


@cache
def small(law: str, noise: float = 0.0, seed: int = 1) -> ResponseSurface:
    """Three levels and fifteen frequencies of a law of ``tests.surfaces``, from rest."""
    if noise:
        return surfaces.noisy(small(law), noise, seed)
    accuracy = FINE if law in SMOOTH_LAWS else ACCURACY
    return surfaces.surface(law, LEVELS, FREQUENCIES, accuracy)


JOINT_MASS = 1.5
JOINTS: dict[str, tuple[str, dict[str, str], dict[str, float]]] = {
    "jenkins": ("k*x + c*v + masing(Min(kt*x, Fs))", {}, {"k": 5920.0, "c": 3.8, "kt": 3000.0, "Fs": 6.0}),
    "iwan": (
        "k*x + c*v + masing(Piecewise((K*x - K*x**2/(4*xs), x < 2*xs), (K*xs, True)))", {},
        {"k": 5920.0, "c": 3.8, "K": 3000.0, "xs": 2e-3},
    ),
    "iwan4": (
        "k*x + c*v + masing(Piecewise((x*(R*b**(chi + 1)/(chi + 1) + S)"
        " - R*x**(chi + 2)/((chi + 1)*(chi + 2)), x < b), (R*b**(chi + 2)/(chi + 2) + S*b, True)))", {},
        {"k": 5920.0, "c": 3.8, "R": 22000.0, "S": 400.0, "chi": -0.5, "b": 4e-3},
    ),
    "bouc-wen": (
        "k*x + c*v + z", {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"},
        {"k": 5920.0, "c": 3.8, "alpha": 3000.0, "bg": 300.0, "bd": -200.0},
    ),
    "dahl": ("k*x + c*v + Fc*z", {"z": "(v - z*abs(v))/xs"}, {"k": 5920.0, "c": 3.8, "Fc": 3.0, "xs": 1e-3}),
}  # fmt: skip
"""Beside a linear spring and damper; all slip at the levels of ``LEVELS``."""


def joint_law(name: str) -> rsgen.Law:
    force, memory, _ = JOINTS[name]
    return rsgen.Law(force, memory=memory) if memory else rsgen.Law(force)


def joint(name: str) -> rsgen.Oscillator:
    return rsgen.Oscillator(JOINT_MASS, joint_law(name), JOINTS[name][2])


@cache
def small_joint(name: str, noise: float = 0.0) -> ResponseSurface:
    """The grid of ``small`` for a joint, with harmonics up to the ninth."""
    if noise:
        return surfaces.noisy(small_joint(name), noise, 1)
    test = rsgen.SimulatedTest(LEVELS, np.linspace(8.6, 13.0, 15), harmonics=9, accuracy=ACCURACY)
    return rsgen.simulate(joint(name), test)
