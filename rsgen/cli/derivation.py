"""What `rsgen derive` and `rsgen laws` print."""

from __future__ import annotations

import time
from typing import Any

from rsgen.cli.printing import print_block, print_json, print_line

__all__ = ["derive_command", "laws_command"]


def _derivation(expression: str) -> tuple[Any, Any, float]:
    from rsgen.describing import derive
    from rsgen.element import make_element

    element = make_element("law", expression)
    started = time.perf_counter()
    function = derive(element)
    return element, function, time.perf_counter() - started


def _written(formula: Any) -> str | None:
    """Write a formula in rsgen's language; None where an integral remains, which the language has not."""
    from sympy import Integral

    from rsgen.expression import write

    return None if formula.has(Integral) else write(formula)


def derive_command(expression: str, json: bool, latex: bool) -> int:
    """Print law, stiffness, damping, mean balance, regimes, limits and proof."""
    from rsgen import notation
    from rsgen.expression import write

    element, function, seconds = _derivation(expression)
    if json:
        print_json(
            {
                "force": write(element.force),
                "stiffness": _written(function.stiffness),
                "damping": _written(function.damping),
                "mean_balance": _written(function.mean_balance),
                "mean": None if function.mean is None else _written(function.mean),
                "closed_form": bool(function.closed_form),
                "checked_to": function.checked_to,
                "parameters": list(element.parameters),
                "seconds": round(seconds, 4),
            }
        )
        return 0
    show = notation.latex if latex else notation.readable
    rows = [
        ("force", "n(x, v)", show(element.force)),
        ("stiffness", "k(X, omega)", show(function.stiffness)),
        ("damping", "c(X, omega)", show(function.damping)),
    ]
    if function.mean is not None:
        rows.append(("mean", "X0(X)", show(function.mean)))
    else:
        rows.append(("mean", "0", show(function.mean_balance)))
    for what, symbol, text in rows:
        head = f"{what:<11} {symbol:<11} = "
        print_block(head, text)
    for regime in function.regimes:
        print_block(f"{'regime':<11} ", show(regime))
    for limit in function.limits:
        symbol = "k" if limit.quantity == "stiffness" else "c"
        print_block(f"{'limit':<11} {f'{symbol}(X -> {limit.place})':<11} = ", _limit(limit.value, show))
    for remark in function.remarks:
        print_block(f"{'note':<11} ", remark)
    if function.closed_form and function.checked_to is not None:
        print_block(f"{'proof':<11} ", f"agrees with quadrature to {function.checked_to:.1e}")
    elif not function.closed_form:
        print_block(
            f"{'proof':<11} ", "no closed form is known; evaluated by quadrature between the switching angles"
        )
    return 0


def _limit(value: Any, show: Any) -> str:
    # oo*sign(k): infinite, with the sign of k
    return (
        f"oo, with the sign of {show(value.args[1].args[0])}"
        if value.is_Mul and value.args[0].is_infinite
        else str(show(value))
    )


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
