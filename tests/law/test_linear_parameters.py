"""In which parameters a law is linear, also near a zero of high order, where round-off is all there is."""

from __future__ import annotations

import pytest
import sympy

from rsgen.formula import parse
from rsgen.law.character import character, jointly_linear
from rsgen.law.normal_form import Piece


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


def test_a_long_term_is_linear_where_it_is_written_so(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_polynomial_of_many_terms_is_linear_in_all_of_them() -> None:
    """Of two states up to the eighth power: a force surface without a physical law."""
    powers = [(i, j) for i in range(9) for j in range(9) if 0 < i + j <= 8]
    kind = character(sympy.Add(*(parse(f"a{i}_{j}*x**{i}*v**{j}") for i, j in powers)))
    assert len(kind.linear) == len(kind.parameters) == len(powers)
