"""A law tried before a run: derived, written as a kernel, and evaluated next to rest."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise, product

import numpy as np

from rsgen.cases import Case
from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Oscillator
from rsgen.data.planned_test import PlannedTest
from rsgen.describing import derive
from rsgen.dynamics.kernel_source import generate
from rsgen.dynamics.virtual_test import free_mean_fault
from rsgen.formula import symbol, write
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import Structural
from rsgen.law.element import Element
from rsgen.law.memory import memory_form
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law

_NEAR = 1e-12
"""So near rest [m, m/s] every motion comes: a law must be a number there."""

_SIZES = np.geomspace(1e-12, 1e3, 61)
"""Amplitudes [m] from atoms to towers, four to a decade: gaps and corners act from some of them on."""

_SAMPLES = 256
"""Of a period: enough for the sign of a work or a stiffness."""

_ROUND_OFF = 1e-14
"""Work, relative to that of the largest forces on the way, that is only round-off of a sum of 256."""

_SAME = 1e-6
"""A state that differs by less after a cycle, relative to its largest value, is where it was: the error of
the rule at 256 steps is smaller."""

_FORGETS = 1e-9
"""Least relative fall, from cycle to cycle, of what a state is far from where it was: above round-off."""


def law_faults(case: Case) -> list[str]:
    """Say what would keep the laws of a case from being used; nothing where they can be.

    Reading a case checks texts and units, which is quick; this derives and compiles on trial, which takes
    a moment for each law that is new.

    Returns
    -------
    list of str
        One sentence a fault, ``file: element.N.force: what; what is allowed``.
    """
    faults = []
    for number, element in enumerate(case.model.elements, start=1):
        place = f"element.{number}"
        values = None if case.oscillator is None else case.oscillator.values
        if values is not None:
            faults += (wrong := _wrong_memory(place, element, values, case.test))
            if wrong:
                continue
        try:
            derive(element)
            if case.test.in_time or not element.force.has(Structural):
                generate(element.force)
        except RsgenError as fault:
            faults.append(f"{place}.force: {' '.join(str(fault).split())}")
            continue
        if values is not None:
            faults += [f"{place}.force: {text}" for text in _near_rest(element, values)]
    if not faults and case.oscillator is not None:
        drifts = free_mean_fault(case.oscillator, case.test)
        never = [drifts] if drifts else _never_settles(case.oscillator, case.test)
        faults += [f"element: {text}" for text in never]
    return [f"{case.path.name}: {fault}" for fault in faults]


def _never_settles(oscillator: Oscillator, test: PlannedTest) -> list[str]:
    """Say why no point of a virtual test can settle; only what is certain without simulating it."""
    if not test.settles:
        return []
    law = compile_law(oscillator.force)
    values = law.ordered(oscillator.values)
    largest = float(test.planned_levels.max())
    held = law.force(np.zeros(2), np.array([_NEAR, -_NEAR]), values)
    if held[0] >= largest and held[1] <= -largest:
        return [
            f"dry friction of {min(held[0], -held[1]):.4g} N holds the mass at every level; a level above it "
            "is needed"
        ]
    _, work, push, round_off = _balance(oscillator, test)
    if np.all(work <= round_off):
        return [
            "no damping: the law takes no energy out of a motion of any amplitude, so that none settles; a "
            "damper whose force has the sign of v is needed"
        ]
    if np.all(push < 0):
        return [
            "negative stiffness: the law pushes the mass away at every amplitude, so that no motion settles; "
            "a spring whose force has the sign of x, at small or at large amplitudes, is needed"
        ]
    return []


def _balance(oscillator: Oscillator, test: PlannedTest) -> tuple[Array, Array, Array, Array]:
    """Amplitudes [m], work and push of the law on sines of all sizes, and what of the work is round-off."""
    law = compile_law(oscillator.force)
    values = law.ordered(oscillator.values)
    motion = _sines(test)
    x, v, _ = motion.waveforms(_SAMPLES)
    force = law.along(motion, values, _SAMPLES).force
    # no number, where the law overflows, is no evidence
    with np.errstate(over="ignore", invalid="ignore"):
        work, push = np.sum(force * v, axis=1), np.sum(force * x, axis=1)
        round_off = _ROUND_OFF * np.sum(np.abs(force * v), axis=1)
    return np.abs(motion.harmonics[:, 1]), work, push, round_off


def _sines(test: PlannedTest) -> Motion:
    """Sines of all sizes at the ends of the band; no sample is at rest or at a turning point."""
    size, omega = np.meshgrid(_SIZES, 2 * np.pi * test.ends, indexing="ij")
    start = np.exp(1j * np.pi / _SAMPLES)
    harmonics = np.stack([np.zeros(size.size), start * size.ravel()], axis=1)
    return Motion(omega.ravel(), harmonics)


def _wrong_memory(place: str, element: Element, values: Mapping[str, float], test: PlannedTest) -> list[str]:
    virgins = [f"{place}.force: {text}" for text in _wrong_virgins(element, values)]
    return [*virgins, *(f"{place}.memory.{text}" for text in _open_loops(element, values, test))]


def _wrong_virgins(element: Element, values: Mapping[str, float]) -> list[str]:
    """Say which virgin curves are negative at first, or not zero at zero, with the values of a case."""
    form = memory_form(element.force)
    places = np.append(0.0, _SIZES)
    faults = []
    for curve in () if form is None else form.curves:
        names = sorted(free.name for free in curve.virgin.free_symbols if free.name != "x")
        law = compiled((curve.virgin,), tuple(map(symbol, ("x", *names))))
        with np.errstate(all="ignore"):
            (found,) = law(places, *(np.full(places.shape, values[name]) for name in names))
        force = np.nan_to_num(np.broadcast_to(found, places.shape))
        first = int(np.argmax(force[1:] != 0)) + 1
        text = (
            f"masing({write(curve.virgin)[:200]}) is {{:.4g}} N at x = {{:.4g}} m with the values of [truth]"
        )
        if force[0] != 0:
            faults.append(f"{text.format(force[0], 0.0)}; a virgin curve must be zero at x = 0")
        elif force[first] < 0:
            faults.append(f"{text.format(force[first], places[first])}; a virgin curve must not be negative")
    return faults


def _open_loops(element: Element, values: Mapping[str, float], test: PlannedTest) -> list[str]:
    """Say which states never come back to where they were, on a sine of any size.

    Two cycles from rest are integrated (Runge-Kutta of order four). A state has a closed loop where it is
    back after the first, or has moved less in the second.
    """
    form = memory_form(element.force)
    if form is None or not form.rates:
        return []
    names = sorted(element.parameters)
    states = [rate.symbol for rate in form.rates]
    law = compiled(tuple(rate.rate for rate in form.rates), (*map(symbol, ("x", "v", *names)), *states))
    parameters = [values[name] for name in names]
    motion = _sines(test)
    size, omega = np.abs(motion.harmonics[:, 1]), motion.omega
    step = 2 * np.pi / omega / _SAMPLES

    def rates(phase: float, z: Array) -> Array:
        x, v = size * np.sin(phase), size * omega * np.cos(phase)
        return np.stack([np.broadcast_to(g, x.shape) for g in law(x, v, *parameters, *z)])

    z = np.zeros((len(states), len(size)))
    largest, ends = np.zeros(z.shape), [z]
    with np.errstate(all="ignore"):
        for _ in range(2):
            for i in range(_SAMPLES):
                now, half, then = (2 * np.pi * (i + part) / _SAMPLES for part in (0.0, 0.5, 1.0))
                first = rates(now, z)
                second = rates(half, z + step / 2 * first)
                third = rates(half, z + step / 2 * second)
                z = z + step / 6 * (first + 2 * second + 2 * third + rates(then, z + step * third))
                largest = np.maximum(largest, np.abs(z))
            ends.append(z)
        first, second = (np.abs(late - early) for early, late in pairwise(ends))
        # no number, where the rule is unstable, is no evidence
        opens = (first > _SAME * largest) & (second >= (1 - _FORGETS) * first)
        unknown = ~np.isfinite(first + second)
    return [
        f"{state}: the loop does not close: {state} moves on from cycle to cycle at every amplitude; an "
        "equation under which it comes back is needed"
        for state, each, lost in zip(states, opens, unknown, strict=True)
        if np.all(each | lost) and not lost.all()
    ]


def _near_rest(element: Element, values: Mapping[str, float]) -> list[str]:
    law = compile_law(element.force)
    places = np.array([(0.0, 0.0), *product((_NEAR, -_NEAR), repeat=2)])
    forces = law.force(places[:, 0], places[:, 1], law.ordered(values))
    # 0*log(0) is no number and yet goes to one
    wrong = np.flatnonzero(np.isinf(forces) | (np.isnan(forces) & (places != 0).any(axis=1)))
    if not len(wrong):
        return []
    x, v = places[wrong[0]]
    where = "at rest" if x == v == 0 else f"at x = {x:g} m, v = {v:g} m/s, next to rest"
    what = "infinite" if np.isinf(forces[wrong[0]]) else "not a number"
    return [
        f"{write(element.force)[:200]} is {what} {where}; a force must be finite for both signs of x and v"
    ]
