"""Numbers that several steps of an identification decide with, each with its reason."""

from __future__ import annotations

__all__ = [
    "ANY_LAW", "BLOCK", "CHANCE", "CONFIDENCE", "EXCESS", "FLAT", "MOVE", "NOISY", "NORMAL", "NOTICEABLE",
    "NULL_PART", "OUTLIERS", "QUICK", "ROUND_OFF", "SAMPLES", "SAMPLES_SWITCHED", "SIGMAS", "SIGNIFICANT",
    "STIFFENING", "TURNED",
]  # fmt: skip

ANY_LAW = "k*x + k3*x**3 + k5*x**5 + c*v + c3*v**3 + c5*v**5"
"""Any law at one harmonic, roughly: enough to find phase error and background before a law is tried."""

BLOCK = 384
"""Points worked on at once: their sample arrays stay in the processor's cache."""

CHANCE = 4.0
"""Standard deviations that chance exceeds to one side once in 30 000: what is farther off is no noise."""

CONFIDENCE = 0.975
"""One-sided probability of every interval and band: 95 % between both ends."""

EXCESS = 1.5
"""Ratio of two estimates of one noise that chance reaches with a few points only."""

FLAT = 0.05
"""Where force or response grows less than this with the other, both relative, Newton's step is no guide."""

MOVE = 1e-3
"""Relative change by which derivatives of simulated responses are taken; their error is as large."""

NOISY = 1e-4
"""Above this misfit, relative, it is noise (simulators and truncated waveforms stay below), and the
O(noise^2) bias, a ten-thousandth of it and more, is corrected."""

NORMAL = 1.96
"""Standard errors to both ends of a 95 % interval, where many points determine them."""

NOTICEABLE = 1e-3
"""Misfits below this, relative, change no engineering number: a law may be as wrong."""

NULL_PART = 1e-3
"""A parameter with a larger part in a null vector is not identifiable; smaller parts are round-off."""

OUTLIERS = 0.2
"""At most this share of the points is set aside; if more disagree, it is the law that does not fit."""

QUICK = 400
"""Points that suffice to come near the estimate; all points then need one or two steps more."""

ROUND_OFF = 1e-12
"""An effect, relative to the largest, that is only round-off of doubles through a thousand operations."""

SAMPLES = 64
"""A period: exact for polynomials up to the seventh power of nine harmonics."""

SAMPLES_SWITCHED = 256
"""A period, where the law has switches: shares of an interval leave an error of its square."""

SIGMAS = 8.0
"""Standard deviations beyond which a point among any number of them is not where it is by noise."""

SIGNIFICANT = 25.0
"""Gain in the sum of squares, in units of the noise, that a free parameter must bring to be believed: five
standard deviations, a false alarm in two million."""

STIFFENING = 1e-7
"""Weight of the curvature of a spline: settles it where there are no points, without effect elsewhere."""

TURNED = 0.785
"""A phase error beyond an eighth of a turn [rad] is no amplifier: half way to the quarter by which another
quantity differs; a reversed sign is off by a half."""
