"""What kind of law it is: in which parameters it is linear, where it switches, which signs it leaves them."""

import pytest
import sympy

from rsgen.formula import parse
from rsgen.law.character import character, jointly_linear
from rsgen.law.memory import with_memory
from rsgen.law.normal_form import Piece

SATURATION = "Max(-Fm, Min(ks*x, Fm))"
BOUC_WEN = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
LUGRE = {"z": "v - s0*abs(v)/(Fc + (Fs - Fc)*exp(-(v/w)**2))*z"}
MAXWELL = {"z": "k1*v - z/tau"}
IWAN4 = (
    "masing(Piecewise((x*b**(q + 1)/(q + 1) - x**(q + 2)/((q + 1)*(q + 2)), x < b), "
    "(b**(q + 2)/(q + 2), True)))"
)

# law, equations of its states, and what is said of it: names of parameters as words, groups of them as a list
TABLE = [
    ("k*x + kn*x**3 + c*v", {}, {"linear": "c k kn", "odd": True, "rough": False, "jumps": False}),
    ("k*x + Ff*sign(v)", {}, {"linear": "Ff k", "odd": True, "rough": True, "jumps": True}),
    (
        "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
        {},
        {"linear": "k4 k5", "odd": True, "rough": True, "jumps": False},
    ),
    (
        "Piecewise((k6*x, x > 0), (k7*x, True))",
        {},
        {"linear": "k6 k7", "odd": False, "rough": True, "jumps": False},
    ),
    ("cn*v*abs(v) + k*x", {}, {"linear": "cn k", "odd": True, "rough": False, "jumps": False}),
    ("kp*abs(x)**q*sign(x)", {}, {"linear": "kp", "odd": True, "rough": False, "jumps": False}),
    ("A*tanh(v/w) + k*x", {}, {"linear": "A k", "odd": True, "rough": False, "positive": ""}),
    # near a zero of high order round-off is all there is
    ("k*(x - 1)**5", {}, {"linear": "k", "scaled": []}),
    ("k*(x - b)**7 + c*v", {}, {"linear": "c k", "scaled": []}),
    ("kc*Max(0, x - b)**6 + k*x", {}, {"linear": "k kc", "scaled": []}),
    ("Piecewise((k*(x - 1)**5, x > 1), (0, True))", {}, {"linear": "k", "scaled": []}),
    ("a*b*x + c*v", {}, {"linear": "a c", "scaled": []}),
    ("k*abs(x)**n*sign(x) + c*v", {}, {"linear": "c k", "scaled": []}),
    ("Ff*tanh(v/w) + k**2*x", {}, {"linear": "Ff", "scaled": []}),
    # groups of degree one, also beside numbers that hide what a parameter does
    ("Min(kt*x, Fs)", {}, {"linear": "", "scaled": ["Fs kt"]}),
    (f"k*x + {SATURATION}", {}, {"scaled": ["Fm ks"]}),
    ("k*x + Max(0, ks*x - F0)", {}, {"scaled": ["F0 ks"]}),
    ("k*x + Max(0, ks*(x - b))", {}, {"scaled": ["ks"]}),
    ("k*x + ks*Max(0, x - b)", {}, {"scaled": []}),
    ("k*x + 4e8*x**5 + A*tanh(v/w)", {}, {"scaled": []}),
    ("k*x + A*tanh(1e6*v/w)", {}, {"scaled": []}),
    ("k*x + Max(0, ks*x - 500)", {}, {"scaled": []}),
    (f"k*x + kg*{SATURATION}", {}, {"scaled": []}),
    ("k*x + Fm*tanh(ks*x/Fm) + kp*abs(x)**q*sign(x)", {}, {"scaled": ["Fm ks"]}),
    # of two factors of one loop one is linear; alpha of Bouc and Wen for one sign only
    (
        "k*x + masing(Min(kt*x, Fs))",
        {},
        {
            "linear": "k",
            "scaled": ["Fs kt"],
            "odd": True,
            "rough": True,
            "springs": True,
            "positive": "Fs kt",
        },
    ),
    (
        "masing(K*x - R*x**p) + structural(h)",
        {},
        {"linear": "K R h", "scaled": [], "odd": True, "rough": True, "springs": False, "positive": "p"},
    ),
    (
        "k*x + k2*x**2 + structural(h)",
        {},
        {"linear": "h k k2", "scaled": [], "odd": False, "rough": False, "springs": True},
    ),
    (
        "k*x + c*v + z",
        BOUC_WEN,
        {"linear": "c k", "scaled": ["alpha"], "odd": True, "rough": True, "springs": True},
    ),
    (
        "k*x + s0*z + s1*v",
        LUGRE,
        {"linear": "k s1", "scaled": ["Fc Fs s0"], "odd": True, "rough": True, "springs": True},
    ),
    (
        "z",
        {"z": "sigma*v*(1 - z/Fc*sign(v))"},
        {"linear": "", "scaled": ["Fc sigma"], "odd": True, "rough": True, "springs": False},
    ),
    ("k*x + z", MAXWELL, {"linear": "k k1", "scaled": [], "odd": True, "rough": False, "springs": True}),
    ("q*z + x", MAXWELL, {"linear": "k1", "scaled": [], "odd": True, "rough": False, "springs": True}),
    # signs that a virgin curve leaves: both signs of F are one curve, a power below zero is one of the model
    ("k*x + masing(Min(kt*x, Fs))", {}, {"positive": "Fs kt"}),
    ("masing(Min(1500*x, F1)) + masing(Min(1500*x, F2))", {}, {"positive": "F1 F2"}),
    ("Fs*masing(Min(x/xs, 1))", {}, {"positive": "xs"}),
    ("masing(F*tanh(k*x/F))", {}, {"positive": "k"}),
    (f"R*{IWAN4}", {}, {"positive": "b"}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("text", "memory", "expected"), TABLE)
def test_what_kind_of_law_it_is(text, memory, expected):
    force = with_memory(parse(text), memory) if memory else parse(text)
    kind = character(force)

    def names(places: tuple[int, ...]) -> str:
        return " ".join(kind.parameters[i] for i in places)

    said = {"linear": names(kind.linear), "positive": names(kind.positive)}
    said["scaled"] = [names(group) for group in kind.scaled]
    assert {key: said.get(key, getattr(kind, key)) for key in expected} == expected
    assert kind.remembers == ("masing" in text or "structural" in text or bool(memory))


def test_a_long_term_is_linear_where_it_is_written_so(monkeypatch):
    # second derivatives of such a term may take seconds
    waves = [parse(f"{n}*x**{n}*tanh(w*v)") for n in range(2, 60)]
    parameters = [parse(name) for name in ("Ff", "c", "w")]
    hidden = parse("Ff/(1 + Ff) + Ff**2/(1 + Ff)")
    for count, linear in ((3, (0, 1)), (58, (1,))):
        wave = sympy.sin(sympy.Add(*waves[:count]))
        pieces = [Piece(sympy.expand_mul(hidden * wave), ()), Piece(parse("c*v"), ())]
        assert jointly_linear(pieces, parameters) == linear
        assert jointly_linear([Piece(parse("Ff") * wave, ()), *pieces[1:]], parameters) == (0, 1)
    monkeypatch.setattr(sympy.Expr, "diff", None)
    long = Piece(parse("c") * wave + parse("Ff*c*v + n*x"), ())
    assert jointly_linear([long], [*parameters[:2], parse("n")]) == (0, 2)
