"""In which parameters a law is linear, also near a zero of high order, where round-off is all there is."""

from __future__ import annotations

import pytest
import sympy

from rsgen.expression import parse
from rsgen.law.character import character
from rsgen.law.linear_parameters import jointly_linear
from rsgen.law.pieces import Piece


@pytest.mark.parametrize(
    ("text", "linear", "scaled"),
    [
        ("k*(x - 1)**5", "k", ()),
        ("k*(x - b)**7 + c*v", "c k", ()),
        ("kc*Max(0, x - b)**6 + k*x", "k kc", ()),
        ("Piecewise((k*(x - 1)**5, x > 1), (0, True))", "k", ()),
        ("a*b*x + c*v", "a c", ()),
        ("k*x**n + c*v", "c k", ()),
        ("Ff*tanh(v/w) + k**2*x", "Ff", ()),
        ("Min(kt*x, Fs)", "", (("Fs", "kt"),)),
    ],
)
def test_linear_parameters(text: str, linear: str, scaled: tuple[tuple[str, ...], ...]) -> None:
    kind = character(parse(text.replace("x**n", "abs(x)**n*sign(x)")))
    assert " ".join(kind.parameters[i] for i in kind.linear) == linear
    assert tuple(tuple(kind.parameters[i] for i in group) for group in kind.scaled) == scaled


def test_parameters_of_a_long_term_count_as_nonlinear() -> None:
    # second derivatives of such a term may take seconds
    waves = [parse(f"{n}*x**{n}*tanh(w*v)") for n in range(2, 60)]
    parameters = [parse(name) for name in ("Ff", "c", "w")]
    for count, linear in ((3, (0, 1)), (58, (1,))):
        long = parse("Ff") * sympy.sin(sympy.Add(*waves[:count]))
        assert jointly_linear([Piece(long, ()), Piece(parse("c*v"), ())], parameters) == linear
