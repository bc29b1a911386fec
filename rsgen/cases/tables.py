"""Tables of a case file, derived from the declarations of the layers below, and their way to objects.

``table_of`` makes a pydantic model from a dataclass whose fields carry rules; ``Maker`` turns a checked
table into the object: texts with units become SI numbers, lists tuples, grids arrays, relative paths files.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, is_dataclass, replace
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, create_model
from pydantic_core import PydanticCustomError, core_schema

from rsgen.cases.faults import is_device
from rsgen.common.arrays import Array
from rsgen.common.declaration import Declared, Rule, declared, read_hint
from rsgen.common.errors import RsgenError, one_line, quote
from rsgen.formula.bounds import MAX_CHARACTERS
from rsgen.formula.units import quantity, sensor_unit

# ----------------------------------------------------------------------------
# Rows of levels and frequencies: from start, stop and count, or value by value, to an ascending array.

MAX_POINTS = 1_000_000


# ----------------------------------------------------------------------------
# Paths to data files in a case: relative, plain, and inside the allowed folders.

MAX_PATH = 400
MAX_PART = 120


def path_fault(text: str) -> str | None:
    """Say why a text is no path to a data file inside the allowed folders, or None where it is one.

    Examples
    --------
    >>> path_fault("wire/example6.txt") is None
    True
    >>> path_fault("../secret.csv")
    "'../secret.csv' leaves its folder; a relative path with / and without .. is allowed"
    """
    allowed = "a relative path with / and without .. is allowed"
    if not text or len(text) > MAX_PATH:
        return f"has {len(text)} characters; 1 to {MAX_PATH} are allowed"
    if not text.isprintable() or any(sign in text for sign in '\\:*?"<>|$~'):
        return f"{quote(text)} contains a sign that no data file may have; {allowed}"
    parts = text.split("/")
    if text.startswith("/"):
        return f"{quote(text)} is an absolute path; {allowed}"
    if ".." in parts:
        return f"{quote(text)} leaves its folder; {allowed}"
    if any(not part or part == "." or part != part.strip() or part.startswith("-") for part in parts):
        return f"{quote(text)} has a part that is empty, '.', begins with - or ends in a blank; {allowed}"
    if any(len(part) > MAX_PART or part.endswith(".") or is_device(part) for part in parts):
        return f"{quote(text)} is no file name on every system; {allowed}"
    return None


T = TypeVar("T")
_QUANTITY = 'a finite number in SI units or a text with its unit, as "5.92 kN/m",'
_JSON = {int: "integer", float: "number", str: "string"}
_BOUNDS = {
    "minimum": "at_least", "exclusiveMinimum": "above", "exclusiveMaximum": "below", "maximum": "at_most",
    "minLength": "fewest", "maxLength": "most", "pattern": "pattern",
}  # fmt: skip


class Table(BaseModel):
    """A table of a case file: strict, without unknown keys."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


@dataclass(frozen=True, slots=True)
class Obeys:
    """Return the pydantic checks of a number or text under a rule; with a unit, a text may give a number."""

    base: Any
    rule: Rule

    @property
    def kinds(self) -> tuple[type, ...]:
        """Types that a value may have."""
        return (float, str) if self.rule.unit is not None else get_args(self.base) or (self.base,)

    def read(self, value: object) -> object:
        """Return the value; an integer as float where that is declared."""
        kinds = (*self.kinds, int) if float in self.kinds else self.kinds
        # of a value with a unit the range is checked in SI units, when the unit has been read
        rule = self.rule if self.rule.unit is None else Rule(fewest=1, most=MAX_CHARACTERS)
        if isinstance(value, bool) or not isinstance(value, kinds) or not rule.accepts(value):
            allowed = self.rule.allowed(self.base) if self.rule.unit is None else _QUANTITY
            raise PydanticCustomError("rule", "{allowed}", {"allowed": allowed})
        return float(value) if isinstance(value, int) and float in kinds else value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Replace pydantic's check of the type."""
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """Return types and bounds as JSON Schema."""
        types = [_JSON[kind] for kind in self.kinds]
        bounds = {name: getattr(self.rule, attribute) for name, attribute in _BOUNDS.items()}
        known = {name: bound for name, bound in bounds.items() if bound is not None}
        return {"type": types[0] if len(types) == 1 else types, **known}


Quantity = Annotated[float | str, Obeys(float, Rule(unit=""))]
Text = Annotated[str, Obeys(str, Rule(most=MAX_CHARACTERS))]


class Grid(Table):
    """An ascending row of values: start, stop and count, or the values themselves."""

    start: Quantity | None = None
    stop: Quantity | None = None
    count: Annotated[int, Obeys(int, Rule(at_least=1, at_most=1_000_000))] | None = None
    spacing: Literal["linear", "log"] | None = None
    values: list[Quantity] | None = None


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


def _annotation(base: Any, rule: Rule) -> Any:
    """Return what pydantic checks for a declared type and rule."""
    if get_origin(base) is np.ndarray:
        return Grid
    if get_origin(base) is tuple:
        items = get_args(base)
        inner, inner_rule, _ = read_hint(items[0])
        fewest, most = (rule.fewest, rule.most) if Ellipsis in items else (len(items), len(items))
        entry = _annotation(inner, inner_rule)
        # a type made at run time, which mypy cannot know
        entries: Any = Annotated[list[entry], Field(min_length=fewest, max_length=most)]  # type: ignore[valid-type]
        # one text may stand for a list of one
        schema = WithJsonSchema({"type": ["string", "array"], "items": {"type": "string"}})
        return Annotated[entries, BeforeValidator(_listed), schema] if inner in (str, Path) else entries
    if base in (str, Path):
        return Annotated[Any, Obeys(str, replace(rule, most=rule.most or MAX_CHARACTERS))]
    return base if base is bool or get_origin(base) is Literal else Annotated[Any, Obeys(base, rule)]


@dataclass(frozen=True, slots=True)
class _Key:
    """A key of a table: what pydantic checks, its default and help, and whether every case needs it."""

    annotation: Any
    info: Any
    needed: bool


def _key(one: Declared, optional: bool) -> _Key:
    rule = one.rule
    needed = one.default is MISSING and not (optional or one.optional)
    default = None if one.default in (MISSING, ()) else one.default
    if isinstance(default, tuple):
        default = list(default)
    unit = f" [{rule.unit}]" if rule.unit else ""
    info = Field(
        default=... if needed or rule.required else default, description=f"{rule.help}{unit}" or None
    )
    return _Key(_annotation(one.type, rule), info, needed)


def _purpose(cls: Any) -> str:
    return (cls.__doc__ or "").split("\n\n")[0]


def _tree(cls: Any, optional: bool = False) -> dict[str, Any]:
    """Return the keys of a dataclass, tables within tables; "" is what a table is for."""
    tree: dict[str, Any] = {}
    for one in declared(cls):
        if one.rule.outside:
            continue
        *tables, last = one.key.split(".")
        place = tree
        for part in tables:
            place = place.setdefault(part, {})
        if get_origin(one.type) is dict:
            inner: Any = table_of(get_args(one.type)[1], get_args(one.type)[1].__name__)
            place[last] = _Key(dict[str, inner], Field(None, description=one.rule.help), False)
        elif not is_dataclass(one.type):
            place[last] = _key(one, optional)
        elif last:
            inner = _tree(one.type, optional or one.optional)
            place[last] = {"": one.rule.help or _purpose(one.type)} | inner | place.get(last, {})
        else:
            place |= _tree(one.type, optional or one.optional)
    return tree


def _is_needed(entry: Any) -> bool:
    if isinstance(entry, dict):
        return any(map(_is_needed, entry.values()))
    return isinstance(entry, _Key) and entry.needed


def _model(name: str, tree: dict[str, Any]) -> type[Table]:
    fields: dict[str, Any] = {}
    for key, entry in tree.items():
        if isinstance(entry, _Key):
            fields[key] = (entry.annotation, entry.info)
        elif isinstance(entry, dict):
            inner = _model(f"{name}{key.title()}", entry)
            fields[key] = (inner, ...) if _is_needed(entry) else (inner | None, None)
    return create_model(name, __base__=Table, __doc__=tree.get(""), **fields)


def table_of(
    cls: type, name: str, doc: str = "", extras: Mapping[str, tuple[Any, Any]] | None = None
) -> type[Table]:
    """Derive the table of a case file from a declared dataclass.

    Parameters
    ----------
    cls
        A dataclass whose fields carry rules of ``rsgen.common.declaration``.
    name
        Of the table in the JSON Schema.
    doc
        What the table is for; None: what the class says.
    extras
        Further keys: the key, dots between tables, and its annotation and pydantic Field.
    """
    tree = {"": doc or _purpose(cls)} | _tree(cls)
    for key, (annotation, info) in (extras or {}).items():
        *tables, last = key.split(".")
        place = tree
        for part in tables:
            place = place[part]
        place[last] = _Key(annotation, info, info.is_required())
    return _model(name, tree)


def _find(table: Any, key: str) -> Any:
    for part in key.split(".") if key else ():
        table = getattr(table, part, None)
    return table


_LABEL = re.compile(r"\s*([+-]?\d{1,30}(?:\.\d{1,30})?) ?([^\W\d]{1,30}|%)\s*")
"""A number with any unit, as labels of levels may be written."""


@dataclass(slots=True)
class Maker:
    """Turns checked tables into objects and collects what is wrong.

    Parameters
    ----------
    folders
        Where data files are looked for, in this order.
    units
        Units that stand for declared ones: {"N": "m"} where levels are displacements; None takes any. Where
        levels are labels, "label" has the unit of their texts, "" before the first.
    faults
        One sentence a fault, each with its key.
    label_hint
        What is said below a level in a wrong unit.
    """

    folders: tuple[Path, ...] = ()
    units: dict[str, str | None] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    label_hint: str = ""

    def number(self, place: str, value: float | str, rule: Rule) -> float | None:
        """Turn a value, perhaps a text with a unit, into SI and check its range; None with a fault."""
        unit = self.units.get(rule.unit, rule.unit) if rule.unit else rule.unit
        try:
            found = quantity(sensor_unit(value, unit) if unit and isinstance(value, str) else value, unit)
        except RsgenError as fault:
            label = self._label(value, rule)
            if label is None:
                what = one_line(fault).replace("standard_gravity", "g")
                self.faults.append(f"{place}: {what}{self.label_hint * rule.label}")
                return None
            found = label
        wrong = rule.fault(found)
        if wrong:
            self.faults.append(f"{place}: {wrong}")
        return None if wrong else found

    def _label(self, value: float | str, rule: Rule) -> float | None:
        """Return the number of a label, such as "0.25 V"; None of others, or after one in another unit."""
        label = _LABEL.fullmatch(str(value))
        if not (rule.label and label and self.units.get("label") in ("", label[2])):
            return None
        self.units["label"] = label[2]
        return float(label[1])

    def make(self, cls: type[T], table: Any, place: str, **known: Any) -> T:
        """Make an object from its table; where it has faults, it only serves to find further ones.

        Parameters
        ----------
        cls
            A declared dataclass.
        table
            Its checked table; None stands for an empty one.
        place
            The table's key, for messages.
        known
            Fields that are not taken from the table.
        """
        before = len(self.faults)
        fields = declared(cls)
        values: dict[str, Any] = {one.name: None for one in fields if one.default is MISSING} | known
        for one in fields:
            raw = None if one.name in known or one.rule.outside else _find(table, one.key)
            needed = one.default is MISSING and not one.optional and is_dataclass(one.type)
            if raw is not None or (needed and one.name not in known):
                # a signal within a table has no key of its own; one that is missing says what it needs
                within = f"{place}.{one.key}" if one.key else place
                values[one.name] = self._convert(one.type, one.rule, raw, within)
        keys = {one.name: one.key for one in fields}
        made = _unchecked(fields, cls, values)
        for name, fault in made.faults() if hasattr(made, "faults") else ():
            head, *rest = name.split(".")
            where = ".".join(part for part in (place, keys.get(head, head), *rest) if part)
            self.faults.append(f"{where}: {fault}")
        if len(self.faults) == before:
            try:
                return cls(**values)
            except RsgenError as fault:
                self.faults.append(f"{place}: {one_line(fault)}")
        return made

    def _files(self, texts: list[str], key: str) -> tuple[Path, ...]:
        """Find data files by relative paths; those that are nowhere are meant in the last folder."""
        paths = []
        for number, text in enumerate(texts, start=1):
            place = key if len(texts) == 1 else f"{key}.{number}"
            fault = path_fault(text)
            if fault:
                self.faults.append(f"{place}: {fault}")
            paths.append(self.folders[-1] if fault else self._file(text, place))
        return tuple(paths)

    def _file(self, text: str, key: str) -> Path:
        for folder in self.folders:
            path = folder / text
            try:
                there = path.exists()
            except OSError as fault:
                why = f"{fault.strerror}; a file that may be read is needed"
                self.faults.append(f"{key}: cannot be looked for: {why}")
                return path
            if there:
                if not path.resolve().is_relative_to(folder.resolve()):
                    wrong = f"{quote(text)} is a link out of its folder; copy the file into it"
                    self.faults.append(f"{key}: {wrong}")
                return path
        # nowhere: the case's own folder is the last, and the place to name
        return self.folders[-1] / text

    def _row(self, table: Any, place: str, rule: Rule) -> Array | None:
        """Expand a row of positive, ascending values, (n,); None where a fault was found."""
        before = len(self.faults)
        bounds = ("start", "stop", "count")
        given = [name for name in bounds if getattr(table, name) is not None]
        if table.values is not None:
            if not given and table.spacing is None:
                return self._listed_row(table.values, f"{place}.values", rule)
            what = ", ".join(given) or "spacing"
            self.faults.append(f"{place}: has values and {what}; give one or the other")
            return None
        missing = ", ".join(name for name in bounds if name not in given)
        if missing:
            needed = "{ start, stop, count } or { values = [...] } needed"
            self.faults.append(f"{place}: {missing} missing; {needed}")
        start, stop = (
            None if getattr(table, end) is None else self.number(f"{place}.{end}", getattr(table, end), rule)
            for end in bounds[:2]
        )
        count = table.count
        if len(self.faults) > before or start is None or stop is None or count > MAX_POINTS:
            return None
        if start > 0 and (start < stop if count > 1 else start == stop):
            log = table.spacing == "log"
            row = np.geomspace(start, stop, count) if log else np.linspace(start, stop, count)
            if (np.diff(row) > 0).all():
                return row
        said = f"start {start:g}, stop {stop:g}, count {count}"
        self.faults.append(f"{place}: {said}; ascending values above 0 are needed")
        return None

    def _listed_row(self, values: list[float | str], place: str, rule: Rule) -> Array | None:
        if not values:
            self.faults.append(f"{place}: is empty; at least one value needed")
            return None
        numbers = [self.number(f"{place}.{n}", value, rule) for n, value in enumerate(values, start=1)]
        known = [number for number in numbers if number is not None]
        if len(known) < len(numbers):
            return None
        for position, (left, right) in enumerate(pairwise((0.0, *known)), start=1):
            if not left < right:
                self.faults.append(f"{place}.{position}: is {right:g}; ascending values above 0 are needed")
                return None
        return np.array(known)

    def _convert(self, base: Any, rule: Rule, raw: Any, place: str) -> Any:
        if get_origin(base) is dict:
            entry: Any = get_args(base)[1]
            return {name: self.make(entry, table, f"{place}.{name}") for name, table in raw.items()}
        if is_dataclass(base):
            kind: Any = base
            return self.make(kind, raw, place)
        if get_origin(base) is np.ndarray:
            return self._row(raw, place, Rule(unit=rule.unit))
        if get_origin(base) is tuple:
            inner, inner_rule, _ = read_hint(get_args(base)[0])
            if inner is Path:
                return self._files(raw, place)
            return tuple(
                self._convert(inner, inner_rule, entry, f"{place}.{number}")
                for number, entry in enumerate(raw, start=1)
            )
        if base is float and rule.unit is not None:
            found = self.number(place, raw, rule)
            # given, but wrong: no rule may take it for missing
            return nan if found is None else found
        return raw


def _unchecked(fields: tuple[Declared, ...], cls: type[T], values: Mapping[str, Any]) -> T:
    """Make an object without its checks, to ask what is wrong with it."""
    made = object.__new__(cls)
    for one in fields:
        default = None if one.default is MISSING else one.default
        object.__setattr__(made, one.name, values.get(one.name, default))
    return made
