"""The keys of a case file, from the JSON Schema that is derived from their declarations."""

from __future__ import annotations

from typing import Any

from rsgen.cases.case import case_schema

_BOUNDS = {
    "minimum": "at least {}",
    "exclusiveMinimum": "above {}",
    "maximum": "at most {}",
    "exclusiveMaximum": "below {}",
}


def table_of(schema: dict[str, Any], place: str = "") -> list[tuple[str, dict[str, Any]]]:
    """List the keys of a case file with what the schema says about each, with tables and dots."""
    found = []
    for key, rule in schema["properties"].items():
        path = f"{place}.{key}" if place else key
        kinds = _kinds(schema, rule)
        found.append((path, rule | kinds[0] if len(kinds) == 1 else rule))
        for kind in kinds:
            if kind.get("properties"):
                found += table_of(kind | {"$defs": schema["$defs"]}, path)
    return found


def _kinds(schema: dict[str, Any], rule: dict[str, Any]) -> list[dict[str, Any]]:
    """What a key may be, references followed, without null."""
    if "$ref" in rule:
        return [schema["$defs"][rule["$ref"].rsplit("/", 1)[1]]]
    if "items" in rule and "$ref" in rule["items"]:
        return _kinds(schema, rule["items"])
    several = [*rule.get("anyOf", ()), *rule.get("oneOf", ())]
    if not several:
        return [rule]
    return [kind for one in several for kind in _kinds(schema, one) if kind.get("type") != "null"]


def _allowed(rule: dict[str, Any]) -> str:
    choices = rule.get("enum") or ([rule["const"]] if "const" in rule else [])
    parts = [", ".join(f"`{choice}`" for choice in choices)] if choices else []
    parts += [text.format(rule[name]) for name, text in _BOUNDS.items() if name in rule]
    if rule.get("default") not in (None, "", [], {}) and not isinstance(rule["default"], dict):
        parts.append(f"default `{rule['default']}`")
    return "; ".join(parts)


def keys_table(*wanted: str) -> str:
    """Write the keys of a case file under each of the names given, in one table of Markdown."""
    seen: dict[str, str] = {}
    for path, rule in table_of(case_schema()):
        if path.split(".")[0] in wanted:
            meaning = " ".join(rule.get("description", "").split())
            allowed = _allowed(rule)
            cell = f"{meaning} {'Allowed: ' + allowed + '.' if allowed else ''}".strip()
            row = f"| `{path}` | {cell} |"
            # measured and simulated tests share some keys: the fuller description is shown
            seen[path] = max(seen.get(path, ""), row, key=len)
    missing = set(wanted) - {path.split(".")[0] for path in seen}
    if missing:
        raise ValueError(f"a case file has no {', '.join(sorted(missing))}")
    return "\n".join(["| key | meaning |", "|---|---|", *seen.values()])
