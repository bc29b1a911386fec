"""What was probably meant by a name or function that the language does not have."""

from __future__ import annotations

from collections.abc import Collection

from rsgen.formula.names import CONSTANTS, FUNCTIONS, closest, shown

__all__ = ["unknown_function", "unknown_name"]

_LISTED = 20
_SPELLING = {
    "sgn": "sign", "signum": "sign", "fabs": "abs", "step": "Heaviside", "heaviside": "Heaviside",
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "tg": "tan", "sh": "sinh",
    "ch": "cosh", "th": "tanh", "piecewise": "Piecewise", "where": "Piecewise", "max": "Max", "min": "Min",
    "jv": "besselj", "iv": "besseli", "Gamma": "gamma",
}  # fmt: skip
_REPLACED = {
    "pow": "write a**b",
    "power": "write a**b",
    "log10": "write log(a)/log(10)",
    "log2": "write log(a)/log(2)",
    "cbrt": "write sign(a)*abs(a)**(1/3)",
    "square": "write a**2",
    "factorial": "write gamma(n + 1)",
    "cot": "write 1/tan(a)",
    "sec": "write 1/cos(a)",
    "clip": "write Min(Max(a, lower), upper)",
    "float": "write the number itself",
    "int": "write the number itself",
}


def unknown_name(name: str, known: Collection[str]) -> str:
    """The message for a name that is not among the known ones."""
    if name in FUNCTIONS:
        return f"{name} is a function; write {name}(...)"
    names = sorted(known)
    meant = closest(name, names)
    listed = ", ".join(names[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
    return (
        f"the name {shown(name)} is not known here"
        + (f", did you mean '{meant}'?" if meant else "")
        + (f"; known: {listed}" if names else "; no names are known")
    )


def unknown_function(name: str, known: Collection[str]) -> str:
    """The message for a call of what is not a function of the language."""
    if name in known:
        return f"{shown(name)} is a name, not a function; write {name[:40]}*(...) for a product"
    if name in CONSTANTS:
        return f"{name} is a number, not a function; write {name}*(...) for a product"
    meant = _SPELLING.get(name) or closest(name, FUNCTIONS)
    hint = f", did you mean '{meant}'?" if meant else ""
    hint = f"; {_REPLACED[name]}" if name in _REPLACED else hint
    return f"{shown(name)} is not a function of formulas{hint}; allowed are {', '.join(FUNCTIONS)}"
