"""How long a run takes: what it depends on; what it takes is measured by hand, for machines differ."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rsgen.app.study import expect, foresight
from rsgen.cases import Case, load_case
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.steady_state import LOCATED

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _quiet_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RSGEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(foresight, "_slowness", lambda: 1.0)
    monkeypatch.setattr("os.getloadavg", lambda: (0.0, 0.0, 0.0), raising=False)


def cubic() -> Case:
    return load_case(ROOT / "cases" / "cubic.toml")


def test_a_slow_machine_and_a_busy_one_take_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    quiet = expect(cubic())
    assert quiet.crowding == 1.0
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.getloadavg", lambda: (13.0, 9.0, 5.0))
    busy = expect(cubic())
    assert busy.crowding == 7.0
    assert busy.seconds == quiet.seconds
    monkeypatch.setattr(foresight, "_slowness", lambda: 3.0)
    assert expect(cubic()).total == pytest.approx(3 * quiet.total)


@pytest.mark.slow
def test_a_law_that_was_compiled_before_is_simulated_sooner(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rsgen.dynamics.kernel.store._loaded", {})
    case = cubic()
    first = expect(case).seconds["surface"]
    assert case.oscillator is not None
    compile_kernel(
        case.oscillator.force, values=case.oscillator.values, locate_all=case.test.accuracy < LOCATED
    )
    assert expect(case).seconds["surface"] < first - 1


@pytest.mark.slow
def test_laws_with_memory_take_longer_with_what_is_searched(tmp_path: Path) -> None:
    """As measured: 3, 7 and 11 s where cubic takes half a second; four sliders 13 s at 328 points."""
    times = [
        expect(load_case(ROOT / "cases" / f"{name}.toml"))
        for name in ("cubic", "jenkins", "iwan4", "bouc-wen")
    ]
    seconds = [time.seconds["identification"] for time in times]
    assert seconds == sorted(seconds)
    for found, measured in zip(seconds, (0.7, 3.0, 7.0, 11.0), strict=True):
        assert 0.5 < found / measured < 2
    text = (ROOT / "cases" / "formats" / "csv-table.toml").read_text(encoding="utf-8")
    sliders = " + ".join(f"masing(Min(kt*x, F{i}))" for i in range(4))
    (tmp_path / "case.toml").write_text(
        re.sub(r'force = ".*"', f'force = "{sliders}"', text, count=1), encoding="utf-8"
    )
    surface = ResponseSurface(1.0, [9.0] * 328, 1.0, [1e-3j] * 328)
    found = expect(load_case(tmp_path / "case.toml"), surface).seconds["identification"]
    assert 0.5 < found / 13 < 2


def test_ranking_takes_longer_and_longer_with_a_background(tmp_path: Path) -> None:
    surface = ResponseSurface(1.0, [9.0] * 300, 1.0, [1e-3j] * 300)
    text = (ROOT / "cases" / "formats" / "csv-table.toml").read_text(encoding="utf-8")
    ranked = text.replace("schema = 1", 'schema = 1\nmodel = "rank"')
    behind = ranked.replace("[test]", '[identify]\nbackground = "constant"\n\n[test]', 1)
    seconds = []
    for content in (text, ranked, behind):
        (tmp_path / "case.toml").write_text(content, encoding="utf-8")
        expected = expect(load_case(tmp_path / "case.toml"), surface)
        seconds.append(expected.seconds["identification"])
    assert seconds[0] + 5 < seconds[1] < seconds[2] - 5


def test_the_time_of_reading_counts_as_it_was_measured() -> None:
    case = load_case(ROOT / "cases" / "formats" / "csv-table.toml")
    assert expect(case, reading=7.0).total == pytest.approx(expect(case).total + 7.0)
