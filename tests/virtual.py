"""Virtual tests as a user makes and reads them, and the one finding of a code."""

import numpy as np

import rsgen
from rsgen import Finding, Oscillator, ResponseSurface, SimulatedTest, simulate


def simulated(law, values, levels, band, mass=1.5, **how) -> ResponseSurface:
    """Simulate a test at levels, over a band of lowest and highest frequency [Hz] and their number."""
    plan = SimulatedTest(level=levels, frequency=np.linspace(*band), **how)
    return simulate(Oscillator(mass, law, values), plan)


def multisine(law, values, levels, mass=1.5, *, period=2.0, **how) -> rsgen.MultisineSpectra:
    """Simulate records of levels [N] or [m/s^2], rms, with lines from 2.5 to 20 Hz."""
    return simulate(Oscillator(mass, law, values), rsgen.MultisineTest(levels, (2.5, 20.0), period, **how))


def fundamentals(table: ResponseSurface, response=None, force=None, **more) -> ResponseSurface:
    """The four columns of a test, with another response or force, and what is not measured by default."""
    response = table.harmonics[:, 1] if response is None else response
    force = table.force if force is None else force
    return ResponseSurface(more.pop("level", table.level), table.frequency, force, response, **more)


def only(found: object, code: str) -> Finding:
    """Return the one finding of a code."""
    (finding,) = (one for one in found.findings if one.code == code)  # type: ignore[attr-defined]
    return finding
