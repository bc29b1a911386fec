"""A result.json of somebody else: read as a run writes it, or left out; never waited for."""

import json
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from rsgen.app.cli.diff_command import compare_results
from rsgen.common.errors import RsgenError
from rsgen.report.page import write_index
from rsgen.report.result_json import read_result, read_results
from tests.samples import cubic_result, write_result

good = cache(lambda: json.dumps(cubic_result(1.0)))


def written(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    result = json.loads(good())
    change(result)
    return write_result(folder, result, "other") / "result.json"


def first(**changes: object) -> Callable[[dict[str, Any]], object]:
    """Change the first row of the parameters."""
    return lambda result: result["parameters"][0].update(changes)


CHANGES = {
    "row without anything": lambda result: result.update(parameters=[{}]),
    "row that is no row": lambda result: result.update(parameters=[3]),
    "name that is no text": first(name={"a": 1}),
    "name without end": first(name="k" * 10**6),
    "unit that is no text": first(unit=["N"]),
    "estimate that is none": first(refined=5),
    "estimate without value": first(refined={}),
    "value that is a text": first(true="8"),
    "value that is no number": first(refined={"value": float("nan")}),
    "value beyond a double": first(relative_error=10**400),
    "interval of three bounds": first(refined={"value": 8.0, "interval": [7, 8, 9]}),
    "bound that is a list": first(refined={"value": 8.0, "interval": [[], 9]}),
    "no misfit": lambda result: result.update(residual=None),
    "background without numbers": lambda result: result.update(background={"estimates": [{}]}),
    "held-out level that is none": lambda result: result.update(held_out=[6.0]),
    "verdict on a row that is a text": first(passed="<b>yes</b>"),
    "surface that is a list": lambda result: result.update(surface=[]),
    "no surface": lambda result: result.pop("surface"),
    "number of points that is a text": lambda result: result["surface"].update(points="63"),
    "title that is no text": lambda result: result.update(title=3),
    "warnings without a number": lambda result: result.update(warnings=7),
    "printed formula that is none": lambda result: result.update(printed=[3]),
}


def test_a_result_as_a_run_writes_it_is_read(tmp_path):
    entry = read_result(written(tmp_path, lambda result: None))
    assert entry is not None
    assert entry.verdict["state"] == "accepted"


@pytest.mark.parametrize("name", CHANGES)
def test_a_result_that_no_run_wrote_is_left_out(name, tmp_path):
    path = written(tmp_path, CHANGES[name])
    assert read_result(path) is None
    with pytest.raises(RsgenError, match="holds no result of rsgen"):
        compare_results(path.parent, path.parent)
    write_index(tmp_path)
    assert "0 cases" in (tmp_path / "index.html").read_text(encoding="utf-8")


@pytest.mark.skipif(os.name != "posix", reason="pipes and devices are files there")
def test_a_pipe_or_a_device_is_not_waited_for(tmp_path):
    for name in ("pipe", "device"):
        (tmp_path / name).mkdir()
    os.mkfifo(tmp_path / "pipe" / "result.json")
    (tmp_path / "device" / "result.json").symlink_to("/dev/zero")
    assert read_results(tmp_path) == []
