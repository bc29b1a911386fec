"""The interactive page: data that survive JSON, text that stays text, one sentence without plotly."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from rsgen.common.errors import RsgenError
from rsgen.data.surface import save_surface
from rsgen.report.page import render_interactive
from tests.report.test_difference import write_result
from tests.samples import cubic_surface


@pytest.fixture
def result(tmp_path: Path) -> Path:
    place = write_result(tmp_path)
    save_surface(place / "surface.h5", cubic_surface())
    return place


@pytest.fixture
def plotly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Something in plotly's place: its drawing is not rsgen's, and the extra need not be there."""
    stand_in: Any = ModuleType("plotly.offline")
    stand_in.get_plotlyjs = lambda: "var Plotly = {newPlot: () => 1}; // </script>"
    monkeypatch.setitem(sys.modules, "plotly", ModuleType("plotly"))
    monkeypatch.setitem(sys.modules, "plotly.offline", stand_in)


def test_without_plotly_one_sentence_says_how_to_get_it(
    result: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(RsgenError, match=r'pip install "rsgen\[show\]"'):
        render_interactive(result)


@pytest.mark.slow
@pytest.mark.usefixtures("plotly")
def test_every_settled_point_is_on_the_page(result: Path) -> None:
    page = render_interactive(result)
    surface = cubic_surface()
    (content,) = re.findall(r"const content = (.*);\n", page)
    data = json.loads(content)
    heights = np.array([v for trace in data["traces"] for v in np.ravel(trace["z"])], dtype=float)
    assert len(heights) == np.count_nonzero(surface.settled)
    assert heights.max() == pytest.approx(1e3 * surface.amplitude[surface.settled].max(), rel=1e-5)
    assert data["axes"]["z"] == "Amplitude X [mm]"


@pytest.mark.usefixtures("plotly")
def test_texts_of_a_file_stay_text(result: Path) -> None:
    path = result / "result.json"
    content = json.loads(path.read_text())
    content["title"] = "</script><script>alert(1)</script>"
    path.write_text(json.dumps(content))
    page = render_interactive(result)
    assert "alert(1)" in page
    assert page.count("<script>") == page.count("</script>") == 2


def test_a_folder_without_result_gets_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(RsgenError, match="holds no result"):
        render_interactive(tmp_path)
