"""Faults of a case as sentences to act on: path, fault, allowed values."""

from __future__ import annotations

import re
import stat
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from rsgen.common.errors import CaseError, near_file, printable, quote, suggest
from rsgen.common.output import MAX_NAME
from rsgen.formula.units import UNKNOWN

# ----------------------------------------------------------------------------
# What names and descriptive texts may contain: they become folders, files and report headings.

MAX_TEXT = 300
# a file of this ending would be taken for a case, a surface or the index of all results
_NAME = re.compile(r"(?!.*\.(?:toml|h5|html)\Z)[a-z0-9](?:\.?[a-z0-9_-])*\Z", re.ASCII | re.IGNORECASE)
# Windows opens a device, not a file, under these names
_DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10))}


def is_device(name: str) -> bool:
    """Return True if Windows takes a file name for a device, whatever its ending."""
    return name.casefold().split(".")[0] in _DEVICES


def plain_name(text: str) -> str:
    """Return a text with - in place of what no name of a case has; empty if nothing is left."""
    return re.sub(r"[^A-Za-z0-9_.-]+|[.]{2,}|[.](?=(?:toml|h5|html)\Z)", "-", text).strip("._-")


def name_fault(name: str) -> str | None:
    """Say what is wrong with a name that becomes a folder, or None where nothing is.

    Examples
    --------
    >>> name_fault("cubic-hardening-1.5") is None
    True
    >>> name_fault("../evil")
    "'../evil' is not a plain name; letters, digits, -, _ and single dots are allowed, as in 'evil'"
    """
    if len(name) > MAX_NAME:
        return f"{quote(name)} has {len(name)} characters; at most {MAX_NAME} are allowed"
    if not _NAME.match(name):
        allowed = "letters, digits, -, _ and single dots are allowed"
        plain = plain_name(name)
        as_in = f"as in {quote(plain)}" if _NAME.match(plain) else "a letter or digit first"
        return f"{quote(name)} is not a plain name; {allowed}, {as_in}"
    if is_device(name):
        return f"{quote(name)} is the name of a device on Windows; choose another name"
    return None


def text_fault(text: str) -> str | None:
    """Say what is wrong with a title or source, or None: one printable line that reorders no text.

    Examples
    --------
    >>> text_fault("Müller & Söhne < 5 %") is None
    True
    >>> text_fault("gpj\\u202eexe")
    'contains U+202E, which is not printable; printable text on one line is allowed'
    """
    if len(text) > MAX_TEXT:
        return f"has {len(text)} characters; at most {MAX_TEXT} are allowed"
    for sign in text:
        # Cc control, Cf format (bidi), Cs surrogate, Co private, Cn unassigned, Zl Zp line separators
        if unicodedata.category(sign) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"):
            return (
                f"contains U+{ord(sign):04X}, which is not printable; printable text on one line is allowed"
            )
    return None if text.strip() else "is empty; a short text is needed"


# ----------------------------------------------------------------------------
# A case file, byte by byte suspect, to a plain tree of tables: sizes first, then TOML, then every value.
#
# A case file comes from other people, so nothing is parsed before its size and shape are known to be
# harmless.

MAX_BYTES = 262_144
MAX_LINE = 20_000
MAX_KEYS = 5_000
MAX_DEPTH = 12
MAX_INTEGER_BITS = 63
# tomllib needs time quadratic in the parts of a dotted key, so long chains are refused before it sees them
_DOTTED = re.compile(r"(?:[\w\"'\- \t]*\.){40}")


class _Vanished(float):
    """A number too small for a float: it reads as zero, but was not meant as zero."""


def _parse_float(text: str) -> float:
    value = float(text)
    if value == 0 and re.search(r"[1-9]", text.lower().split("e")[0]):
        return _Vanished(value)
    return value


def read_text(path: Path) -> str:
    """Read a case file as text: a regular file of at most 256 KiB in UTF-8, one byte order mark stripped.

    Raises
    ------
    CaseError
        No such file, no regular file, too large, not UTF-8.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise CaseError(["is no regular file; a case is a text file such as cases/cubic.toml"])
        if status.st_size > MAX_BYTES:
            raise CaseError([f"{status.st_size} bytes; a case file has at most {MAX_BYTES}"])
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as fault:
        reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else str(fault)
        needed = f"an existing case file is needed{near_file(path, '.toml')}"
        raise CaseError([f"cannot be read: {reason}; {needed}"]) from fault
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as fault:
        line = data[: fault.start].count(b"\n") + 1
        raise CaseError([f"line {line}: not UTF-8; save the case file as UTF-8 text"]) from fault
    return text.removeprefix("\ufeff")


def _refuse_shapes(text: str) -> None:
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > MAX_LINE:
            raise CaseError([f"line {number}: {len(line)} characters; at most {MAX_LINE} in a line"])
        if not line.lstrip().startswith("#") and line.count(".") >= 40 and _DOTTED.search(line):
            raise CaseError([f"line {number}: a key of more than 40 parts; keys are at most 4 tables deep"])


def _walk(value: object, path: tuple[int | str, ...]) -> Iterator[tuple[tuple[int | str, ...], object]]:
    yield path, value
    if len(path) > MAX_DEPTH:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _walk(inner, (*path, key))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _walk(inner, (*path, number))


def _path(location: Iterable[int | str]) -> str:
    """Write the place of a key or of an entry of a list, which counts from 1."""
    parts = (str(part + 1) if isinstance(part, int) else part for part in location)
    return ".".join(part if part.isidentifier() or part.isdigit() else quote(part) for part in parts)


def _value_faults(tree: dict[str, Any]) -> Iterator[str]:
    for number, (path, value) in enumerate(_walk(tree, ())):
        if number > MAX_KEYS:
            yield f"more than {MAX_KEYS} values; a case file has at most that many"
            return
        if len(path) > MAX_DEPTH:
            yield f"{_path(path[:4])}...: nested more than {MAX_DEPTH} deep; keys are at most 4 deep"
        elif isinstance(value, _Vanished):
            yield f"{_path(path)}: too small for a number of double precision; write 0 if 0 is meant"
        elif isinstance(value, int) and value.bit_length() > MAX_INTEGER_BITS:
            bits = value.bit_length()
            yield f"{_path(path)}: an integer of {bits} bits; at most {MAX_INTEGER_BITS} are read"


def open_places(tree: dict[str, Any]) -> dict[str, str]:
    """Find the values of [test] that a draft leaves open, "?" and "? N": a fault by the place of each."""
    said = "still open; its TODO in the draft says what is needed"
    return {
        (place := _path(path)): f"{place}: is {quote(value)}, {said}"
        for path, value in _walk(tree.get("test", {}), ("test",))
        if isinstance(value, str) and value.split(" ")[0] == UNKNOWN
    }


def parse_case(text: str) -> dict[str, Any]:
    """Parse the text of a case file to tables; every integer fits 63 bits, no number vanished by underflow.

    Raises
    ------
    CaseError
        Too long a line, too many parts in a key, not TOML (with the line), nested too deeply,
        a number out of range.
    """
    _refuse_shapes(text)
    try:
        tree = tomllib.loads(text, parse_float=_parse_float)
    except tomllib.TOMLDecodeError as fault:
        message = str(fault)
        found = re.search(r"\(at (line \d+), (column \d+)\)$", message)
        place = f"{found[1]}, {found[2]}" if found else "end of file"
        reason = re.sub(r"\s*\(at [^()]*\)$", "", message)
        reason = printable(reason, 200)
        if reason == "Invalid value":
            reason += "; texts, formulas and numbers with a unit stand in quotes"
        raise CaseError([f"{place}: {reason}; a case file is TOML 1.0"]) from fault
    except RecursionError as fault:
        raise CaseError(["nested too deeply to be read; keys are at most 4 tables deep"]) from fault
    except ValueError as fault:
        # an integer of more than 4300 digits ends here, not as a fault of TOML
        raise CaseError([f"a number cannot be read: {str(fault)[:120]}; use double precision"]) from fault
    faults = list(_value_faults(tree))
    if faults:
        raise CaseError(faults)
    return tree


KINDS = ("simulated", "simulated-multisine", "simulated-sweep", "simulated-decay", "measured")
"""Of a test: the tags of its table, which are no keys of the file."""
_QUOTED = ", ".join(map(repr, KINDS[:-1])) + f" or {KINDS[-1]!r}"
_OVER_FORCE = {
    "mobility": "velocity", "receptance": "displacement", "compliance": "displacement",
    "accelerance": "acceleration", "inertance": "acceleration",
}  # fmt: skip
"""Response over force, and the quantity of the response."""
_WANTED = {
    "bool_type": "true or false", "list_type": "a list [ ... ]", "dict_type": "a table",
    "model_type": "a table", "model_attributes_type": "a table",
}  # fmt: skip


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _keys(location: Iterable[int | str], document: type[BaseModel]) -> list[str]:
    """List the keys that the table at a location may have, in the order of their declaration."""
    models: list[type[BaseModel]] = [document]
    named = False
    for part in location:
        if named:
            # a name that the user chose, as of a channel
            named = False
        elif part in KINDS and len(models) > 1:
            models = [m for m in models if get_args(m.model_fields["kind"].annotation) == (part,)]
        elif isinstance(part, str):
            inner = {field.alias or name: field for name, field in models[0].model_fields.items()}.get(part)
            models = list(_models(inner.annotation)) if inner else []
            named = inner is not None and get_origin(inner.annotation) is dict
        if not models:
            return []
    return [field.alias or name for name, field in models[0].model_fields.items()]


def _allowed(kind: str, context: dict[str, Any]) -> str | None:
    if kind == "literal_error":
        return str(context["expected"])
    if kind in ("too_long", "too_short"):
        word, count = (
            ("most", context["max_length"]) if kind == "too_long" else ("least", context["min_length"])
        )
        return f"at {word} {count} {'entry' if count == 1 else 'entries'}"
    return _WANTED.get(kind)


def _other_place(location: list[int | str], document: type[BaseModel]) -> str:
    """Say where a key belongs that its table does not have, or nothing."""
    name = str(location[-1])
    if len(location) > 1 and name in _keys((), document):
        return f"did you mean {quote(name)} at the top of the file, before its tables? "
    table, _, key = name.rpartition("_")
    inner = _keys((*location[:-1], table), document)
    return f"did you mean {table} = {{ {key} = ... }}? " if key in inner else ""


def _sentence(fault: Any, document: type[BaseModel]) -> str:
    """Return the sentence about a fault of the schema: place, what is wrong, what is allowed."""
    location = list(fault["loc"])
    kind = str(fault["type"])
    context = fault.get("ctx", {})
    # the discriminator's tag is no key of the file
    tagged = len(location) > 1 and location[0] == "test" and location[1] in KINDS
    path = _path([location[0], *location[2:]] if tagged else location)
    if kind == "missing":
        return f"{path}: is missing; every case needs it here"
    if kind == "extra_forbidden":
        known = _keys(location[:-1], document)
        hint = _other_place(location, document) or suggest(str(location[-1]), known)
        return f"{path}: is not a key here; {hint}known: {', '.join(known)}"
    if kind == "union_tag_not_found":
        return f"{path}.kind: is missing; {_QUOTED} is needed"
    if kind == "union_tag_invalid":
        return f"{path}.kind: is {quote(context['tag'])}; {_QUOTED} is allowed"
    allowed = fault["msg"] if kind == "rule" else _allowed(kind, context)
    if allowed == "a table" and (keys := _keys(location, document)):
        many = isinstance(fault["input"], list)
        key = "values" if many and "values" in keys else keys[0]
        allowed = f"a table, as {{ {key} = {'[ ... ]' if many else '...'} }},"
    over = _OVER_FORCE.get(str(fault["input"]).lower()) if path.endswith(".quantity") else None
    also = f", here {over!r} with per_force = true" if over else ""
    if isinstance(fault["input"], dict | list) and f"{location[-1]}_error" in _keys(location[:-1], document):
        also = f", and its standard error, half of a ± of 95 %, under {location[-1]}_error"
    return f"{path}: is {_shown(fault['input'])}; {allowed or fault['msg']} is needed{also}"


def _shown(value: object) -> str:
    if isinstance(value, str):
        return quote(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value!r}"[:40]
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else f"a list of {len(value)}"
    return f"of type {type(value).__name__}"


def sentences(error: ValidationError, document: type[BaseModel]) -> list[str]:
    """Turn every fault into ``path.to.key: what is wrong; what is allowed``, list numbers from 1.

    Parameters
    ----------
    error
        What pydantic found.
    document
        The model that it checked.
    """
    return [_sentence(fault, document) for fault in error.errors(include_url=False)]
