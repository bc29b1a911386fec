"""Every command and every program of README.md and docs/ runs in a folder of nothing but the examples."""

import re
import tomllib

import pytest

from docs._extension.snippets import ROOT, Workspace, find_snippets
from rsgen.cases.case import case_schema
from tests.docs.test_words import PAGES

# folders of pages whose commands `make docs` runs as well; here they are part of `make test-all`
AT_LENGTH = ("howto", "tutorial")
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
], ids=lambda path: str(path.relative_to(ROOT)))  # fmt: skip
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


SCHEMA = case_schema()


def keys_of(rule: dict) -> dict:
    """The keys that a table of a case file may have; empty for what is no table, or any table."""
    if "$ref" in rule:
        return keys_of(SCHEMA["$defs"][rule["$ref"].rsplit("/", 1)[1]])
    found = dict(rule.get("properties", {}))
    for inner in (rule.get("items", {}), *rule.get("anyOf", ()), *rule.get("oneOf", ())):
        found |= keys_of(inner) if inner else {}
    return found


def unknown_keys(table: dict, rule: dict) -> list[str]:
    """Keys of a part of a case file that no case file may have."""
    known = keys_of(rule)
    unknown = [key for key in table if known and key not in known]
    for key in table.keys() & known.keys():
        for inner in table[key] if isinstance(table[key], list) else [table[key]]:
            unknown += unknown_keys(inner, known[key]) if isinstance(inner, dict) else []
    return unknown


@pytest.mark.slow
def test_parts_of_case_files_have_only_keys_that_are_read():
    for path in PAGES:
        for snippet in find_snippets(path.read_text(encoding="utf-8")):
            unknown = unknown_keys(tomllib.loads(snippet.text), SCHEMA) if snippet.kind == "toml" else []
            assert unknown == [], f"{path}, line {snippet.line}"


def test_what_the_readme_links_to_is_there_and_small():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)]*)\)", text) if "://" not in link]
    assert [link for link in links if not (ROOT / link).exists()] == []
    sizes = [(ROOT / link).stat().st_size for link in links if link.endswith(".png")]
    assert 0 < max(sizes) < MOST_BYTES
