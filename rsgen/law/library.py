"""The library of laws: formulas, sources, parameters, and how a ranking tries each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True, slots=True)
class Range:
    """Where a ranking looks for a parameter in which a law is not linear.

    Parameters
    ----------
    scale
        "x": values are shares of the largest displacement; "v": of the largest velocity; "1/x": of the
        inverse of the largest displacement; "1": as they are.
    values
        Values to start from.
    limits
        Beyond these it changes the law into another one, or leaves the tested range.
    """

    scale: str
    values: tuple[float, ...]
    limits: tuple[float, float]

    def factor(self, size: float, speed: float) -> float:
        """SI value of 1 at largest displacement [m] and velocity [m/s]."""
        return {"x": size, "v": speed, "1/x": 1 / size, "1": 1.0}[self.scale]


@dataclass(frozen=True, slots=True)
class Search:
    """The way in which a ranking tries a law added to a linear spring and a linear damper.

    Parameters
    ----------
    formula
        What the law adds to ``k*x + c*v``; by default the law without its linear spring and damper.
    ranges
        Of the parameters in which that is not linear.
    dissipates
        Parameters whose sum must not be negative: friction that feeds energy is no candidate.
    spring
        True where the law has a stiffness at rest: the linear spring is then left out.
    memory
        g(x, v, z) of z' = g for the states in ``formula``.
    mirror
        True where the law of -x is another one, which is tried, too.
    """

    formula: str = ""
    ranges: Mapping[str, Range] = field(default_factory=dict, hash=False)
    dissipates: tuple[tuple[str, ...], ...] = ()
    spring: bool = False
    memory: Mapping[str, str] = field(default_factory=dict, hash=False)
    mirror: bool = False


LIU = "Liu et al., Parameter identification by response surface plotting"
GELB = "Gelb and Vander Velde, Multiple-Input Describing Functions (1968), App. B"
WORDEN = "Worden and Tomlinson, Nonlinearity in Structural Dynamics (2001), Ch. 2"
NAYFEH = "Nayfeh and Mook, Nonlinear Oscillations (1979)"


class Row(NamedTuple):
    """A law as the library keeps it.

    Parameters
    ----------
    title, formula, source
        Its name in words, its force, and where it is from.
    parameters
        Name, meaning and unit of each; where 1 shows little, the example value of pictures.
    search
        How rankings try it; None: not at all.
    own
        True if its describing function is in no source, but a derivation of rsgen.
    memory
        g(x, v, z) of z' = g for each state z in the formula.
    """

    title: str
    formula: str
    source: str
    parameters: tuple[tuple[str, str, str] | tuple[str, str, str, float], ...]
    search: Search | None = None
    own: bool = False
    memory: dict[str, str] | None = None


_ADDED = Search()
_GAP = ("b", "half the gap, positive", "m")
_SLOPE = ("k", "stiffness in contact", "N/m")
_AT_REST = ("k", "stiffness at rest", "N/m")
_CUBIC = ("k3", "cubic stiffness", "N/m^3")
_FRICTION = ("Ff", "friction force", "N")
_WITHOUT = ("k0", "stiffness without contact", "N/m")
_STRIBECK = (
    ("Fc", "sliding friction force", "N"),
    ("Fs", "friction force at the onset of sliding", "N", 2.0),
    ("vs", "Stribeck velocity, positive", "m/s"),
)

_BREAKS = tuple(np.geomspace(0.03, 0.96, 12))
"""Gaps as shares of the largest displacement: as fine at small ones, which small levels pass, as at
large."""
_SIDE = Range("x", _BREAKS[::2], (0.02, 0.99))
_SPEED = Range("v", tuple(np.geomspace(0.01, 1.0, 9)), (0.003, 3.0))
_SPEED_OF_STEP = Range("v", tuple(np.geomspace(0.001, 1.0, 12)), (1e-4, 3.0))
"""Of friction that becomes dry: steep in the smallest motions of a test, too."""
_POWER = Range("1", (0.3, 0.6, 1.4, 1.8, 2.2, 2.6, 3.5, 4.0, 6.0, 7.0), (0.1, 9.0))
_WAVE = Range("1/x", tuple(np.geomspace(0.4, 2.8, 8)), (0.1, 5.0))

_SLIP = Range("x", tuple(np.geomspace(0.003, 0.9, 12)), (0.001, 0.99))
"""Slips from the smallest motions of a test over several hundred to one in amplitude to its largest."""
_INVERSE = Range("1/x", (0.3, 1.0, 3.0, 10.0), (0.02, 100.0))
_SIGNED = Range("1/x", (-3.0, -0.5, 0.5, 3.0), (-100.0, 100.0))

_IWAN4 = (
    "Piecewise((x*(R*phimax**(chi + 1)/(chi + 1) + S) - R*x**(chi + 2)/((chi + 1)*(chi + 2)), x < phimax), "
    "(R*phimax**(chi + 2)/(chi + 2) + S*phimax, True))"
)
_IWAN4_ADDED = (
    "R*masing(Piecewise((x*phimax**(chi + 1)/(chi + 1) - x**(chi + 2)/((chi + 1)*(chi + 2)), x < phimax), "
    "(phimax**(chi + 2)/(chi + 2), True))) + S*masing(Min(x, phimax))"
)

# the real root of the cubic in n, in a form that keeps its digits for small x
_CUBE = "(1.5*sqrt(3)*k*x/Fy + sqrt(1 + 6.75*(k*x/Fy)**2))**(2/3)"

_STRIBECK_DISSIPATES = (("Fc",), ("Fc", "Fd"))

ROWS: dict[str, Row] = {
    "linear-spring": Row("Linear spring", "k*x", LIU + ", Eq. (1)", (("k", "stiffness", "N/m"),)),
    "linear-damper": Row("Viscous damper", "c*v", LIU + ", Eq. (1)", (("c", "damping", "N*s/m"),)),
    "cubic-spring": Row(
        "Cubic spring (Duffing): hardening for k3 > 0, softening for k3 < 0", "k*x + k3*x**3",
        LIU + ", Eqs. (13), (14)", (_AT_REST, _CUBIC), _ADDED,
    ),
    "quintic-spring": Row(
        "Quintic spring", "k*x + k5*x**5", LIU + ", Eqs. (15), (16)",
        (_AT_REST, ("k5", "quintic stiffness", "N/m^5")), _ADDED,
    ),
    "quadratic-spring": Row(
        "Spring with a quadratic part, which moves the mean", "k*x + k2*x**2", NAYFEH,
        (_AT_REST, ("k2", "quadratic stiffness", "N/m^2", 0.3)), _ADDED, own=True,
    ),
    "softening-hardening-spring": Row(
        "Cubic and quintic spring, first softening and then hardening",
        "k*x + k3*x**3 + k5*x**5", LIU + ", Eqs. (14), (16)",
        (
            _AT_REST, ("k3", "cubic stiffness, negative", "N/m^3", -1.5),
            ("k5", "quintic stiffness, positive", "N/m^5", 0.8),
        ),
    ),
    "odd-power-spring": Row(
        "Spring of any real power, odd", "kp*abs(x)**p*sign(x)", GELB,
        (("kp", "stiffness of power p", ""), ("p", "power, positive", "", 2.5)), Search(ranges={"p": _POWER}),
    ),
    "joint-polynomial": Row(
        "Joint as a polynomial with absolute values", "k*x + k2*x*abs(x) + k3*x**3", LIU + ", Eq. (25)",
        (_AT_REST, ("k2", "quadratic stiffness", "N/m^2"), _CUBIC), _ADDED,
    ),
    "hertz-contact": Row(
        "Hertzian contact between two sides without gap", "kh*abs(x)**1.5*sign(x)", GELB + " (power 3/2)",
        (("kh", "contact stiffness", "N/m^(3/2)"),), _ADDED,
    ),
    "pendulum": Row(
        "Pendulum or magnetic spring: sine of the displacement", "k*sin(a*x)/a", NAYFEH,
        (_AT_REST, ("a", "wave number", "1/m")), Search(ranges={"a": _WAVE}, spring=True),
    ),
    "sinh-spring": Row(
        "Hardening spring with a hyperbolic sine", "k*sinh(a*x)/a", NAYFEH,
        (_AT_REST, ("a", "inverse length", "1/m")), Search(ranges={"a": _WAVE}, spring=True), own=True,
    ),
    "tanh-joint": Row(
        "Joint that softens smoothly to a slip force", "k1*x + Fs*tanh(k*x/Fs)", WORDEN,
        (
            ("k1", "stiffness after slip", "N/m", 0.3), ("Fs", "slip force", "N"),
            ("k", "stiffness lost by slip", "N/m"),
        ),
        Search("Fs*tanh(x/xs)", {"xs": Range("x", tuple(np.geomspace(0.08, 1.2, 8)), (0.02, 4.0))}), own=True,
    ),
    "preload": Row(
        "Spring with preload: the force jumps at zero displacement", "F0*sign(x) + k*x", GELB,
        (("F0", "preload", "N"), ("k", "stiffness", "N/m")), _ADDED,
    ),
    "dead-zone": Row(
        "Spring with a gap on both sides", "k*(Max(0, x - b) + Min(0, x + b))", GELB, (_SLOPE, _GAP),
        # with a linear spring it is "piecewise-spring" and "saturation" as well
        Search(ranges={"b": Range("x", _BREAKS, (0.02, 0.99))}),
    ),
    "saturation": Row(
        "Spring whose force stays at a limit (without hysteresis)", "Max(-Fm, Min(k*x, Fm))", GELB,
        (("k", "stiffness at rest, positive", "N/m"), ("Fm", "limit of the force, positive", "N")),
    ),
    "bilinear-spring": Row(
        "Spring that is stiffer one way than the other", "Piecewise((k1*x, x > 0), (k2*x, True))",
        LIU + ", Eq. (21); Eq. (22) leaves out the mean",
        (
            ("k1", "stiffness for positive displacement", "N/m"),
            ("k2", "stiffness for negative displacement", "N/m", 2.0),
        ),
        Search("kb*Max(0, x)"), own=True,
    ),
    "piecewise-spring": Row(
        "Spring whose stiffness changes at plus and minus b",
        "Piecewise((k1*x, abs(x) <= b), (k2*x + (k1 - k2)*b*sign(x), True))",
        LIU + ", Eq. (19); Eq. (20) is misprinted, " + GELB,
        (
            ("k1", "stiffness inside", "N/m"), ("k2", "stiffness outside", "N/m", 3.0),
            ("b", "transition, positive", "m"),
        ),
    ),
    "one-sided-stop": Row(
        "Stop on one side beyond a gap, with a spring", "k0*x + k*Max(0, x - b)", GELB,
        (_WITHOUT, _SLOPE, ("b", "gap, negative: preloaded", "m")),
        Search(ranges={"b": Range("x", (*(-b for b in _BREAKS), *_BREAKS), (-0.99, 0.99))}, mirror=True),
        own=True,
    ),
    "two-sided-stop": Row(
        "Stops on both sides beyond different gaps, with a spring",
        "k0*x + k*(Max(0, x - b1) + Min(0, x + b2))", GELB,
        (
            _WITHOUT, _SLOPE,
            ("b1", "gap on the positive side", "m"), ("b2", "gap on the negative side", "m", 2.0),
        ),
        Search(ranges={"b1": _SIDE, "b2": _SIDE}), own=True,
    ),
    "quadratic-damper": Row(
        "Quadratic damper (drag)", "cq*v*abs(v)", LIU + ", Eqs. (23), (24)",
        (("cq", "quadratic damping", "N*s^2/m^2"),), _ADDED,
    ),
    "power-damper": Row(
        "Damper of any real power, odd", "cp*abs(v)**p*sign(v)", WORDEN,
        (("cp", "damping of power p", ""), ("p", "power, not negative", "", 1.5)),
        Search(ranges={"p": Range("1", (0.2, 0.4, 0.6, 1.4, 1.7, 2.4, 3.0, 4.0), (0.05, 6.0))}),
    ),
    "coulomb": Row(
        "Coulomb friction", "Ff*sign(v)", LIU + ", Eqs. (17), (18)", (_FRICTION,),
        Search(dissipates=(("Ff",),)),
    ),
    "viscous-coulomb": Row(
        "Viscous damper with Coulomb friction", "c*v + Ff*sign(v)", LIU + ", Eqs. (17), (18)",
        (("c", "damping", "N*s/m"), _FRICTION),
    ),
    "tanh-friction": Row(
        "Friction without a jump", "Ff*tanh(v/vs)", WORDEN,
        (_FRICTION, ("vs", "velocity of the transition, positive", "m/s")),
        Search(ranges={"vs": _SPEED_OF_STEP}, dissipates=(("Ff",),)), own=True,
    ),
    "stribeck": Row(
        "Coulomb friction with Stribeck effect", "(Fc + (Fs - Fc)*exp(-abs(v)/vs))*sign(v)",
        "Armstrong-Helouvry, Control of Machines with Friction (1991)", _STRIBECK,
        Search("(Fc + Fd*exp(-abs(v)/vs))*sign(v)", {"vs": _SPEED}, _STRIBECK_DISSIPATES), own=True,
    ),
    "stribeck-gauss": Row(
        "Coulomb friction with Stribeck effect, bell-shaped", "(Fc + (Fs - Fc)*exp(-(v/vs)**2))*sign(v)",
        "Canudas de Wit et al., A new model for control of systems with friction (1995), steady state",
        _STRIBECK,
        Search("(Fc + Fd*exp(-(v/vs)**2))*sign(v)", {"vs": _SPEED}, _STRIBECK_DISSIPATES), own=True,
    ),
    "van-der-pol": Row(
        "Van der Pol damper: negative damping inside, positive outside", "c*(x**2/a**2 - 1)*v", NAYFEH,
        (("c", "damping", "N*s/m"), ("a", "displacement of zero damping", "m")), Search("cx*x**2*v"),
    ),
    "displacement-friction": Row(
        "Friction that grows with displacement", "mu*abs(x)*sign(v)", WORDEN,
        (("mu", "friction force per displacement", "N/m"),), Search(dissipates=(("mu",),)), own=True,
    ),
    "structural": Row(
        "Rate-independent linear damping; it exists under periodic motion only", "structural(h)",
        "Crandall, The role of damping in vibration theory, J. Sound Vib. 11 (1970) 3",
        (("h", "stiffness times loss factor", "N/m"),),
    ),
    "jenkins": Row(
        "Spring that slips: elastic up to a friction force", "masing(Min(kt*x, Fs))",
        "Jenkins, Br. J. Appl. Phys. 13 (1962) 30; Masing, Proc. 2nd Int. Congr. Appl. Mech. (1926) 332",
        (("kt", "stiffness before slip, positive", "N/m"), ("Fs", "slip force, positive", "N")),
        Search("Fs*masing(Min(x/xs, 1))", {"xs": _SLIP}, (("Fs",),)), own=True,
    ),
    "iwan": Row(
        "Joint of many Jenkins elements whose slip forces have a uniform density",
        "masing(Piecewise((kt*x - (kt*x)**2/(4*Fs), kt*x < 2*Fs), (Fs, True)))",
        "Iwan, A distributed-element model for hysteresis, J. Appl. Mech. 33 (1966) 893",
        (("kt", "stiffness at rest, positive", "N/m"), ("Fs", "slip force of the whole, positive", "N")),
        Search("Fs*masing(Piecewise((x/xs - (x/xs)**2/4, x < 2*xs), (1, True)))", {"xs": _SLIP}, (("Fs",),)),
        own=True,
    ),
    "iwan4": Row(
        "Joint of many Jenkins elements by four parameters: density R*phi**chi up to phimax, and S there",
        f"masing({_IWAN4})",
        "Segalman, A four-parameter Iwan model for lap-type joints, J. Appl. Mech. 72 (2005) 752",
        (
            ("R", "factor of the density, positive", ""),
            ("S", "stiffness that slips at phimax", "N/m", 0.5),
            ("chi", "power of the density, above -1", "", -0.4),
            ("phimax", "displacement of slip of the whole, positive", "m"),
        ),
        Search(
            _IWAN4_ADDED,
            {"chi": Range("1", (-0.7, -0.3, 0.3), (-0.95, 2.0)), "phimax": _SLIP}, (("R",), ("S",)),
        ),
        own=True,
    ),
    "ramberg-osgood": Row(
        "Joint of Ramberg and Osgood, exponent 3: x = n/k*(1 + (n/Fy)**2); others have no explicit force",
        f"masing(3*k*x/(1 + {_CUBE} + 1/{_CUBE}))",
        "Ramberg and Osgood, NACA TN 902 (1943); Jennings, J. Eng. Mech. Div. 90 (1964) 131",
        (("k", "stiffness at rest", "N/m"), ("Fy", "force at twice the elastic displacement, positive", "N")),
        own=True,
    ),
    "bouc-wen": Row(
        "Hysteresis of Bouc and Wen, exponent 1; bg is beta*gamma, bd is beta*delta", "z",
        "Wen, J. Eng. Mech. Div. 102 (1976) 249; Noel and Schoukens, Hysteretic benchmark (2016)",
        (
            ("alpha", "stiffness at rest", "N/m"), ("bg", "decay over distance moved, positive", "1/m"),
            ("bd", "the part that depends on whether z grows", "1/m", -0.5),
        ),
        Search(
            "alpha*z", {"bg": _INVERSE, "bd": _SIGNED}, (("alpha",),),
            memory={"z": "v - bg*abs(v)*z - bd*v*abs(z)"},
        ),
        own=True, memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"},
    ),
    "dahl": Row(
        "Friction that builds up over a distance", "z",
        "Dahl, A solid friction model, Aerospace Corporation TOR-0158 (1968)",
        (("sigma", "stiffness at rest", "N/m"), ("Fc", "friction force, positive", "N")),
        Search("Fc*z", {"xs": _SLIP}, (("Fc",),), memory={"z": "(v - abs(v)*z)/xs"}), own=True,
        memory={"z": "sigma*v*(1 - z*sign(v)/Fc)"},
    ),
    "lugre": Row(
        "Friction with presliding and Stribeck effect",
        "sigma0*z + sigma1*(v - sigma0*abs(v)*z/(Fc + (Fs - Fc)*exp(-(v/vs)**2))) + sigma2*v",
        "Canudas de Wit et al., A new model for control of systems with friction (1995)",
        (
            ("sigma0", "stiffness of the bristles", "N/m", 10.0),
            ("sigma1", "damping of the bristles", "N*s/m", 0.1), ("sigma2", "viscous damping", "N*s/m", 0.1),
            *_STRIBECK,
        ),
        own=True, memory={"z": "v - sigma0*abs(v)*z/(Fc + (Fs - Fc)*exp(-(v/vs)**2))"},
    ),
}  # fmt: skip
