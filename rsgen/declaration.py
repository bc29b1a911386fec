"""Rules of values: range, unit and help of a field stand in its annotation, once for everybody who checks it.

    harmonics: Annotated[int, Rule("Harmonics of the displacement.", at_least=1, at_most=64)] = 7

``check`` refuses an object with a value out of range; ``rsgen.case`` derives the keys of a case file, their
checks and their JSON Schema from the same annotations.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from inspect import cleandoc
from math import isfinite
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from rsgen.errors import RsgenError

__all__ = ["Declared", "Rule", "check", "declared", "documented", "faults_of", "given", "read_hint"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Rule:
    """What a value may be.

    Parameters
    ----------
    help
        What it means, in a sentence.
    unit
        SI unit of a number; in a case file a text with a unit may stand for the number.
    at_least, above, below, at_most
        Bounds of a number, or of every number of an array.
    fewest, most
        Length of a text or number of entries.
    pattern
        Regular expression that a text must match as a whole.
    what
        What is allowed, where the bounds alone do not say it well.
    key
        Where the value stands in a case file if not under the field's name; dots separate tables, and "" puts
        the keys of a nested object beside those of the object itself.
    required
        The key must be given where its table is.
    outside
        The value comes from elsewhere in a case file.
    """

    help: str = ""
    unit: str | None = None
    at_least: float | None = None
    above: float | None = None
    below: float | None = None
    at_most: float | None = None
    fewest: int | None = None
    most: int | None = None
    pattern: str | None = None
    what: str | None = None
    key: str | None = None
    required: bool = False
    outside: bool = False

    @property
    def allowed(self) -> str:
        """What is allowed, as it ends a message."""
        low = (("above", self.above), ("of at least", self.at_least))
        bounds = (*low, ("below", self.below), ("of at most", self.at_most))
        texts = [f"{word} {bound:.10g}" for word, bound in bounds if bound is not None]
        lengths = [
            f"{word} {length}"
            for word, length in (("at least", self.fewest), ("at most", self.most))
            if length
        ]
        if self.what is not None:
            return self.what
        if self.at_least is not None and self.at_most is not None:
            return f"a number from {self.at_least:.10g} to {self.at_most:.10g}"
        if lengths and not texts:
            return f"a length of {' and '.join(lengths)}"
        return f"a number {' and '.join(texts)}" if texts else "a finite number"

    def accepts(self, value: object) -> bool:
        """Tell whether a number is in range, or a text as long as it may be and of the pattern."""
        if isinstance(value, bool):
            return True
        if isinstance(value, int | float):
            return (
                isfinite(value)
                and (self.at_least is None or value >= self.at_least)
                and (self.above is None or value > self.above)
                and (self.below is None or value < self.below)
                and (self.at_most is None or value <= self.at_most)
            )
        if isinstance(value, str | tuple | list):
            fits = (self.fewest or 0) <= len(value) and (self.most is None or len(value) <= self.most)
            whole = self.pattern is None or not isinstance(value, str) or re.fullmatch(self.pattern, value)
            return fits and bool(whole)
        return True

    def fault(self, value: object) -> str | None:
        """Say what is wrong with a value and what is allowed, or None."""
        if self.accepts(value):
            return None
        unit = f" {self.unit}" if self.unit and isinstance(value, int | float) else ""
        shown = f"{value:.10g}" if isinstance(value, float) else repr(value)[:60]
        return f"is {shown}{unit}; {self.allowed} is needed"


@dataclass(frozen=True, slots=True)
class Declared:
    """A field: its name, type without None, rule and default (MISSING where there is none)."""

    name: str
    type: Any
    rule: Rule
    default: Any
    optional: bool

    @property
    def key(self) -> str:
        """Where it stands in the table of a case file."""
        return self.name if self.rule.key is None else self.rule.key


def read_hint(hint: Any) -> tuple[Any, Rule, bool]:
    """Take an annotation apart: its type without None, its rule, and whether it may be None."""
    if get_origin(hint) is Annotated:
        inner, *extras = get_args(hint)
        base, rule, optional = read_hint(inner)
        for extra in extras:
            if isinstance(extra, Rule):
                said = {f.name: v for f in fields(extra) if (v := getattr(extra, f.name)) != f.default}
                rule = replace(rule, **said)
        return base, rule, optional
    if get_origin(hint) in (Union, UnionType) and NoneType in get_args(hint):
        parts = tuple(part for part in get_args(hint) if part is not NoneType)
        base, rule, _ = read_hint(Union.__getitem__(parts))
        return base, rule, True
    return hint, Rule(), False


def _declared(cls: type[Any]) -> tuple[Declared, ...]:
    hints = get_type_hints(cls, include_extras=True)
    found = []
    for field in fields(cls):
        base, rule, optional = read_hint(hints[field.name])
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        found.append(Declared(field.name, base, rule, default, optional))
    return tuple(found)


declared: Callable[[Any], tuple[Declared, ...]] = cache(_declared)
"""List the fields of a dataclass with their rules."""


def given(made: Any, *names: str) -> list[str]:
    """List those of the fields that differ from their defaults."""
    defaults = {field.name: field.default for field in declared(type(made))}
    return [name for name in names if getattr(made, name) != defaults[name]]


def _value_faults(place: str, base: Any, rule: Rule, value: object) -> Iterator[tuple[str, str]]:
    if get_origin(base) is Literal and value not in get_args(base):
        yield place, f"is {str(value)[:60]!r}; {choices(base)} is needed"
    elif (fault := rule.fault(value)) is not None:
        yield place, fault
    elif get_origin(base) is tuple and isinstance(value, tuple):
        item = read_hint(get_args(base)[0])
        for number, entry in enumerate(value, start=1):
            yield from _value_faults(f"{place}.{number}", *item[:2], entry)


def choices(base: Any) -> str:
    """List the values of a Literal: ``'a', 'b' or 'c'``."""
    *most, last = map(repr, get_args(base))
    return f"{', '.join(most)} or {last}" if most else last


def faults_of(made: Any) -> list[tuple[str, str]]:
    """Say what is wrong with the values of an object: pairs of a field's name and what is wrong with it.

    Where every value alone is right, its method ``faults`` is asked what does not fit together.
    """
    found: list[tuple[str, str]] = []
    for field in declared(type(made)):
        value = getattr(made, field.name)
        if value is not None and (field.default is MISSING or value is not field.default):
            found += _value_faults(field.name, field.type, field.rule, value)
    if not found and hasattr(made, "faults"):
        found += made.faults()
    return found


def check(made: Any, error: type[RsgenError] = RsgenError) -> None:
    """Refuse an object with faults; to be called when it is made.

    Raises
    ------
    RsgenError
        Of the kind ``error``, with all faults.
    """
    faults = [f"{name}: {fault}" for name, fault in faults_of(made)]
    if faults:
        raise error("; ".join(faults))


def documented(cls: type[T]) -> type[T]:
    """Add the fields of a dataclass to its docstring, with the help, unit and range of their rules."""
    lines = [cleandoc(cls.__doc__ or ""), "", "Parameters", "----------"]
    for field in declared(cls):
        rule = field.rule
        unit = f" [{rule.unit}]" if rule.unit else ""
        lines += [field.name, f"    {rule.help}{unit}".rstrip()]
        if get_origin(field.type) is Literal:
            lines[-1] += f" One of {choices(field.type)}."
    cls.__doc__ = "\n".join(lines)
    return cls
