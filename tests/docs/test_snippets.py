"""Every command and every program of README.md and docs/ runs in a folder of nothing but the examples."""

import re
import tomllib

import pytest

from docs._extension.snippets import ROOT, Workspace, find_snippets
from rsgen.cases.case import case_schema

PAGES = [
    ROOT / "README.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts),
]
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]

AT_LENGTH = ("howto", "tutorial")
"""Folders of pages whose commands `make docs` runs as well; here they are part of `make test-all`."""

MOST_BYTES = 150_000  # of a picture: the repository keeps every version


def test_a_page_that_uses_examples_says_where_they_come_from():
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        run = [one.text for one in find_snippets(text) if one.kind in {"sh", "{shell}", "{python}", "{file}"}]
        uses = any(re.search(r"\bcases\b", lines) for lines in run)
        assert "rsgen examples" in text or not uses, path


@pytest.mark.slow
@pytest.mark.parametrize("path", [
    pytest.param(path, marks=[pytest.mark.thorough] if path.parent.name in AT_LENGTH else [])
    for path in PAGES
], ids=NAMES)  # fmt: skip
def test_snippets_run(path, tmp_path):
    workspace = Workspace(tmp_path)
    for snippet in find_snippets(path.read_text(encoding="utf-8")):
        try:
            workspace.perform(snippet, str(path))
        except Exception as fault:
            fault.add_note(f"{path.relative_to(ROOT)}, line {snippet.line}")
            raise
    for result in tmp_path.glob("reports/*/result.json"):
        assert result.parent.joinpath("report.html").is_file()


def keys_of(schema: dict, rule: dict) -> dict:
    """The keys that a table of a case file may have; empty for what is no table, or any table."""
    if "$ref" in rule:
        return keys_of(schema, schema["$defs"][rule["$ref"].rsplit("/", 1)[1]])
    found = dict(rule.get("properties", {}))
    for inner in (rule.get("items", {}), *rule.get("anyOf", ()), *rule.get("oneOf", ())):
        found |= keys_of(schema, inner) if inner else {}
    return found


def unknown_keys(table: dict, schema: dict, rule: dict, place: str = "") -> list[str]:
    """Keys of a part of a case file that no case file may have."""
    known = keys_of(schema, rule)
    if not known:
        return []
    unknown = [f"{place}{key}" for key in table if key not in known]
    for key, value in table.items():
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, dict) and key in known:
                unknown += unknown_keys(inner, schema, known[key], f"{place}{key}.")
    return unknown


@pytest.mark.slow
def test_parts_of_case_files_have_only_keys_that_are_read():
    schema = case_schema()
    for path in PAGES:
        for snippet in find_snippets(path.read_text(encoding="utf-8")):
            if snippet.kind == "toml":
                part = tomllib.loads(snippet.text)
                assert unknown_keys(part, schema, schema) == [], f"{path}, line {snippet.line}"


def test_what_the_readme_links_to_is_there_and_small():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)]*)\)", text) if "://" not in link]
    assert [link for link in links if not (ROOT / link).exists()] == []
    pictures = [ROOT / link for link in links if link.endswith(".png")]
    assert pictures
    assert all(picture.stat().st_size < MOST_BYTES for picture in pictures)
