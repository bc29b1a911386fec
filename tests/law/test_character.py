"""What kind of law it is: linear parameters, switches, signs, equal terms, and what is odd about it."""

import numpy as np
import pytest
import sympy

import rsgen
from rsgen.formula.reading import parse
from rsgen.law.character import character, jointly_linear
from rsgen.law.element import law_remarks
from rsgen.law.memory import with_memory
from rsgen.law.normal_form import Piece
from rsgen.law.numeric import equal_terms
from tests.surfaces import codes

SATURATION = "Max(-Fm, Min(ks*x, Fm))"
BOUC_WEN = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
LUGRE = {"z": "v - s0*abs(v)/(Fc + (Fs - Fc)*exp(-(v/w)**2))*z"}

MAXWELL = {"z": "k1*v - z/tau"}


# what is said: names of parameters as words, groups of them as a list
@pytest.mark.slow
@pytest.mark.parametrize(("text", "memory", "expected"), [
    ("k*x + kn*x**3 + c*v", {}, {"linear": "c k kn", "odd": True, "rough": False, "jumps": False}),
    ("k*x + Ff*sign(v)", {}, {"linear": "Ff k", "odd": True, "rough": True, "jumps": True}),
    (
        "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))", {},
        {"linear": "k4 k5", "odd": True, "rough": True, "jumps": False},
    ),
    ("cn*v*abs(v) + k*x", {}, {"linear": "cn k", "odd": True, "rough": False, "jumps": False}),
    ("A*tanh(v/w) + k*x", {}, {"linear": "A k", "odd": True, "rough": False, "positive": ""}),
    # near a zero of high order round-off is all there is
    ("k*(x - b)**7 + c*v", {}, {"linear": "c k", "scaled": []}),
    ("a*b*x + c*v", {}, {"linear": "a c", "scaled": []}),
    ("Ff*tanh(v/w) + k**2*x", {}, {"linear": "Ff", "scaled": []}),
    # groups of degree one, also beside numbers that hide what a parameter does
    ("Min(kt*x, Fs)", {}, {"linear": "", "scaled": ["Fs kt"]}),
    (f"k*x + {SATURATION}", {}, {"scaled": ["Fm ks"]}),
    ("k*x + Max(0, ks*(x - b))", {}, {"scaled": ["ks"]}), (f"k*x + kg*{SATURATION}", {}, {"scaled": []}),
    ("k*x + Max(0, ks*x - 500)", {}, {"scaled": []}), ("Fm*tanh(ks*x/Fm)", {}, {"scaled": ["Fm ks"]}),
    # of two factors of one loop one is linear; alpha of Bouc and Wen for one sign only
    # signs that a virgin curve leaves: both signs of F are one curve, a power below zero is one of the model
    (
        "k*x + masing(Min(kt*x, Fs))", {},
        {"linear": "k", "scaled": ["Fs kt"], "odd": True, "rough": True, "springs": True}
        | {"positive": "Fs kt"},
    ),
    (
        "masing(K*x - R*x**p) + structural(h)", {},
        {"linear": "K R h", "scaled": [], "odd": True, "rough": True, "springs": False, "positive": "p"},
    ),
    (
        "k*x + c*v + z", BOUC_WEN,
        {"linear": "c k", "scaled": ["alpha"], "odd": True, "rough": True, "springs": True},
    ),
    (
        "k*x + s0*z + s1*v", LUGRE,
        {"linear": "k s1", "scaled": ["Fc Fs s0"], "odd": True, "rough": True, "springs": True},
    ),
    ("q*z + x", MAXWELL, {"linear": "k1", "scaled": [], "odd": True, "rough": False, "springs": True}),
    ("k*x + k2*x**2 + structural(h)", {}, {"linear": "h k k2", "odd": False, "springs": True}),
    ("masing(Min(1500*x, F1)) + masing(Min(1500*x, F2))", {}, {"positive": "F1 F2"}),
    ("Fs*masing(Min(x/xs, 1))", {}, {"positive": "xs"}),
    (rsgen.laws["iwan4"].formula, {}, {"positive": "phimax"}),
])  # fmt: skip
def test_what_kind_of_law_it_is(text, memory, expected):
    kind = character(with_memory(parse(text), memory) if memory else parse(text))

    def names(places: tuple[int, ...]) -> str:
        return " ".join(kind.parameters[i] for i in places)

    said = {"linear": names(kind.linear), "positive": names(kind.positive)}
    said["scaled"] = [names(group) for group in kind.scaled]
    assert {key: said.get(key, getattr(kind, key)) for key in expected} == expected
    assert kind.remembers == ("masing" in text or "structural" in text or bool(memory))


def test_a_long_term_is_linear_without_its_derivatives(monkeypatch):
    monkeypatch.setattr(sympy.Expr, "diff", None)
    waves = [parse(f"{n}*x**{n}*tanh(w*v)") for n in range(2, 60)]
    parameters = [parse(name) for name in ("Ff", "c", "w")]
    wave, hidden = sympy.sin(sympy.Add(*waves)), parse("Ff/(1 + Ff) + Ff**2/(1 + Ff)")
    pieces = [Piece(sympy.expand_mul(hidden * wave), ()), Piece(parse("c*v"), ())]
    assert jointly_linear(pieces, parameters) == (0, 1)
    long = Piece(parse("c") * wave + parse("Ff*c*v + n*x"), ())
    assert jointly_linear([long], [*parameters[:2], parse("n")]) == (0, 2)


SLIDERS = "masing(Min(ka*x, Fa)) + masing(Min(kb*x, Fb))"


@pytest.mark.parametrize(("law", "groups"), [
    (f"k*x + {SLIDERS}", [(("Fa", "ka"), ("Fb", "kb"))]),
    ("masing(Min(kt*x, F1)) + masing(Min(kt*x, F2))", [(("F1",), ("F2",))]),
    # what a name means is its place in the term, not in the alphabet
    ("masing(Min(p*x, H)) + masing(Min(g*x, w)) + masing(Min(r*x, q))", [("Hp", "wg", "qr")]),
    ("A*tanh(x/a) + B*tanh(x/b)", [(("A", "a"), ("B", "b"))]),
    # only their sum acts
    ("ka*x + kb*x", []),
    # each stands elsewhere too, or acts otherwise
    (f"{SLIDERS} + Fa*sign(v)", []),
    ("masing(Min(ka*x, Fa)) + masing(Min(kb*x, 2*Fb))", []),
])  # fmt: skip
def test_terms_that_may_change_places(law, groups):
    found, wanted = ([set(map(tuple, group)) for group in some] for some in (equal_terms(parse(law)), groups))
    assert found == wanted


@pytest.mark.slow
def test_values_of_two_sliders_have_the_order_of_their_names():
    true = {"k": 5000.0, "c": 3.0, "Fa": 8.0, "ka": 1500.0, "Fb": 2.0, "kb": 2500.0}
    truth = rsgen.Oscillator(1.5, f"k*x + c*v + {SLIDERS}", true)
    test = rsgen.SimulatedTest(level=[1.0, 4.0, 10.0, 20.0], frequency=np.linspace(8, 12, 11), harmonics=3)
    found = rsgen.identify(rsgen.simulate(truth, test), f"k*x + c*v + {SLIDERS}")
    assert found["Fa"].value == pytest.approx(2.0, rel=1e-3)
    comparison = rsgen.compare(found, truth, dict.fromkeys(true, 1e-2))
    assert comparison.passed
    assert (comparison["Fa"].true, comparison["ka"].true) == (2.0, 2500.0)
    assert "equal-terms" in codes(found)


@pytest.mark.parametrize(("text", "codes"), [
    ("k*x + z", {"constant-force"}), ("k*x + 2*F0", {"constant-force"}), ("k*x + Ff*sign(v)", set()),
    ("k*x + m3*x**2*a + c2*vx*abs(v)", {"parameter-not-variable"}),
    ("k*x + c*v + Ff*abs(V)", {"parameter-not-variable", "constant-force"}),
    # coefficients, and what a function scales
    ("k*x + a*x**3 + F*tanh(x/w)", set()), ("masing(Min(kt*x, Fs)) + masing(F*tanh(k*x/F))", set()),
])  # fmt: skip
def test_oddities_are_said(text, codes):
    assert {finding.code for finding in law_remarks(parse(text))} == codes


def test_nothing_is_odd_about_the_library():
    assert [law.name for law in rsgen.laws if law_remarks(law.force)] == []
