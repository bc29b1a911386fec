"""Hand-made surfaces by first-order formulas: quick, plausible, and without the simulator."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rsgen.analysis.comparison import Comparison, Row
from rsgen.cases import Case
from rsgen.common.finding import Finding
from rsgen.data.oscillator import Model, Observation
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.virtual_test import SimulatedTest
from rsgen.formula import parse, symbol
from rsgen.identification.prediction import HeldOutLevel, Prediction, ResonanceCurve
from rsgen.identification.results import EquivalentCurve, Estimate, Identification, Resonance
from rsgen.law.element import Element
from rsgen.report.provenance import Subject
from rsgen.report.result_json import build_result, result_text

MASS, K1, KN1, C1 = 1.5, 5920.0, -2.2e5, 3.8
"""A softening cubic spring whose peak shifts by about 4 % at 12 N."""


def cubic_surface(
    levels: int = 8, frequencies: int = 61, sweep: str = "rest", *, gaps: bool = False
) -> ResponseSurface:
    """F^2 = X^2 ((k(X) - m omega^2)^2 + omega^2 c^2), the smallest root X (up: the largest)."""
    level, frequency = np.meshgrid(
        np.linspace(1, 12, levels), np.linspace(8.5, 11.5, frequencies), indexing="ij"
    )
    level, frequency = level.ravel(), frequency.ravel()
    omega = 2 * np.pi * frequency
    response = np.empty(len(level), dtype=complex)
    for i, (force, w) in enumerate(zip(level, omega, strict=True)):
        detuning, slope = K1 - MASS * w**2, 0.75 * KN1
        roots = np.roots([slope**2, 2 * slope * detuning, detuning**2 + (w * C1) ** 2, -(force**2)])
        squares = np.sort(roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real)
        square = squares[-1] if sweep == "up" else squares[0]
        response[i] = force / (K1 + slope * square - MASS * w**2 + 1j * w * C1)
    harmonics = np.zeros((len(level), 4), dtype=complex)
    harmonics[:, 1] = response
    surface = ResponseSurface(
        level=level,
        frequency=frequency,
        force=level.astype(complex),
        harmonics=harmonics,
        peak=np.stack([np.abs(response), -np.abs(response)], axis=1),
        sweep=sweep,
        residual=1e-9,
        error=1e-6,
        origin="simulated",
    )
    if gaps:
        surface = surface.select(np.random.default_rng(1).random(len(surface)) > 0.2)
    return surface


def cubic_model(hold_out: tuple[float, ...] = ()) -> Model:
    x, v = symbol("x"), symbol("v")
    spring = Element("spring", symbol("k1") * x + symbol("kn1") * x**3, ("k1", "kn1"))
    return Model(
        (spring, Element("damper", symbol("c1") * v, ("c1",))),
        mass=MASS,
        observation=Observation(hold_out=hold_out),
    )


def cubic_identification(surface: ResponseSurface) -> Identification:
    """Return what identification would hand on: the truth with errors of known size."""
    dynamic = surface.force / surface.harmonics[:, 1]
    stiffness, damping = dynamic.real + MASS * surface.omega**2, dynamic.imag / surface.omega

    def resonance(level: float) -> Resonance:
        points = np.flatnonzero(surface.level == level)
        i = points[np.argmax(surface.amplitude[points])]
        return Resonance(
            level=float(level),
            sweep=str(surface.sweep[i]),
            frequency=float(surface.frequency[i]),
            damping_ratio=float(damping[i] / (2 * MASS * surface.omega[i])),
            amplitude=float(surface.amplitude[i]),
            stiffness=float(stiffness[i]),
            damping=float(damping[i]),
        )

    def estimate(name: str, value: float, unit: str, error: float) -> Estimate:
        size = abs(value)
        return Estimate(
            name, value * (1 + error), size * 0.01, (value - 0.02 * size, value + 0.02 * size), unit
        )

    def estimates(error: float) -> tuple[Estimate, ...]:
        values = (("c1", C1, "N*s/m"), ("k1", K1, "N/m"), ("kn1", KN1, "N/m^3"))
        return tuple(estimate(*value, error) for value in values)

    counts = {"identified": 3, "parameters": 3, "used": 488, "points": 488, "levels": 4, "misfit": 1e-7}
    return Identification(
        model=cubic_model(),
        paper=estimates(2e-2),
        first_order=estimates(5e-3),
        refined=estimates(1e-7),
        first_order_bias=(0.0, 0.0, 0.0),
        covariance=np.diag([(0.002 * C1) ** 2, (0.002 * K1) ** 2, (0.01 * KN1) ** 2]),
        resonances=tuple(resonance(level) for level in surface.levels),
        curve=EquivalentCurve(
            amplitude=surface.amplitude,
            frequency=surface.frequency,
            level=surface.level,
            stiffness=stiffness,
            damping=damping,
            used=np.ones(len(surface), dtype=bool),
        ),
        residual=1e-7,
        noise=0.0,
        levels=surface.levels,
        amplitude_range=(float(surface.amplitude.min()), float(surface.amplitude.max())),
        frequency_range=(float(surface.frequency.min()), float(surface.frequency.max())),
        outcome=Finding("identified", "info", numbers=counts),
    )


def cubic_prediction(surface: ResponseSurface, held_out: tuple[float, ...] = ()) -> Prediction:
    """Resonance curves by the closed formula: choose X, solve for omega, folds included."""
    return Prediction(
        curves=tuple(_cubic_curve(float(level)) for level in surface.levels),
        held_out=tuple(_held_out(surface, level) for level in held_out),
        findings=(),
    )


def _cubic_curve(level: float) -> ResonanceCurve:
    amplitude = np.linspace(0.002, 0.9999 * level / (C1 * 55), 800)
    square = (K1 + 0.75 * KN1 * amplitude**2) / MASS
    half = C1**2 / (2 * MASS**2)
    inside = (square - half) ** 2 - square**2 + (level / (MASS * amplitude)) ** 2
    there = inside >= 0
    amplitude, square, inside = amplitude[there], square[there], inside[there]
    low, high = square - half - np.sqrt(inside), square - half + np.sqrt(inside)
    omega = np.sqrt(np.maximum(np.concatenate([low, high[::-1]]), 1.0))
    amplitude = np.concatenate([amplitude, amplitude[::-1]])
    order = np.gradient(omega)
    return ResonanceCurve(
        level=level,
        frequency=omega / (2 * np.pi),
        amplitude=amplitude,
        phase=np.full(omega.shape, np.pi / 2),
        stable=order > 0,
        extrapolated=np.zeros(omega.shape, dtype=bool),
        lower=0.98 * amplitude,
        upper=1.02 * amplitude,
        folds=np.array([[9.6, 0.05]]) if (order < 0).any() else np.empty((0, 2)),
    )


def _held_out(surface: ResponseSurface, level: float) -> HeldOutLevel:
    part = surface.select(surface.level == level)
    return HeldOutLevel(
        level=level,
        sweep=str(part.sweep[0]),
        frequency=part.frequency,
        measured=part.harmonics[:, 1],
        predicted=1.01 * part.harmonics[:, 1],
        error=0.01,
        largest_error=0.01,
        missing=0,
    )


def cubic_case(title: str = "Softening cubic spring", **changes: Any) -> Case:
    """A case as its file would give it."""
    values: dict[str, Any] = {
        "path": Path("cubic.toml"),
        "name": "cubic",
        "title": title,
        "source": "Liu et al., Eqs. (13), (14)",
        "text": 'schema = 1\nname = "cubic"\n',
        "sha256": "0" * 64,
        "oscillator": None,
        "model": cubic_model(),
        "test": SimulatedTest(level=np.linspace(1, 12, 8), frequency=np.linspace(8.5, 11.5, 61)),
        "truth": {"m": MASS, "k1": K1, "kn1": KN1, "c1": C1},
        "printed": {"stiffness": parse("k1 + 3/4*kn1*X**2"), "damping": parse("c1")},
    }
    return Case(**{**values, **changes})


def cubic_comparison(identification: Identification, tolerance: float | None = 1e-6) -> Comparison:
    """Every estimate against the truth."""
    truth = {"k1": K1, "kn1": KN1, "c1": C1}
    rows = []
    estimates = zip(identification.paper, identification.first_order, identification.refined, strict=True)
    for paper, first, refined in estimates:
        true = truth[refined.name]
        errors = [abs(estimate.value / true - 1) for estimate in (refined, paper, first)]
        passed = tolerance is None or errors[0] <= tolerance
        rows.append(Row(refined.name, refined.unit, true, paper, first, refined, *errors, tolerance, passed))
    return Comparison(tuple(rows), all(row.passed for row in rows))


def cubic_result(
    tolerance: float | None = 1e-6,
    *findings: Finding,
    held_out: tuple[Finding, ...] = (),
    name: str = "cubic",
) -> dict[str, Any]:
    """Return what result.json says of the case, with findings of the test and of the levels held out."""
    surface = cubic_surface()
    found = replace(cubic_identification(surface), findings=findings)
    prediction = replace(cubic_prediction(surface), findings=held_out)
    subject = Subject.of_case(cubic_case(name=name), found)
    parts = (subject, surface, found, cubic_comparison(found, tolerance), prediction, ())
    content: dict[str, Any] = json.loads(result_text(build_result(*parts, {"surface": 1.0})))
    return content


def write_result(folder: Path, result: dict[str, Any], name: str = "cubic") -> Path:
    """Write a result where a run writes that of a case; return its folder."""
    place = folder / name
    place.mkdir(parents=True)
    (place / "result.json").write_text(json.dumps({**result, "case": name}), encoding="utf-8")
    return place
