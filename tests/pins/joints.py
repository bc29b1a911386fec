"""Joints with pinned numbers: steady states, loops, identification."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import rsgen
from rsgen.data.oscillator import Model
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law
from rsgen.report.figures.equivalent import SAMPLES, loop_force, measured_loops
from rsgen.report.result_json import dissipation_entry
from tests.pins import trees
from tests.pins.grids import JOINT_MASS, JOINTS, LEVELS, NOISE, joint, joint_law, small_joint
from tests.pins.pinned import ACCURACY, SWITCHED, Pin, Tree
from tests.pins.trees import series

SIZES = np.array([5e-4, 2e-3, 8e-3])
"""Amplitudes [m] from sticking to sliding."""
STEPPED = replace(SWITCHED, value=1e-6)
"""Loops of states are closed over whole periods in steps, without locating where v changes its sign."""


def steady(name: str, start: bool = False) -> Tree:
    """Steady states of the joint from rest, or from a state given with what the joint remembers."""
    force, frequency = LEVELS.astype(complex), np.array([9.5, 10.5, 11.5])
    found = solve_steady_states(joint(name), force, frequency, harmonics=5, accuracy=ACCURACY)
    if start:
        found = solve_steady_states(
            joint(name), force, frequency - 0.2, harmonics=5, accuracy=ACCURACY, start=found.state
        )
    return {
        "harmonics": trees.columns(found.harmonics), "peak": series(found.peak),
        "displacement": series(found.state[:, 0], entries=3),
        "velocity": series(found.state[:, 1], entries=3), "settled": series(found.settled),
        "remembered": series(found.state[:, 2:3], float(np.abs(found.state[:, 2:]).max(initial=0.0)), 3),
    }  # fmt: skip


def balance(name: str) -> Tree:
    test = rsgen.SimulatedTest(LEVELS, np.array([9.5, 10.5, 11.5]), harmonics=5, method="harmonic-balance")
    return trees.surface(rsgen.simulate(joint(name), test))


def loops(name: str) -> Tree:
    """Force, slopes and work along closed loops with a third harmonic, as the fit samples them."""
    law = compile_law(joint_law(name).force)
    values = JOINTS[name][2]
    harmonics = np.zeros((3, 4), dtype=complex)
    harmonics[:, 1], harmonics[:, 3] = SIZES, 0.05j * SIZES
    motion = Motion(np.full(3, 60.0), harmonics)
    sample = law.along(motion, law.ordered(values), SAMPLES)
    return {
        "force": series(sample.force, entries=6),
        "by_parameter": {
            parameter: series(np.broadcast_to(part, sample.force.shape), entries=1)
            for parameter, part in zip(law.parameters, sample.by_parameter, strict=True)
        },
    }


def measured(name: str) -> Tree:
    """Loops as they were measured and as the law has them, and the energy of a cycle."""
    table = small_joint(name, NOISE)
    found = rsgen.identify(table, joint_law(name))
    rows = np.array([7, 22, 37])
    seen = measured_loops(table, rows, found.mass)
    return {
        "displacement": series(seen.displacement),
        "force": series(seen.force),
        "identified": series(loop_force(found.model, found.values, seen.motion)),
        "dissipation": dissipation_entry(table, found),
    }


def identified(name: str, noise: float = NOISE, mass: float | None = None) -> Tree:
    found = rsgen.identify(small_joint(name, noise), joint_law(name), mass=mass)
    whole = name == "jenkins" and mass is None
    return trees.whole_identification(found) if whole else trees.identification(found)


def _held_out() -> Tree:
    seen = rsgen.Observation(hold_out=(6.0,))
    found = rsgen.identify(small_joint("jenkins", NOISE), Model(joint_law("jenkins").elements, None, seen))
    (item,) = rsgen.predict(found, surface=small_joint("jenkins", NOISE)).held_out
    return trees.parts(item, "error largest_error", "predicted")


def _background() -> Tree:
    seen = rsgen.Observation(background="constant")
    return trees.fitted(small_joint("jenkins", NOISE), joint_law("jenkins"), seen)


def pin(compute: Callable[..., Tree], name: str, *about: Any) -> Pin:
    thorough = name in ("bouc-wen", "iwan4") and compute in (identified, measured)
    slow = compute is balance and name == "bouc-wen"
    allowed = STEPPED if compute in (balance, loops) else SWITCHED
    return Pin(partial(compute, name, *about), allowed, slow=slow, thorough=thorough)


PINS = {
    **{f"steady/{name}": pin(steady, name) for name in JOINTS},
    **{f"steady/{name}-from-state": pin(steady, name, True) for name in ("jenkins", "bouc-wen")},
    **{f"balance/{name}": pin(balance, name) for name in ("jenkins", "bouc-wen")},
    **{f"loops/{name}": pin(loops, name) for name in JOINTS},
    "surface/jenkins": Pin(lambda: trees.surface(small_joint("jenkins")), SWITCHED),
    **{f"measured/{name}": pin(measured, name) for name in ("jenkins", "iwan4")},
    **{f"identified/{name}": pin(identified, name) for name in JOINTS},
    "identified/jenkins-given-mass": pin(identified, "jenkins", NOISE, JOINT_MASS),
    "identified/jenkins-background": Pin(_background, SWITCHED, slow=True),
    "predicted/jenkins-held-out": Pin(_held_out, SWITCHED, slow=True),
}
