"""In which parameters a law is linear, also near a zero of high order, where round-off is all there is."""

from __future__ import annotations

import pytest

from rsgen.expression import parse
from rsgen.law.character import character


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
