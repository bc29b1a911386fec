"""The library of laws that users name instead of typing: springs, dampers and what is both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from rsgen.errors import RsgenError
from rsgen.expression import check_name, parse, symbol
from rsgen.law.element import Element, make_element

__all__ = ["LAWS", "Law", "Parameter", "find_law"]

LIU = "Liu et al., Parameter identification by response surface plotting"
GELB = "Gelb and Vander Velde, Multiple-Input Describing Functions (1968), App. B"
WORDEN = "Worden and Tomlinson, Nonlinearity in Structural Dynamics (2001), Ch. 2"
NAYFEH = "Nayfeh and Mook, Nonlinear Oscillations (1979)"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a law: its name, what it means, and its SI unit (empty: a number or of the power p).

    ``example`` is a value [SI] at which a picture of the law shows what is special in it.
    """

    name: str
    meaning: str
    unit: str
    example: float = 1.0


@dataclass(frozen=True, slots=True)
class Law:
    """A force law by name.

    Parameters
    ----------
    name
        Lower case, words joined by hyphens.
    title
        What it is, in a few words.
    formula
        The force [N] in x [m] and v [m/s], in the expression language.
    parameters
        Its parameters with meaning and unit.
    source
        Where the law and its describing function stand in the literature.
    own
        Whether the describing function is our own derivation, because the source gives none or a wrong one.
    """

    name: str
    title: str
    formula: str
    parameters: tuple[Parameter, ...]
    source: str
    own: bool = False

    @property
    def example(self) -> dict[str, float]:
        """A value for each parameter, SI, for a picture."""
        return {parameter.name: parameter.example for parameter in self.parameters}

    def element(self, name: str | None = None, parameters: Mapping[str, str] | None = None) -> Element:
        """Make a spring or damper of this law.

        Parameters
        ----------
        name
            Name of the element; that of the law by default.
        parameters
            New names of parameters, by their name in the law; the others keep theirs.

        Raises
        ------
        RsgenError
            The law has no parameter of this name, or the new name cannot be one.

        Examples
        --------
        >>> find_law("cubic-spring").element("spring", {"k3": "kn1"}).parameters
        ('k', 'kn1')
        """
        renamed = dict(parameters or {})
        own = [parameter.name for parameter in self.parameters]
        unknown = sorted(set(renamed) - set(own))
        if unknown:
            raise RsgenError(
                f"law {self.name!r} has no parameter {', '.join(unknown)}; it has {', '.join(own)}"
            )
        places = {symbol(old): symbol(check_name(new)) for old, new in renamed.items()}
        return make_element(name or self.name, parse(self.formula).xreplace(places))


Row = tuple[str, str, str] | tuple[str, str, str, float]


def _law(name: str, title: str, formula: str, source: str, own: bool, *rows: Row) -> Law:
    return Law(name, title, formula, tuple(Parameter(*row) for row in rows), source, own)


_GAP = ("b", "half the gap, positive", "m")
_SLOPE = ("k", "stiffness in contact", "N/m")
_STRIBECK = (
    ("Fc", "sliding friction force", "N"),
    ("Fs", "friction force at the onset of sliding", "N", 2.0),
    ("vs", "Stribeck velocity, positive", "m/s"),
)

LAWS: tuple[Law, ...] = (
    _law("linear-spring", "Linear spring", "k*x", LIU + ", Eq. (1)", False, ("k", "stiffness", "N/m")),
    _law("linear-damper", "Viscous damper", "c*v", LIU + ", Eq. (1)", False, ("c", "damping", "N*s/m")),
    _law(
        "cubic-spring", "Cubic spring (Duffing): hardening for k3 > 0, softening for k3 < 0", "k*x + k3*x**3",
        LIU + ", Eqs. (13), (14)", False,
        ("k", "stiffness at rest", "N/m"), ("k3", "cubic stiffness", "N/m^3"),
    ),
    _law(
        "quintic-spring", "Quintic spring", "k*x + k5*x**5", LIU + ", Eqs. (15), (16)", False,
        ("k", "stiffness at rest", "N/m"), ("k5", "quintic stiffness", "N/m^5"),
    ),
    _law(
        "quadratic-spring", "Spring with a quadratic part, which moves the mean", "k*x + k2*x**2",
        NAYFEH, True, ("k", "stiffness at rest", "N/m"), ("k2", "quadratic stiffness", "N/m^2", 0.3),
    ),
    _law(
        "softening-hardening-spring", "Spring that first softens and then hardens",
        "k*x + k3*x**3 + k5*x**5", LIU + ", Eqs. (14), (16)", False,
        ("k", "stiffness at rest", "N/m"), ("k3", "cubic stiffness, negative", "N/m^3", -1.5),
        ("k5", "quintic stiffness, positive", "N/m^5", 0.8),
    ),
    _law(
        "odd-power-spring", "Spring of any real power, odd", "kp*abs(x)**p*sign(x)", GELB, False,
        ("kp", "stiffness of power p", ""), ("p", "power, positive", "", 2.5),
    ),
    _law(
        "quadratic-damper", "Quadratic damper (drag)", "cq*v*abs(v)", LIU + ", Eqs. (23), (24)", False,
        ("cq", "quadratic damping", "N*s^2/m^2"),
    ),
    _law(
        "power-damper", "Damper of any real power, odd", "cp*abs(v)**p*sign(v)", WORDEN, False,
        ("cp", "damping of power p", ""), ("p", "power, not negative", "", 1.5),
    ),
    _law(
        "coulomb", "Coulomb friction", "Ff*sign(v)", LIU + ", Eqs. (17), (18)", False,
        ("Ff", "friction force", "N"),
    ),
    _law(
        "viscous-coulomb", "Viscous damper with Coulomb friction", "c*v + Ff*sign(v)",
        LIU + ", Eqs. (17), (18)", False, ("c", "damping", "N*s/m"), ("Ff", "friction force", "N"),
    ),
    _law(
        "stribeck", "Coulomb friction with Stribeck effect", "(Fc + (Fs - Fc)*exp(-abs(v)/vs))*sign(v)",
        "Armstrong-Helouvry, Control of Machines with Friction (1991)", True, *_STRIBECK,
    ),
    _law(
        "stribeck-gauss", "Coulomb friction with Stribeck effect, bell-shaped",
        "(Fc + (Fs - Fc)*exp(-(v/vs)**2))*sign(v)",
        "Canudas de Wit et al., A new model for control of systems with friction (1995), steady state",
        True, *_STRIBECK,
    ),
    _law(
        "tanh-friction", "Friction without a jump", "Ff*tanh(v/vs)", WORDEN, True,
        ("Ff", "friction force", "N"), ("vs", "velocity of the transition, positive", "m/s"),
    ),
    _law(
        "dead-zone", "Spring with a gap on both sides", "k*(Max(0, x - b) + Min(0, x + b))", GELB, False,
        _SLOPE, _GAP,
    ),
    _law(
        "one-sided-stop", "Stop on one side beyond a gap, beside a spring", "k0*x + k*Max(0, x - b)",
        GELB, True, ("k0", "stiffness without contact", "N/m"), _SLOPE,
        ("b", "gap, negative: preloaded", "m"),
    ),
    _law(
        "two-sided-stop", "Stops on both sides beyond different gaps, beside a spring",
        "k0*x + k*(Max(0, x - b1) + Min(0, x + b2))", GELB, True,
        ("k0", "stiffness without contact", "N/m"), _SLOPE,
        ("b1", "gap on the positive side", "m"), ("b2", "gap on the negative side", "m", 2.0),
    ),
    _law(
        "piecewise-spring", "Spring whose stiffness changes at plus and minus b",
        "Piecewise((k1*x, abs(x) <= b), (k2*x + (k1 - k2)*b*sign(x), True))",
        LIU + ", Eq. (19); Eq. (20) is misprinted, " + GELB, False,
        ("k1", "stiffness inside", "N/m"), ("k2", "stiffness outside", "N/m", 3.0),
        ("b", "transition, positive", "m"),
    ),
    _law(
        "bilinear-spring", "Spring that is stiffer one way than the other",
        "Piecewise((k1*x, x > 0), (k2*x, True))", LIU + ", Eq. (21); Eq. (22) leaves out the mean", True,
        ("k1", "stiffness for positive displacement", "N/m"),
        ("k2", "stiffness for negative displacement", "N/m", 2.0),
    ),
    _law(
        "saturation", "Spring whose force stays at a limit (without hysteresis)", "Max(-Fm, Min(k*x, Fm))",
        GELB, False, ("k", "stiffness at rest, positive", "N/m"), ("Fm", "limit of the force, positive", "N"),
    ),
    _law(
        "preload", "Spring with preload: the force jumps at zero displacement", "F0*sign(x) + k*x",
        GELB, False,
        ("F0", "preload", "N"), ("k", "stiffness", "N/m"),
    ),
    _law(
        "hertz-contact", "Hertzian contact between two sides without gap", "kh*abs(x)**1.5*sign(x)",
        GELB + " (power 3/2)", False, ("kh", "contact stiffness", "N/m^(3/2)"),
    ),
    _law(
        "pendulum", "Pendulum or magnetic spring: sine of the displacement", "k*sin(a*x)/a",
        NAYFEH, False, ("k", "stiffness at rest", "N/m"), ("a", "wave number", "1/m"),
    ),
    _law(
        "sinh-spring", "Hardening spring with a hyperbolic sine", "k*sinh(a*x)/a",
        NAYFEH, True, ("k", "stiffness at rest", "N/m"), ("a", "inverse length", "1/m"),
    ),
    _law(
        "tanh-joint", "Joint that softens smoothly to a slip force", "k1*x + Fs*tanh(k*x/Fs)", WORDEN, True,
        ("k1", "stiffness after slip", "N/m", 0.3), ("Fs", "slip force", "N"),
        ("k", "stiffness lost by slip", "N/m"),
    ),
    _law(
        "joint-polynomial", "Joint as a polynomial with absolute values", "k*x + k2*x*abs(x) + k3*x**3",
        LIU + ", Eq. (25)", False, ("k", "stiffness at rest", "N/m"),
        ("k2", "quadratic stiffness", "N/m^2"), ("k3", "cubic stiffness", "N/m^3"),
    ),
    _law(
        "van-der-pol", "Van der Pol damper: negative damping inside, positive outside", "c*(x**2/a**2 - 1)*v",
        NAYFEH, False, ("c", "damping", "N*s/m"), ("a", "displacement of zero damping", "m"),
    ),
    _law(
        "displacement-friction", "Friction that grows with displacement", "mu*abs(x)*sign(v)", WORDEN, True,
        ("mu", "friction force per displacement", "N/m"),
    ),
)  # fmt: skip
"""All laws of the library.

Examples
--------
>>> [law.name for law in LAWS][:3]
['linear-spring', 'linear-damper', 'cubic-spring']
"""


def find_law(name: str) -> Law:
    """Find a law by name.

    Raises
    ------
    RsgenError
        There is no law of this name.

    Examples
    --------
    >>> find_law("coulomb").formula
    'Ff*sign(v)'
    """
    for law in LAWS:
        if law.name == name:
            return law
    known = [law.name for law in LAWS]
    near = get_close_matches(name[:80], known, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise RsgenError(f"law {name!r}: unknown; {hint}known: {', '.join(known)}")
