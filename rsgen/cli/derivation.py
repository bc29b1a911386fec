"""What `rsgen derive` and `rsgen laws` print."""

from __future__ import annotations

import time
from typing import Any

from rsgen.cli.printing import print_json, print_line, print_table
from rsgen.errors import RsgenError

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
    try:
        from rsgen import laws
    except ImportError as fault:
        raise RsgenError("laws: this version has no library of laws; write the force in the case") from fault
    entries = [{"name": law.name, "force": str(law.force)} for law in laws.library()]
    if json:
        print_json(entries)
    else:
        print_table(("law", "force"), [(entry["name"], entry["force"]) for entry in entries])
    return 0
