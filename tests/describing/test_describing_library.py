"""The library, and the table of laws whose describing functions stand in the literature."""

import numpy as np
import pytest

from rsgen import RsgenError, derive, laws
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import remembers, symbol
from rsgen.formula.reading import parse
from tests.describing.test_describing import errors_of

WITH_ORACLE = 4  # points of a law that also go through the slow quadrature; rsgen's own proof has 40 and more
EXACT = 1e-10  # what a closed form owes to quadrature
LIU, GELB, WORDEN, OWN = "Liu et al.", "Gelb and Vander Velde, App. B", "Worden and Tomlinson, Ch. 2", "own"

GAP = "(asin(b/X) + b/X*sqrt(1 - (b/X)**2))"

# law, stiffness, damping (about zero mean), source, closed form expected
TABLE = (
    ("k*x", "k", "0", LIU, True), ("c*v", "0", "c", LIU, True),
    ("k7*x**7", "35/64*k7*X**6", "0", GELB, True),
    ("kp*abs(x)**p*sign(x)", "2*kp*X**(p - 1)*gamma(p/2 + 1)/(sqrt(pi)*gamma(p/2 + 3/2))", "0", GELB, True),
    ("kp*x*abs(x)**p", "2*kp*X**p*gamma(p/2 + 3/2)/(sqrt(pi)*gamma(p/2 + 2))", "0", GELB, True),
    ("c*v + Ff*sign(v)", "0", "c + 4*Ff/(pi*omega*X)", LIU + " Eq. (18)", True),
    (
        "cp*abs(v)**p*sign(v)", "0", "2*cp*(omega*X)**(p - 1)*gamma(p/2 + 1)/(sqrt(pi)*gamma(p/2 + 3/2))",
        WORDEN, True,
    ),
    (
        "k*(Max(0, x - b) + Min(0, x + b))", f"Piecewise((0, X <= b), (k - 2*k/pi*{GAP}, True))", "0", GELB,
        True,
    ),
    ("Max(-k*b, Min(k*x, k*b))", f"Piecewise((k, X <= b), (2*k/pi*{GAP}, True))", "0", GELB, True),
    (
        "F*(Heaviside(x - b) - Heaviside(-x - b))",
        "Piecewise((0, X <= b), (4*F/(pi*X)*sqrt(1 - (b/X)**2), True))", "0", GELB, True,
    ),
    ("F0*sign(x) + k*x", "k + 4*F0/(pi*X)", "0", GELB, True),
    ("c*(x**2/a**2 - 1)*v", "0", "c*(X**2/(4*a**2) - 1)", "Nayfeh and Mook", True),
    ("k*sin(a*x)", "2*k*besselj(1, a*X)/X", "0", "Nayfeh and Mook", True),
    ("k*sinh(a*x)", "2*k*besseli(1, a*X)/X", "0", OWN, True),
    ("k*x*cos(a*x)", "k*(besselj(0, a*X) - besselj(2, a*X))", "0", OWN, True),
    ("mu*abs(x)*sign(v)", "0", "2*mu/(pi*omega)", OWN, True),
    ("c*v*abs(x)", "0", "4*c*X/(3*pi)", OWN, True), ("k*x*v**2", "k*omega**2*X**2/4", "0", OWN, True),
    (
        "F*(sign(v - w) + sign(v + w))/2", "0",
        "Piecewise((0, omega*X <= w), (4*F/(pi*omega*X)*sqrt(1 - (w/(omega*X))**2), True))", OWN, True,
    ),
    ("F*atan(a*x)", "2*F*(sqrt(1 + a**2*X**2) - 1)/(a*X**2)", "0", OWN, False),
    ("k*x/(1 + (a*x)**2)", "2*k*(1 - 1/sqrt(1 + a**2*X**2))/(a*X)**2", "0", OWN, False),
    ("k*a*x/sqrt(abs(a*x))", "2*k*sqrt(a/X)*gamma(5/4)/(sqrt(pi)*gamma(7/4))", "0", GELB, True),
)  # fmt: skip


def random_points(names, seed=5, count=24):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        values = {name: float(np.exp(rng.uniform(-0.8, 0.8))) for name in names}
        yield values, *(float(np.exp(rng.uniform(-1, end))) for end in (1.2, 1))


@pytest.mark.slow
@pytest.mark.parametrize(("law", "stiffness", "damping", "source", "closed"), TABLE)
def test_table_of_laws(law, stiffness, damping, source, closed):
    derived = derive(law)
    assert derived.closed_form is closed
    assert not closed or derived.checked_to <= EXACT
    arguments = tuple(map(symbol, ("X", "omega", *derived.parameters)))
    printed = compiled((parse(stiffness), parse(damping)), arguments)
    for number, (values, X, omega) in enumerate(random_points(derived.parameters)):
        found = derived.evaluate(X, omega, values)
        wanted = printed(X, omega, *values.values())
        scale = sum(map(abs, wanted)) + 1e-3
        assert abs(found.stiffness - wanted[0]) <= EXACT * scale
        assert abs(found.damping - wanted[1]) <= EXACT * scale
        if closed:
            shown = compiled((derived.stiffness, derived.damping), arguments)(X, omega, *values.values())
            np.testing.assert_allclose(shown, wanted, rtol=EXACT, atol=EXACT)
        if number >= WITH_ORACLE:
            continue
        errors = errors_of(law, values, X, omega, 0.0, *wanted)
        assert errors[0] <= EXACT


@pytest.mark.slow
@pytest.mark.parametrize("name", [law.name for law in laws if not remembers(law.force)])
def test_library_law_agrees_with_quadrature(name):
    law = laws[name]
    derived = derive(law.formula)
    assert law.parameters == derived.parameters
    assert all(parameter.meaning for parameter in law.table)
    for values, X, omega in random_points(derived.parameters, count=4):
        found = derived.evaluate(X, omega, values)
        if not np.isfinite(found.mean):
            assert law.name == "quadratic-spring"  # beyond its static limit it has no mean
            continue
        errors = errors_of(law.formula, values, X, omega, found.mean, found.stiffness, found.damping)
        assert max(errors) <= EXACT


def test_element_takes_names_of_parameters():
    assert laws["cubic-spring"].element("spring", {"k": "k3", "k3": "k"}).force == parse("k3*x + k*x**3")
    for names, word in (({"q": "k1"}, "it has k, k3"), ({"k": "x"}, "cannot be a parameter")):
        with pytest.raises(RsgenError, match=word):
            laws["cubic-spring"].element(renames=names)


# force at the example values with b = 1 and all stiffnesses 1 where nothing else is said
@pytest.mark.parametrize(("name", "x", "v", "wanted"), [
    ("dead-zone", 0.9, 0, 0), ("dead-zone", -1.5, 0, -0.5), ("one-sided-stop", 1.5, 0, 2.0),
    ("one-sided-stop", -1.5, 0, -1.5), ("two-sided-stop", -2.5, 0, -3.0),
    ("piecewise-spring", -2, 0, -4.0), ("bilinear-spring", -2, 0, -4.0), ("saturation", -7, 0, -1.0),
    ("preload", -2, 0, -3.0), ("stribeck", 0, -50, -1.0), ("stribeck", 0, 1e-9, 2.0),
    ("stribeck-gauss", 0, 9, 1.0), ("tanh-joint", 50, 0, 16.0), ("van-der-pol", 2, 3, 9.0),
    ("van-der-pol", 0, 3, -3.0), ("quadratic-damper", 0, -3, -9.0), ("hertz-contact", -4, 0, -8.0),
    ("displacement-friction", -2, -3, -2.0),
])  # fmt: skip
def test_library_laws_are_what_they_are_called(name, x, v, wanted):
    law = laws[name]
    values = {symbol(key): number for key, number in law.example.items()}
    force = parse(law.formula).subs(values | {symbol("x"): x, symbol("v"): v})
    assert abs(float(force) - wanted) < 1e-6
