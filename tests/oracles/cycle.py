"""Projections of a law on a cycle by adaptive quadrature: shares nothing with rsgen but NumPy and SciPy."""

import numpy as np
from scipy.integrate import quad_vec

# a feature that is narrower than a panel may be missed: laws of engineers have none, laws at random seldom
PLACES = np.linspace(0, 2 * np.pi, 64)[1:-1] + 0.01


def relative_errors(law, X, mean, omega, stiffness, damping, least=1e-2):
    """Give the relative error of stiffness and damping, and the mean force, all against |n|; None: undefined.

    ``law`` takes x and v. ``least`` [N] is the force below which differences are round-off of the parts that
    cancel there (inside a gap); the laws tested have forces of about one.
    """

    def waves(phi):
        sine, cosine = np.sin(phi), np.cos(phi)
        with np.errstate(all="ignore"):
            force = float(law(mean + X * sine, omega * X * cosine))
        return force * np.array([sine, cosine, 1.0, np.sign(force)])

    (sine, cosine, level, size), _, found = quad_vec(
        waves, 0, 2 * np.pi, epsabs=1e-14, epsrel=1e-13, norm="max", points=PLACES, limit=2000,
        full_output=True,
    )  # fmt: skip
    # 1: so many panels do not suffice
    if found.status == 1 or not np.isfinite(size):
        return None
    scale = max(size, least)
    of_wave = max(abs(stiffness * np.pi * X - sine), abs(damping * np.pi * omega * X - cosine))
    return of_wave / scale, abs(level) / scale
