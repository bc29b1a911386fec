"""Pages in a real browser: no request, no script, text as text, no sideways scroll on a phone."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rsgen import Finding, Identification, make_element
from rsgen.data.oscillator import Model
from rsgen.identification.results import Estimate
from rsgen.report import draw_all, write_index
from rsgen.report.files import check_printed
from rsgen.report.page import page_context, render_page
from rsgen.report.provenance import Subject
from rsgen.report.result_json import Parts
from tests import samples
from tests.report.browser import A4, AXE, DESK, PHONE, Page, in_browser
from tests.report.test_report import HOSTILE_TITLES

pytestmark = pytest.mark.thorough

OPEN = "document.querySelectorAll('details').forEach(d => d.open = true)"
POLICY = re.compile(r"<meta http-equiv=\"Content-Security-Policy\"[^>]*>")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A plain report, one with hostile texts everywhere, the same without its policy, and an index."""
    folder = tmp_path_factory.mktemp("pages")
    surface = samples.cubic_surface()
    cubic = samples.cubic_identification(surface)
    prediction, comparison = samples.cubic_prediction(surface, (1.0,)), samples.cubic_comparison(cubic)
    drawings = draw_all(Subject.of_case(samples.cubic_case(), cubic), surface, cubic, prediction)
    titles = HOSTILE_TITLES

    def write(name: str, found: Identification = cubic, **changes) -> str:
        subject = Subject.of_case(samples.cubic_case(**changes), found)
        shown = {title or "empty": title for title in titles} if name == "hostile" else {"Versions": "rsgen"}
        printed = check_printed(subject, found) if found is cubic else ()
        parts = Parts(subject, surface, found, comparison, prediction, printed)
        text = render_page(page_context(parts, drawings, shown))
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
        title = changes.get("title", "Softening cubic spring")
        result = samples.cubic_result(0.01, *found.findings) | {"title": title}
        samples.write_result(folder / "results", result, name)
        return text

    write("plain")
    texts = {"title": titles[0] + titles[1], "source": "".join(titles)[:500], "text": "\n".join(titles)}
    hostile = write("hostile", **texts)
    doubts = [Finding("law-does-not-fit", grave, numbers={"misfit": 0.3}) for grave in ("error", "doubt")]
    write("rejected", replace(cubic, findings=tuple(doubts)))
    # describing functions wider than any phone, as those of laws with pieces are
    law = make_element("law", "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))")
    values = {"b": 0.02, "k4": 5920.0, "k5": 6900.0}
    known = tuple(Estimate(name, value, 0.0, (value, value)) for name, value in values.items())
    model, exact = Model((law,), samples.MASS), {"covariance": np.zeros((0, 0)), "solution": np.zeros(0)}
    write("pieces", replace(cubic, model=model, refined=known, **exact), model=model)
    (folder / "bare.html").write_text(POLICY.sub("", hostile), encoding="utf-8")
    write_index(folder / "results")
    names = ("plain", "pieces", "hostile", "rejected", "bare")
    return {name: folder / f"{name}.html" for name in names} | {"index": folder / "results" / "index.html"}


@pytest.mark.parametrize("name", ["plain", "pieces", "hostile", "rejected", "bare", "index"])
def test_page_is_quiet_and_fits_and_axe_finds_nothing(chromium, pages, name):
    address = pages[name].as_uri()

    async def visit(page: Page) -> dict:
        fit = {}
        for width in (PHONE, DESK):
            for dark in (False, True):
                await page.show(address, width, dark=dark)
                fit[width, dark] = await page.fits(width)
        await page.show(address, A4, media="print")
        fit["print"] = await page.fits(A4)
        await page.show(address, PHONE)
        await page.ask(OPEN)
        fit["open"] = await page.fits(PHONE)
        run = await page.ask("[document.scripts.length, document.body.style.background]")
        said, found = page.complaints + page.dialogs, {}
        for width, dark in ((PHONE, False), (DESK, False), (DESK, True)) if AXE.is_file() else ():
            await page.show(address, width, dark=dark)
            await page.ask(OPEN)
            found[width, dark] = await page.violations()
        return {"fit": fit, "run": run, "requests": set(page.requests), "said": said, "axe": found}

    seen = in_browser(chromium, visit)
    assert all(seen["fit"].values()), seen["fit"]
    assert (seen["run"], seen["requests"], seen["said"]) == ([0, ""], {address}, [])
    assert set(seen["axe"].values()) <= {"[]"}, seen["axe"]
    if not AXE.is_file():
        pytest.skip("no axe-core here: pages were not judged; make test-all fetches it with npm")
