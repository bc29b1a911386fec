"""Surfaces by first-order formulas: quick, and without the simulator; what is identified from them."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rsgen
from rsgen import Case, Comparison, Identification, Prediction, ResponseSurface, SimulatedTest, make_element
from rsgen.data.oscillator import Model, Observation
from rsgen.formula.reading import parse
from rsgen.report import draw_all
from rsgen.report.figures import Drawing
from rsgen.report.provenance import Subject
from rsgen.report.result_json import Parts, build_result, result_text

MASS, K1, KN1, C1 = 1.5, 5920.0, -2.2e5, 3.8
"""A softening cubic spring whose peak shifts by about 4 % at 12 N."""


@cache
def cubic_surface(levels: int = 8, frequencies: int = 61, sweep: str = "rest", *, gaps: bool = False):
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
        level=level, frequency=frequency, force=level.astype(complex), harmonics=harmonics,
        peak=np.stack([np.abs(response), -np.abs(response)], axis=1), sweep=sweep, residual=1e-9, error=1e-6,
        origin="simulated",
    )  # fmt: skip
    if gaps:
        surface = surface.select(np.random.default_rng(1).random(len(surface)) > 0.2)
    return surface


def cubic_model(hold_out: tuple[float, ...] = ()) -> Model:
    elements = (make_element("spring", "k1*x + kn1*x**3"), make_element("damper", "c1*v"))
    return Model(elements, mass=MASS, observation=Observation(hold_out=hold_out))


@cache
def cubic_identification(surface: ResponseSurface, hold_out: tuple[float, ...] = ()) -> Identification:
    """What is identified from the surface, with no finding about it."""
    return replace(rsgen.identify(surface, cubic_model(hold_out)), findings=())


@cache
def cubic_prediction(surface: ResponseSurface, held_out: tuple[float, ...] = ()) -> Prediction:
    """Resonance curves of every level, with no finding about them."""
    found = cubic_identification(surface, held_out)
    return replace(rsgen.predict(found, None, surface), findings=())


def cubic_case(title: str = "Softening cubic spring", **changes: Any) -> Case:
    values: dict[str, Any] = {
        "path": Path("cubic.toml"), "name": "cubic", "title": title, "source": "Liu et al., Eqs. (13), (14)",
        "text": 'schema = 1\nname = "cubic"\n', "sha256": "0" * 64, "oscillator": None,
        "model": cubic_model(),
        "test": SimulatedTest(level=np.linspace(1, 12, 8), frequency=np.linspace(8.5, 11.5, 61)),
        "truth": {"m": MASS, "k1": K1, "kn1": KN1, "c1": C1},
        "printed": {"stiffness": parse("k1 + 3/4*kn1*X**2"), "damping": parse("c1")},
    }  # fmt: skip
    return Case(**{**values, **changes})


def cubic_comparison(identification: Identification, tolerance: float | None = 1e-2) -> Comparison:
    truth = {"k1": K1, "kn1": KN1, "c1": C1}
    accept = None if tolerance is None else dict.fromkeys(truth, tolerance)
    return rsgen.compare(identification, truth, accept)


@cache
def _samples() -> tuple[ResponseSurface, Identification, Prediction]:
    surface = cubic_surface()
    return surface, cubic_identification(surface), cubic_prediction(surface)


def cubic_result(tolerance=0.01, *findings, held_out=(), name="cubic") -> dict[str, Any]:
    """Return what result.json says of the case, with findings of the test and of the levels held out."""
    surface, found, prediction = _samples()
    found, prediction = replace(found, findings=findings), replace(prediction, findings=held_out)
    subject = Subject.of_case(cubic_case(name=name), found)
    parts = Parts(subject, surface, found, cubic_comparison(found, tolerance), prediction)
    content: dict[str, Any] = json.loads(result_text(build_result(parts, {"surface": 1.0})))
    return content


@cache
def empty_drawings() -> list[Drawing]:
    """Figures of the case with their names and captions, without pictures: for tests of text."""
    surface, found, prediction = _samples()
    drawn = draw_all(Subject.of_case(cubic_case(), found), surface, found, prediction)
    return [Drawing(one.name, Figure(), one.caption, alternative=one.alternative) for one in drawn]


def write_result(folder: Path, result: dict[str, Any], name: str = "cubic") -> Path:
    """Write a result where a run writes that of a case; return its folder."""
    place = folder / name
    place.mkdir(parents=True)
    (place / "result.json").write_text(json.dumps({**result, "case": name}), encoding="utf-8")
    return place
