"""What pydantic found wrong, as sentences a person can act on: path, fault, what is allowed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from rsgen.cases.naming import suggest
from rsgen.common.errors import quote

__all__ = ["sentences"]

KINDS = ("simulated", "simulated-multisine", "measured")
"""Of a test: the tags of its table, which are no keys of the file."""
_QUOTED = ", ".join(map(repr, KINDS[:-1])) + f" or {KINDS[-1]!r}"
_WANTED = {
    "bool_type": "true or false",
    "list_type": "a list [ ... ]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _keys(location: Iterable[int | str], document: type[BaseModel]) -> list[str]:
    """List the keys that the table at a location may have, in the order of their declaration."""
    models: list[type[BaseModel]] = [document]
    for part in location:
        if part in KINDS and len(models) > 1:
            models = [m for m in models if get_args(m.model_fields["kind"].annotation) == (part,)]
        elif isinstance(part, str):
            inner = {field.alias or name: field for name, field in models[0].model_fields.items()}.get(part)
            models = list(_models(inner.annotation)) if inner else []
        if not models:
            return []
    return [field.alias or name for name, field in models[0].model_fields.items()]


def _path(location: Iterable[int | str]) -> str:
    parts: list[str] = []
    for part in location:
        if isinstance(part, int):
            parts.append(str(part + 1))
        elif part.isidentifier():
            parts.append(part)
        else:
            parts.append(quote(part))
    return ".".join(parts)


def _allowed(kind: str, context: dict[str, Any]) -> str | None:
    if kind == "literal_error":
        return str(context["expected"])
    if kind in ("too_long", "too_short"):
        word, count = (
            ("most", context["max_length"]) if kind == "too_long" else ("least", context["min_length"])
        )
        return f"at {word} {count} {'entry' if count == 1 else 'entries'}"
    return _WANTED.get(kind)


def _sentence(fault: Any, document: type[BaseModel]) -> str:
    location = list(fault["loc"])
    kind = str(fault["type"])
    context = fault.get("ctx", {})
    # the discriminator's tag is no key of the file
    if len(location) > 1 and location[0] == "test" and location[1] in KINDS:
        shown = [location[0], *location[2:]]
    else:
        shown = location
    path = _path(shown)
    if kind == "missing":
        return f"{path}: is missing; every case needs it here"
    if kind == "extra_forbidden":
        known = _keys(location[:-1], document)
        return f"{path}: is not a key here; {suggest(str(location[-1]), known)}known: {', '.join(known)}"
    if kind == "union_tag_not_found":
        return f"{path}.kind: is missing; {_QUOTED} is needed"
    if kind == "union_tag_invalid":
        return f"{path}.kind: is {quote(context['tag'])}; {_QUOTED} is allowed"
    allowed = fault["msg"] if kind == "rule" else _allowed(kind, context)
    return f"{path}: is {_shown(fault['input'])}; {allowed or fault['msg']} is needed"


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
