"""Results compared and read: what moved, whether a verdict was lost, and files that no run wrote."""

import json
import os
from collections.abc import Callable
from functools import cache

import pytest

from rsgen import Finding, RsgenError
from rsgen.app.cli.diff_command import compare_results, is_worse
from rsgen.report.page import write_index
from rsgen.report.result_json import read_result, read_results
from rsgen.report.sentences import read_verdict
from tests.samples import cubic_result, write_result

Change = Callable[[dict], object]


def written(folder, tolerance=1e-2, change: Change = lambda result: None, **changes: float):
    """Write a result whose values are changed by a share, with the verdict that belongs to its rows."""
    result = cubic_result(tolerance)
    for row in result["parameters"]:
        row["refined"]["value"] *= 1 + changes.get(row["name"], 0.0)
        row["refined"]["standard_error"] = 0.01 * abs(row["refined"]["value"])
        if row["name"] in changes:
            row["passed"] = result["passed"] = False
    del result["verdict"]
    result["verdict"] = read_verdict(result)
    change(result)
    return write_result(folder, result)


def test_a_moved_value_is_given_in_its_standard_errors(tmp_path):
    before, after = written(tmp_path / "a"), written(tmp_path / "b", kn1=0.04)
    fits, _ = compare_results(before, after)
    (moved,) = [row for row in fits if abs(row.shifts[1]) > 1e-9]
    assert moved.name == "kn1"
    # kn1 is negative, and times 1.04 it falls; standard errors of 1 % each, the second of a value 4 % larger
    assert moved.shifts[1] == pytest.approx(-4 / (1 + 1.04**2) ** 0.5, rel=1e-9)
    assert is_worse(fits)
    assert not is_worse(compare_results(after, before)[0])


def test_results_of_two_laws_are_said_to_be(tmp_path, run_cli):
    def change(result: dict) -> None:
        result["elements"][0]["force"] = "k2*x"

    told = run_cli("diff", written(tmp_path / "a"), written(tmp_path / "b", change=change))
    assert "the laws differ: " in told.out


@pytest.mark.parametrize(("code", "even"), [
    ("mirror-image-fits", False), ("mirror-image-fits", True), ("not-recorded", False)
])  # fmt: skip
def test_mirror_images_of_one_law_are_the_same_but_for_the_direction(tmp_path, run_cli, code, even):
    law = "k1*x + kn1*x**2" if even else "k1*Max(x, 0) + kn1*Min(x, 0)"

    def one(result: dict) -> None:
        result["elements"] = [{"name": "spring", "force": law}]
        result["findings"] = [Finding(code, "info").to_dict()]

    def other(result: dict) -> None:
        one(result)
        stiff, second = (next(r for r in result["parameters"] if r["name"] == name) for name in ("k1", "kn1"))
        if even:
            second["refined"]["value"] *= -1
            second["refined"]["interval"] = [-end for end in second["refined"]["interval"][::-1]]
        else:
            stiff["refined"], second["refined"] = second["refined"], stiff["refined"]

    places = [written(tmp_path / made.__name__, None, made) for made in (one, other)]
    (finding,) = compare_results(*places)[0].findings
    same = code == "mirror-image-fits"
    assert finding.code == (code if same else "results-disagree")
    told = run_cli("diff", *places)
    assert told.code == (0 if same else 1)
    assert ("are one law but for the direction of x" in " ".join(told.out.split())) == same


def test_three_results_stand_side_by_side(tmp_path, run_cli):
    def change(result: dict) -> None:
        for row in result["parameters"]:
            value, error = (row["refined"][name] for name in ("value", "standard_error"))
            row["refined"] |= {"interval": [value - 2 * error, value + 2 * error], "interval_by": "profile"}
        result["fixed"] = {"m": {"value": 1.5, "unit": "kg"}}
        phase = {"name": "psi", "unit": "rad", "value": 0.1, "standard_error": 0.05}
        result["background"] = {"estimates": [phase]}
        result["held_out"] = [{"level": 6.0, "sweep": "up", "error": None}, {"level": 8.0, "error": 0.25}]

    places = [written(tmp_path / side, None, change, k1=by) for side, by in (("a", 0), ("b", 0), ("c", 0.1))]
    fits, _ = compare_results(*places)
    assert fits["psi"].estimates[2].interval == pytest.approx((0.002, 0.198), abs=1e-5)
    assert fits["m"].estimates[0].standard_error == 0
    assert fits["k1"].estimates[0].by_profile
    (finding,) = fits.findings
    assert (finding.code, finding.names["values"]) == ("results-disagree", "k1")
    # of numbers that contradict each other a script has none to go on with
    assert is_worse(fits)
    shown = run_cli("diff", *places)
    # wider than a terminal: the values of a parameter one below the other
    lines = shown.out.splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("k1 "))
    assert [line.endswith(" disjoint") for line in lines[at : at + 3]] == [False, False, True]
    assert [line.split()[-2:] for line in lines].count([str(places[1]), "0.25"]) == 1
    assert (shown.code, run_cli("diff", places[0]).code) == (1, 2)


good = cache(lambda: json.dumps(cubic_result(1.0)))


def first(**changes: object) -> Change:
    return lambda result: result["parameters"][0].update(changes)


CHANGES = {
    "row without anything": lambda result: result.update(parameters=[{}]),
    "name that is no text": first(name={"a": 1}), "name without end": first(name="k" * 10**6),
    "estimate without value": first(refined={}), "value that is a text": first(true="8"),
    "value beyond a double": first(relative_error=10**400),
    "interval of three bounds": first(refined={"value": 8.0, "interval": [7, 8, 9]}),
    "no misfit": lambda result: result.update(residual=None),
    "background without numbers": lambda result: result.update(background={"estimates": [{}]}),
    "verdict on a row that is a text": first(passed="<b>yes</b>"),
    "no surface": lambda result: result.pop("surface"),
    "points that are no number": lambda result: result["surface"].update(points="8"),
    "warnings without a number": lambda result: result.update(warnings=7),
    **{f"verdict {entry}": lambda result, entry=entry: result.update(verdict=entry) for entry in (
        None, [], {"state": "splendid"},
        {"state": "rejected", "headline": "", "decided_by": [], "sentences": [], "next_steps": [""]},
        {"state": "rejected", "headline": "", "decided_by": [3], "sentences": [""], "next_steps": [""]},
    )},
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_a_result_that_no_run_wrote_is_left_out(name, tmp_path):
    result = json.loads(good())
    CHANGES[name](result)
    place = write_result(tmp_path, result)
    assert read_result(place / "result.json") is None
    with pytest.raises(RsgenError, match="holds no result of rsgen"):
        compare_results(place, place)
    write_index(tmp_path)
    assert "0 cases" in (tmp_path / "index.html").read_text(encoding="utf-8")


@pytest.mark.skipif(os.name != "posix", reason="pipes and devices are files there")
def test_a_pipe_or_a_device_is_not_waited_for(tmp_path):
    for name in ("pipe", "device"):
        (tmp_path / name).mkdir()
    os.mkfifo(tmp_path / "pipe" / "result.json")
    (tmp_path / "device" / "result.json").symlink_to("/dev/zero")
    assert read_results(tmp_path) == []
