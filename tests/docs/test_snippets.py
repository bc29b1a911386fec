"""Every command and every program of README.md and docs/ runs in a folder of nothing but the examples."""

import re
import tomllib

import pytest
from pydantic import ValidationError

from docs._extension.snippets import ROOT, Workspace, find_snippets
from rsgen.cases.case import CaseDocument
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


def test_parts_of_case_files_have_only_keys_that_are_read():
    for path in PAGES:
        for snippet in (one for one in find_snippets(path.read_text(encoding="utf-8")) if one.kind == "toml"):
            part = tomllib.loads(snippet.text)
            part.get("test", {}).setdefault("kind", "measured")
            with pytest.raises(ValidationError) as faults:  # of the keys that the part leaves out
                CaseDocument.model_validate(part)
            unknown = [one["loc"] for one in faults.value.errors() if one["type"] == "extra_forbidden"]
            assert unknown == [], f"{path}, line {snippet.line}"


def test_what_the_readme_links_to_is_there_and_small():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)]*)\)", text) if "://" not in link]
    assert [link for link in links if not (ROOT / link).exists()] == []
    sizes = [(ROOT / link).stat().st_size for link in links if link.endswith(".png")]
    assert 0 < max(sizes) < MOST_BYTES
