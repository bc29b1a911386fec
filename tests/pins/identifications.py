"""Identifications with pinned numbers: cases of the paper, measured tests, fifty random ones with noise.

``python -m tests.pins.identifications --renew "reason" id ...`` computes the pins of these ids anew and
writes the reason beside each; ``make test`` compares all of them with numbers.json.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import rsgen
from rsgen.data.oscillator import Model, Observation
from rsgen.files import read_measurement

ROOT = Path(__file__).parents[2]
NUMBERS = Path(__file__).with_name("numbers.json")
MASS = 1.5

LAWS: dict[str, tuple[str, dict[str, float]]] = {
    "cubic-quadratic": ("k3*x**3 + cq*v*abs(v)", {"k3": -2.0e5, "cq": 1.2}),
    "cubic-coulomb": ("k3*x**3 + Ff*sign(v)", {"k3": 2.0e5, "Ff": 0.5}),
    "cubic-quintic": ("k3*x**3 + k5*x**5", {"k3": -2.0e5, "k5": 1.5e8}),
    "cubic-cubic-damper": ("k3*x**3 + c3*v**3", {"k3": 2.0e5, "c3": 0.4}),
    "power": ("kp*abs(x)**p*sign(x)", {"kp": 5.0e4, "p": 2.4}),
    "stiffening-drag": ("k2*x*abs(x) + cq*v*abs(v)", {"k2": 3.0e4, "cq": 1.0}),
    "quadratic-cubic": ("k2*x**2 + k3*x**3", {"k2": 2.0e4, "k3": 4.0e5}),
    "gap": (
        "Piecewise((kd*(x - b), x > b), (kd*(x + b), x < -b), (0, True))",
        {"kd": 900.0, "b": 0.012},
    ),
    "bilinear": ("Piecewise((kb*x, x > 0), (0, True)) + k3*x**3", {"kb": 900.0, "k3": 2.0e5}),
    "tanh-friction": ("A*tanh(v/w) + k3*x**3", {"A": 0.6, "w": 0.3, "k3": -1.5e5}),
}
"""Terms that are added to k*x + c*v, with typical values [SI] for motions of 5 to 50 mm near 10 Hz."""

AMPLITUDES_SUFFICE = {
    "cubic-quadratic",
    "cubic-coulomb",
    "cubic-quintic",
    "cubic-cubic-damper",
    "stiffening-drag",
}
"""Symmetric laws without exponents and widths; the search for those takes half a minute without phase."""

BACKGROUNDS = ("none", "phase", "constant", "residuals")
NOISES = (0.0, 0.001, 0.01, 0.03)


@dataclass(frozen=True)
class Draw:
    """One random identification: what was tested, how it was measured, and what identification may know."""

    law: str
    values: dict[str, float]
    background: str
    phase_known: bool
    noise: float
    mass_known: bool
    hold_out: bool
    seed: int


def draw(seed: int) -> Draw:
    """The random identification of this seed; every law comes up five times."""
    generator = np.random.default_rng([20261122, seed])
    law = list(LAWS)[seed % len(LAWS)]
    typical = {"k": 5920.0, "c": 3.8, **LAWS[law][1]}
    values = {name: value * generator.uniform(0.8, 1.25) for name, value in typical.items()}
    # a test without phase knows a constant background, but no error of the phase
    phase_known = bool(generator.uniform() < 0.6) or law not in AMPLITUDES_SUFFICE
    kinds = BACKGROUNDS if phase_known else ("none", "constant")
    return Draw(
        law=law,
        values=values,
        background=str(generator.choice(kinds)),
        phase_known=phase_known,
        noise=float(generator.choice(NOISES)),
        mass_known=bool(generator.uniform() < 0.2),
        hold_out=bool(generator.uniform() < 0.2),
        seed=seed,
    )


def identify_draw(case: Draw) -> rsgen.Identification:
    """Simulate, add the background, add noise, forget the phase, identify."""
    elements = (rsgen.make_element("law", f"k*x + c*v + {LAWS[case.law][0]}"),)
    levels = np.array([2.0, 4.0, 7.0, 10.0])
    test = rsgen.SimulatedTest(level=levels, frequency=np.linspace(8, 12, 21), harmonics=5, accuracy=1e-7)
    surface = rsgen.simulate(rsgen.Oscillator(MASS, elements, case.values), test)
    generator = np.random.default_rng([20261122, case.seed, 1])

    def noise(shape: tuple[int, ...]) -> np.ndarray:
        parts = generator.standard_normal((*shape, 2))
        return case.noise / np.sqrt(2) * (parts[..., 0] + 1j * parts[..., 1])

    b0 = 2e-4 * np.exp(1j * generator.uniform(-np.pi, np.pi)) if case.background != "phase" else 0.0
    b1 = 0.5 * np.exp(1j * generator.uniform(-np.pi, np.pi)) if case.background == "residuals" else 0.0
    psi = generator.uniform(-0.5, 0.5)
    force, harmonics = np.array(surface.force), np.array(surface.harmonics)
    omega = 2 * np.pi * surface.frequency
    if case.background != "none":
        harmonics[:, 1] += (b0 + b1 / omega**2) * force
        force = force * np.exp(-1j * psi)
    size = np.abs(harmonics[:, 1])[:, None]
    harmonics = harmonics + size * noise(harmonics.shape)
    harmonics[:, 0] = harmonics[:, 0].real
    force = force + np.abs(force) * noise(force.shape)
    if not case.phase_known:
        amplitude = np.abs(harmonics[:, 1])
        harmonics = np.zeros((len(amplitude), 2), dtype=complex)
        harmonics[:, 1] = amplitude
        force = np.abs(force).astype(complex)
    seen = replace(surface, force=force, harmonics=harmonics, phase_known=case.phase_known)
    observation = Observation(background=case.background, hold_out=(4.0,) if case.hold_out else ())
    return rsgen.identify(seen, Model(elements, MASS if case.mass_known else None, observation))


def _identify_case(name: str, noise: float) -> rsgen.Identification:
    case = rsgen.load_case(ROOT / "cases" / f"{name}.toml")
    test = replace(case.test, noise_relative=noise, seed=1)
    return rsgen.identify(rsgen.simulate(case.oscillator, test), case.model)


def _identify_measured(name: str) -> rsgen.Identification:
    case = rsgen.load_case(ROOT / "tests" / "cases" / f"{name}.toml", data=Path(os.environ["RSGEN_DATA"]))
    return rsgen.identify(read_measurement(case.test), case.model)


PAPER = ("bilinear", "combined", "coulomb", "cubic", "cubic-hardening", "joint", "piecewise", "quintic")
MEASURED = ("bouc_wen", "clamp", "f16", "nlbeam", "wire")
RANDOM = 50

IDS = (
    *(f"case/{name}/{noise}" for name in PAPER for noise in ("exact", "noisy")),
    *(f"measured/{name}" for name in MEASURED),
    *(f"random/{seed:02d}" for seed in range(RANDOM)),
)


def identify(key: str) -> rsgen.Identification:
    """Repeat the identification of this id."""
    kind, name, *rest = key.split("/")
    if kind == "case":
        return _identify_case(name, 0.01 if rest == ["noisy"] else 0.0)
    return _identify_measured(name) if kind == "measured" else identify_draw(draw(int(name)))


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def numbers_of(found: rsgen.Identification) -> dict[str, Any]:
    """All numbers that are pinned; null where a parameter is not identifiable."""
    stages = {"refined": found.refined, "first_order": found.first_order, "paper": found.paper}
    return {
        **{
            stage: {e.name: [_number(e.value), _number(e.standard_error)] for e in estimates}
            for stage, estimates in stages.items()
        },
        "noise": _number(found.noise),
        "mass": _number(found.mass),
    }


def compute(key: str) -> dict[str, Any]:
    """The numbers of one id, or the kind of error with which rsgen refuses it."""
    try:
        return numbers_of(identify(key))
    except rsgen.RsgenError as error:
        return {"refused": type(error).__name__}


def read() -> dict[str, dict[str, Any]]:
    """All pins by id."""
    return json.loads(NUMBERS.read_text(encoding="utf-8"))


def write(pins: dict[str, dict[str, Any]]) -> None:
    """Write all pins, a line each."""
    lines = [f"{json.dumps(key)}: {json.dumps(pins[key], allow_nan=False)}" for key in IDS if key in pins]
    NUMBERS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def main() -> None:
    """Renew pins with a reason."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--renew", metavar="REASON", required=True, help="why these numbers may change")
    parser.add_argument("ids", nargs="+", choices=IDS, metavar="id")
    arguments = parser.parse_args()
    pins = read()
    for key in arguments.ids:
        pins[key] = {**compute(key), "renewed": arguments.renew}
    write(pins)


if __name__ == "__main__":
    main()
