"""Rules of values: range, unit and help of a field, declared with the field and used by every check.

    harmonics: int = declare(7, "Harmonics of the displacement.", at_least=1, at_most=64)
    mass: Annotated[float, Rule("Moving mass.", unit="kg", above=0)]

``check`` refuses an object with a value out of range; ``rsgen.cases`` derives the keys of a case file, their
checks and their JSON Schema from the same rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache, reduce
from inspect import cleandoc
from math import isfinite
from operator import or_
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from rsgen.common.errors import RsgenError, known_arguments

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Rule:
    """Allowed values: bounds of a number, length and form of a text, entries of a list, SI unit.

    Parameters
    ----------
    help
        What the value means, in a sentence.
    unit
        In a case file, a text with a unit of this dimension may stand for the number.
    what
        What is allowed, where the bounds alone do not say it well.
    key
        Where the value stands in a case file if not under the field's name; dots separate tables, and "" puts
        the keys of a nested object among those of the object itself.
    required
        The key must be given where its table is.
    outside
        The value comes from elsewhere in a case file.
    label
        Of a level: where levels are labels, any unit may follow the number.
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
    label: bool = False

    def allowed(self, base: Any = float) -> str:
        """Return the allowed values of a type, as the end of a message."""
        if self.what is not None:
            return self.what
        if base is str:
            if not self.most:
                return "a text in quotes"
            least = f"at least {self.fewest} and " if self.fewest else ""
            return f"a text in quotes of {least}at most {self.most} characters"
        kind = "a whole number" if base is int else "a number"
        if self.at_least is not None and self.at_most is not None:
            return f"{kind} from {self.at_least:.10g} to {self.at_most:.10g}"
        bounds = {"above": self.above, "of at least": self.at_least, "below": self.below}
        bounds["of at most"] = self.at_most
        known = [f"{word} {bound:.10g}" for word, bound in bounds.items() if bound is not None]
        return f"{kind} {' and '.join(known)}".rstrip()

    def accepts(self, value: object) -> bool:
        """Return True if a number is in range, or a text within its length and of its pattern."""
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

    def fault(self, value: object, base: Any = float) -> str | None:
        """Say what is wrong with a value and what is allowed, or None."""
        if self.accepts(value):
            return None
        unit = f" {self.unit}" if self.unit and isinstance(value, int | float) else ""
        shown = f"{value:.10g}" if isinstance(value, float) else repr(value)[:60]
        return f"is {shown}{unit}; {self.allowed(base)} is needed"


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
    """Split an annotation: its type without None, its rule, and whether it may be None."""
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
        base, rule, _ = read_hint(reduce(or_, parts))
        return base, rule, True
    # NDArray[float64] is an alias with a name since NumPy 2.5
    named = getattr(get_origin(hint), "__value__", None)
    if named is not None:
        return read_hint(named[get_args(hint)])
    return hint, Rule(), False


def declare(default: Any, help: str = "", **rule: Any) -> Any:
    """Make a field of a dataclass with a default and a rule: ``declare(0, "Lines.", at_least=0)``."""
    return field(default=default, metadata={"rule": Rule(help, **rule)})


def _declared(cls: type[Any]) -> tuple[Declared, ...]:
    hints = get_type_hints(cls, include_extras=True)
    found = []
    for one in fields(cls):
        said = one.metadata.get("rule", Rule())
        base, rule, optional = read_hint(Annotated[hints[one.name], said])
        found.append(Declared(one.name, base, rule, one.default, optional))
    return tuple(found)


declared: Callable[[Any], tuple[Declared, ...]] = cache(_declared)
"""List the fields of a dataclass with their rules."""


def given(made: Any, *names: str) -> list[str]:
    """List those of the fields that differ from their defaults."""
    defaults = {one.name: one.default for one in declared(type(made))}
    return [name for name in names if getattr(made, name) != defaults[name]]


def _value_faults(place: str, base: Any, rule: Rule, value: object) -> Iterator[tuple[str, str]]:
    if get_origin(base) is Literal and value not in get_args(base):
        yield place, f"is {str(value)[:60]!r}; {choices(base)} is needed"
    elif (fault := rule.fault(value, base)) is not None:
        yield place, fault
    elif get_origin(base) is tuple and isinstance(value, tuple):
        item = read_hint(get_args(base)[0])
        for number, entry in enumerate(value, start=1):
            yield from _value_faults(f"{place}.{number}", *item[:2], entry)


def choices(base: Any) -> str:
    """List the values of a Literal: ``'a', 'b' or 'c'``."""
    *most, last = map(repr, get_args(base))
    return f"{', '.join(most)} or {last}" if most else last


def check(made: Any, error: type[RsgenError] = RsgenError) -> None:
    """Refuse an object with faults; to be called when it is made.

    Where every value alone is right, its method ``faults`` is asked what does not fit together: pairs of a
    field's name and what is wrong with it.

    Raises
    ------
    RsgenError
        Of the kind ``error``, with all faults.
    """
    found: list[tuple[str, str]] = []
    for one in declared(type(made)):
        value = getattr(made, one.name)
        if value is not None and (one.default is MISSING or value is not one.default):
            found += _value_faults(one.name, one.type, one.rule, value)
    if not found and hasattr(made, "faults"):
        found += made.faults()
    if found:
        raise error("; ".join(f"{name}: {fault}" if name else fault for name, fault in found))


def documented(cls: type[T]) -> type[T]:
    """Add the fields of a dataclass, with help, unit and range, to its docstring; refuse other arguments."""
    lines = [cleandoc(cls.__doc__ or ""), "", "Parameters", "----------"]
    for one in declared(cls):
        rule = one.rule
        unit = f" [{rule.unit}]" if rule.unit else ""
        lines += [one.name, f"    {rule.help}{unit}".rstrip()]
        if get_origin(one.type) is Literal:
            lines[-1] += f" One of {choices(one.type)}."
    cls.__doc__ = "\n".join(lines)
    # the constructor that the dataclass made, with a message for arguments that it does not have
    cls.__init__ = known_arguments(cls.__init__)  # type: ignore[method-assign]
    return cls
