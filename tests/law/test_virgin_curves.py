"""Signs that a virgin curve leaves its parameters."""

from __future__ import annotations

import pytest

from rsgen.formula import parse
from rsgen.law.character import character


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "positive"),
    [
        ("k*x + masing(Min(kt*x, Fs))", {"Fs", "kt"}),
        ("masing(Min(1500*x, F1)) + masing(Min(1500*x, F2))", {"F1", "F2"}),
        ("Fs*masing(Min(x/xs, 1))", {"xs"}),
        ("masing(K*x - R*x**p)", {"p"}),
        # both signs of F are the same curve
        ("masing(F*tanh(k*x/F))", {"k"}),
        # a power below zero is one of the model
        ("R*masing(Piecewise((x*b**(q + 1)/(q + 1) - x**(q + 2)/((q + 1)*(q + 2)), x < b), "
         "(b**(q + 2)/(q + 2), True)))", {"b"}),
        ("k*x + A*tanh(v/w)", set()),
    ],
)  # fmt: skip
def test_parameters_that_must_be_positive(text: str, positive: set[str]) -> None:
    kind = character(parse(text))
    assert {kind.parameters[i] for i in kind.positive} == positive
