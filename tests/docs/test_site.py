"""The pages of docs/ as a reader meets them: built without a warning, quiet, readable at any width."""

import re
from typing import Any

import pytest

import rsgen
from docs._extension.snippets import ROOT
from tests.docs.test_words import PAGES
from tests.programs import python
from tests.report.browser import AXE, DESK, PHONE, Page, in_browser

# a page of text and formulas, one of figures, one of programs, one of signatures
JUDGED = ("tutorial/first-report", "method", "laws", "api/verdict")
ADDRESS = r"\"(?:https?:)?//"
NOT_FETCHED = re.compile(rf"<(?:script|img|iframe|source)\b[^>]*\bsrc={ADDRESS}|<link\b[^>]*href={ADDRESS}")
USED = re.compile(r'<use href="#([^"]+)"|url\(#([^)]+)\)')


def test_the_api_page_names_everything_public():
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs/api").glob("*.md"))
    named = set(re.findall(r"auto(?:function|class|exception|module|data):: rsgen\.(\w+)", text))
    assert named >= set(rsgen.__all__)


def test_every_format_and_every_case_has_its_words():
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs/howto").glob("*.md"))
    cases = sorted(path.stem for path in (ROOT / "cases/formats").glob("*.toml"))
    assert [name for name in cases if f"cases/formats/{name}.toml" not in text] == []


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """All pages, with one law and one case drawn, without the output of commands; warnings are errors."""
    pytest.importorskip("sphinx", reason="no Sphinx here: install rsgen[docs]; the pages were not built")
    folder = tmp_path_factory.mktemp("site")
    options = ["-W", "-n", "-q", "-b", "html", "-D", "rsgen_quick=1"]
    done = python("-m", "sphinx", *options, ROOT / "docs", folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.thorough
def test_pages_are_built_without_a_warning_and_ask_nobody(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) >= len(PAGES) - 1 > 10
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert NOT_FETCHED.search(text) is None, page
        # parts of figures, too, stand at one place and are found
        names = re.findall(r'\bid="([^"]+)"', text)
        assert len(names) == len(set(names))
        assert {one or other for one, other in USED.findall(text)} <= set(names)
    assert "<math" in (site / "method.html").read_text(encoding="utf-8")


@pytest.mark.thorough
@pytest.mark.parametrize("name", JUDGED)
def test_pages_fit_and_axe_finds_nothing(chromium, site, name):
    async def visit(page: Page) -> dict[Any, Any]:
        found: dict[Any, Any] = {}
        for width in (PHONE, DESK):
            for dark in (False, True):
                await page.show((site / f"{name}.html").as_uri(), width, dark=dark)
                judged = await page.violations() if AXE.is_file() else "[]"
                found[width, dark] = (await page.fits(width), judged)
        return found | {"requests": [seen for seen in page.requests if not seen.startswith("file:")]}

    seen = in_browser(chromium, visit)
    assert seen.pop("requests") == []
    assert set(seen.values()) == {(True, "[]")}, seen
    if not AXE.is_file():
        pytest.skip("no axe-core here: docs/ was not judged; make test-all fetches it with npm")
