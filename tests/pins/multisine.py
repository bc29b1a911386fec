"""Multisine tests with pinned numbers: spectra, best linear approximation, identification, prediction."""

from functools import cache

import numpy as np

import rsgen
from rsgen.data.multisine.linear import BestLinear
from rsgen.identification.results import MultisineIdentification
from tests.multisine.test_multisine import LAW, SIZES, duffing, histories, spectra
from tests.multisine.test_simulated_multisine import LAWS, simulated
from tests.pins import trees
from tests.pins.grids import joint, joint_law
from tests.pins.pinned import SWITCHED, Pin, Tree
from tests.pins.trees import parts, series

NOISE = 0.01


@cache
def made(noise: float, periods: int) -> rsgen.MultisineSpectra:
    """Chosen motions of a spring with quadratic and cubic part; no simulator takes part."""
    return spectra(duffing, SIZES, noise=noise, periods=periods, seed=3, lines=128)


@cache
def virtual(name: str, noise: float = 0.0, lines: str = "odd") -> rsgen.MultisineSpectra:
    """A virtual test of a law of ``test_simulated_multisine`` at three levels."""
    return simulated(name, periods=4 if noise else 1, noise_relative=noise, lines=lines, seed=2)


def tree_of_spectra(read: rsgen.MultisineSpectra) -> Tree:
    force_noise, response_noise = read.noise()
    return {
        **parts(read, "omega0 periods mean_known", "exact"), **parts(read, "", "level", entries=1),
        "force": series(read.mean_force), "response": series(read.mean_response),
        "force_noise": series(force_noise, entries=1), "response_noise": series(response_noise, entries=1),
        "rms_force": series(read.rms_force(), entries=1),
        "rms_response": series(read.rms_response(), entries=1), "excited": series(read.excited()),
        "reach": [series(part) for part in read.reach()],
        "left_out": series(read.left_out if read.left_out is not None else []),
        "findings": trees.findings(read.findings),
    }  # fmt: skip


def tree_of_linear(one: BestLinear) -> Tree:
    scale = float(one.response.max())
    unexcited = {
        name: parts(part, "", "response noise", scale, 1)
        for name, part in (("even", one.even), ("odd", one.odd))
        if part is not None
    }
    return {
        **parts(one, "level records natural_frequency damping_ratio stiffness mass rms", "receptance"),
        "response": series(one.response, entries=1), "noise_of_lines": series(one.noise, scale, 1),
        "distortion": series(one.distortion, scale, 1), **unexcited,
        "shares": {name: getattr(one, f"{name}_share") for name in ("distortion", "noise", "even", "odd")}
        | {"even_bound": one.even_bound, "odd_bound": one.odd_bound},
    }  # fmt: skip


def linear(read: rsgen.MultisineSpectra, band: tuple[float, float] | None = None) -> Tree:
    found = rsgen.best_linear(read, band)
    modes = [[one.level, one.natural_frequency, one.damping_ratio, one.mass] for one in found]
    return {"modes": modes, "highest": tree_of_linear(found[-1])}


def identified(
    read: rsgen.MultisineSpectra, law: object, *about: rsgen.Observation, mass: float | None = None
):
    found = rsgen.identify(read, law, *about, mass=mass)  # type: ignore[arg-type]
    assert isinstance(found, MultisineIdentification)
    scale = float(np.abs(read.mean_force).max())
    return trees.identification(found) | {
        "used": series(found.used),
        "misfit_of_lines": series(found.misfit, scale, 1),
        "deviation": series(found.deviation, scale, 0),
        "resonances": [[r.level, r.frequency, r.damping_ratio, r.amplitude] for r in found.resonances],
    }


def intervals(read: rsgen.MultisineSpectra, law: object, mass: float | None = None) -> Tree:
    return trees.estimates(rsgen.identify(read, law, mass=mass), whole=True)  # type: ignore[arg-type]


def predicted(read: rsgen.MultisineSpectra, law: str, held: float) -> Tree:
    found = rsgen.identify(read, law, rsgen.Observation(hold_out=(held,)))
    prediction = rsgen.predict(found)
    return {
        "records": [
            parts(one, "level error noise", "measured predicted judged") for one in prediction.records
        ],
        "findings": trees.findings(prediction.findings),
    }


def _blind() -> rsgen.MultisineSpectra:
    read = virtual("cubic", NOISE)
    return rsgen.MultisineSpectra(read.level, read.omega0, read.force, read.response, mean_known=False)


@cache
def _joint() -> rsgen.MultisineSpectra:
    test = rsgen.MultisineTest(
        np.array([8.0, 16.0]), (5.0, 15.0), 2.0, periods=3, noise_relative=NOISE, seed=4
    )
    return rsgen.simulate(joint("jenkins"), test)


def _record(quantity: str) -> rsgen.MultisineSpectra:
    decay = np.exp(-np.arange(1400) / 150.0)
    return rsgen.history.from_multisine(histories(8, decay, quantity))


def _realisations() -> rsgen.MultisineSpectra:
    return simulated("cubic", (4.0, 8.0), periods=2, realisations=2, noise_relative=NOISE, seed=7)


CUBIC, FRICTION, CORNER = (LAWS[name][0] for name in ("cubic", "friction", "corner"))
BAND = rsgen.Observation(band=(5.0, 15.0))

PINS = {
    "spectra/made-noisy": Pin(lambda: tree_of_spectra(made(NOISE, 4))),
    "spectra/virtual-cubic": Pin(lambda: tree_of_spectra(virtual("cubic"))),
    "spectra/virtual-noisy": Pin(lambda: tree_of_spectra(virtual("cubic", NOISE))),
    "spectra/virtual-realisations": Pin(lambda: tree_of_spectra(_realisations())),
    "spectra/virtual-friction": Pin(lambda: tree_of_spectra(virtual("friction")), SWITCHED, slow=True),
    "spectra/virtual-corner": Pin(lambda: tree_of_spectra(virtual("corner")), SWITCHED, slow=True),
    "spectra/virtual-jenkins": Pin(lambda: tree_of_spectra(_joint()), SWITCHED, slow=True),
    **{
        f"spectra/record-{quantity}": Pin(lambda quantity=quantity: tree_of_spectra(_record(quantity)))
        for quantity in ("displacement", "velocity", "acceleration")
    },
    "linear/exact": Pin(lambda: linear(virtual("cubic"))),
    "linear/noisy": Pin(lambda: linear(virtual("cubic", NOISE))),
    "linear/all-lines": Pin(lambda: linear(virtual("cubic", NOISE, "all"))),
    "linear/band": Pin(lambda: linear(virtual("cubic", NOISE), (5.0, 15.0))),
    "linear/realisations": Pin(lambda: linear(_realisations())),
    "linear/friction": Pin(lambda: linear(virtual("friction", NOISE)), SWITCHED, slow=True),
    "identified/made": Pin(lambda: identified(made(0.0, 1), LAW)),
    "identified/made-noisy": Pin(lambda: identified(made(NOISE, 4), LAW)),
    "identified/given-mass": Pin(lambda: identified(made(NOISE, 4), LAW, mass=1.5)),
    "identified/law-that-lacks": Pin(lambda: identified(made(NOISE, 4), "k*x + c*v")),
    "identified/one-period": Pin(lambda: identified(virtual("cubic"), CUBIC)),
    "identified/noisy": Pin(lambda: identified(virtual("cubic", NOISE), CUBIC)),
    "identified/band": Pin(lambda: identified(virtual("cubic", NOISE), CUBIC, BAND)),
    "identified/mean-unknown": Pin(lambda: identified(_blind(), CUBIC)),
    "identified/record-acceleration": Pin(lambda: identified(_record("acceleration"), "k*x + c*v")),
    "identified/friction": Pin(lambda: identified(virtual("friction", NOISE), FRICTION), SWITCHED),
    "identified/corner": Pin(lambda: identified(virtual("corner", NOISE), CORNER), SWITCHED, slow=True),
    "identified/jenkins": Pin(lambda: identified(_joint(), joint_law("jenkins")), SWITCHED, slow=True),
    "identified/background": Pin(
        lambda: identified(made(NOISE, 4), LAW, rsgen.Observation(background="constant"))
    ),
    "intervals/made-noisy": Pin(lambda: intervals(made(NOISE, 4), LAW)),
    "intervals/given-mass": Pin(lambda: intervals(made(NOISE, 4), LAW, 1.5)),
    "intervals/law-that-lacks": Pin(lambda: intervals(made(NOISE, 4), "k*x + c*v")),
    "intervals/friction": Pin(lambda: intervals(virtual("friction", NOISE), FRICTION), SWITCHED),
    "predicted/cubic": Pin(lambda: predicted(virtual("cubic", NOISE), CUBIC, 5.0)),
    "predicted/friction": Pin(lambda: predicted(virtual("friction", NOISE), FRICTION, 5.0), SWITCHED),
    "predicted/made": Pin(lambda: predicted(made(NOISE, 4), LAW, float(made(NOISE, 4).level[1]))),
}
