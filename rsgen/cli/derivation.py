"""What `rsgen derive` and `rsgen laws` print."""

from __future__ import annotations

import time
from typing import Any

from rsgen.cli.printing import print_json, print_line

__all__ = ["derive_command", "laws_command"]


def _derivation(expression: str) -> tuple[Any, Any, float]:
    from rsgen.describing import derive
    from rsgen.element import make_element

    element = make_element("law", expression)
    started = time.perf_counter()
    function = derive(element)
    return element, function, time.perf_counter() - started


def derive_command(expression: str, json: bool, latex: bool) -> int:
    """Print law, stiffness, damping, mean balance, regimes, limits and proof."""
    from rsgen import notation
    from rsgen.expression import write

    element, function, seconds = _derivation(expression)
    if json:
        print_json(
            {
                "force": write(element.force),
                "stiffness": write(function.stiffness),
                "damping": write(function.damping),
                "mean_balance": write(function.mean_balance),
                "mean": None if function.mean is None else write(function.mean),
                "closed_form": bool(function.closed_form),
                "checked_to": function.checked_to,
                "parameters": list(element.parameters),
                "seconds": round(seconds, 4),
            }
        )
        return 0
    show = notation.latex if latex else notation.readable
    print_line(f"force       n(x, v)     = {show(element.force)}")
    print_line(f"stiffness   k(X, omega) = {show(function.stiffness)}")
    print_line(f"damping     c(X, omega) = {show(function.damping)}")
    if function.mean is not None:
        print_line(f"mean        X0(X)       = {show(function.mean)}")
    else:
        print_line(f"mean        X0 from 0   = {show(function.mean_balance)}")
    for label, sentences in (
        ("regime", function.regimes),
        ("limit", function.limits),
        ("note", function.remarks),
    ):
        for sentence in sentences:
            print_line(f"{label:<11} {sentence}")
    if function.closed_form and function.checked_to is not None:
        print_line(f"proof       agrees with quadrature to {function.checked_to:.1e}")
    elif not function.closed_form:
        print_line(
            "proof       no closed form is known; evaluated by quadrature split at the switching angles"
        )
    return 0


def laws_command(json: bool) -> int:
    """Print the library of force laws."""
    from rsgen.laws import LAWS

    if json:
        print_json(
            [
                {
                    "name": law.name,
                    "title": law.title,
                    "force": law.formula,
                    "parameters": [
                        {"name": entry.name, "meaning": entry.meaning, "unit": entry.unit}
                        for entry in law.parameters
                    ],
                    "source": law.source,
                }
                for law in LAWS
            ]
        )
        return 0
    width = max(len(law.name) for law in LAWS)
    for law in LAWS:
        print_line(f"{law.name:<{width}}  {law.formula}")
    print_line()
    print_line("Copy a formula into the force of a case, or into `rsgen derive`.")
    return 0
