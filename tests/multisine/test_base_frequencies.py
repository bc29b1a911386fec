"""Records of one multisine test with other periods, and sampled at other rates."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import rsgen
from rsgen.data.history import TimeHistory, from_multisine
from rsgen.data.history.multisine_records import find_period
from tests.case_files import MEASURED, write_small
from tests.virtual import multisine

pytestmark = pytest.mark.slow

LAW = "k*x + k3*x**3 + c*v"
VALUES = {"k": 5000.0, "k3": 4e6, "c": 4.0}
TRUE = VALUES | {"m": 1.5}
PERIODS_BY_LEVEL = {3.0: 2.0, 5.0: 1.3, 8.0: 2.0}


def joined(*parts: rsgen.MultisineSpectra) -> rsgen.MultisineSpectra:
    """Return the records of several tests as one, with zeros as the lines that a record lacks."""
    count = max(len(part.lines) for part in parts)

    def stacked(name: str) -> np.ndarray:
        values = [getattr(part, name) for part in parts]
        return np.concatenate([np.pad(one, ((0, 0), (0, 0), (0, count - one.shape[2]))) for one in values])

    return replace(
        parts[0], level=np.concatenate([part.level for part in parts]), force=stacked("force"),
        omega0=np.concatenate([np.full(len(part), part.omega0) for part in parts]),
        response=stacked("response"), left_out=None,
    )  # fmt: skip


@cache
def simulated(seed: int, noise: float = 0.01) -> rsgen.MultisineSpectra:
    """A Duffing oscillator: a record a level, the middle one with a period of its own."""
    how = {"noise_relative": noise, "seed": seed}
    tests = PERIODS_BY_LEVEL.items()
    return joined(*(multisine(LAW, VALUES, [level], period=period, **how) for level, period in tests))


def test_intervals_of_records_with_two_base_frequencies_cover_the_truth():
    within = []
    for seed in range(20):
        found = rsgen.identify(simulated(seed), LAW)
        assert found.verdict.state == "identified"
        for one in found:
            assert abs(one.value - TRUE[one.name]) < 4 * one.standard_error
            within.append(one.interval[0] <= TRUE[one.name] <= one.interval[1])
    assert 0.88 <= np.mean(within) <= 0.99
    wrong = rsgen.identify(replace(simulated(0), omega0=np.pi), LAW)
    assert wrong.verdict.state == "rejected"


def test_two_periods_are_the_same_record_as_one():
    whole = multisine(LAW, VALUES, [3, 5, 8], periods=1)
    # two periods of the second record as one: every other line of it is zero
    values: dict[str, Any] = {"omega0": whole.omega0 / np.array([1, 2, 1])}
    for name in ("force", "response"):
        old = getattr(whole, name)
        values[name] = np.pad(old, ((0, 0), (0, 0), (0, old.shape[2] - 1)))
        values[name][1] = 0
        values[name][1, :, ::2] = old[1]
    longer = replace(whole, **values)
    for one, other in zip(rsgen.best_linear(whole), rsgen.best_linear(longer), strict=True):
        np.testing.assert_allclose(other.frequency, one.frequency, rtol=1e-12)
        assert other.natural_frequency == pytest.approx(one.natural_frequency, rel=0.01)
    observed = rsgen.Observation(hold_out=(5,), background="residuals")
    one, other = (rsgen.identify(spectra, LAW, observed) for spectra in (whole, longer))
    for name, true in TRUE.items():
        assert other[name].value == pytest.approx(true, rel=1e-7), name
    assert other.frequency_range[1] == pytest.approx(one.frequency_range[1])
    (record,) = rsgen.predict(other).records
    assert record.error < 1e-6
    tables = [rsgen.modal_table(spectra) for spectra in (whole, longer)]
    np.testing.assert_allclose(tables[1].frequency, tables[0].frequency, rtol=1e-3)


def histories(seed: int = 0) -> list[TimeHistory]:
    """Samples of the records: eight periods each, the one of its own period at another rate."""
    spectra, records = simulated(seed), []
    for row, (level, period) in enumerate(PERIODS_BY_LEVEL.items()):
        rate = 256.0 if period == 2 else 200.0
        count = round(rate * period)
        lines = min(count // 2, len(spectra.lines))
        waves = [
            np.concatenate([np.fft.irfft(one[:lines] * count / 2, count) for one in periods])
            for periods in (spectra.force[row], spectra.response[row])
        ]
        records.append(TimeHistory(rate, *waves, level=level, label=f"{level:g} N"))
    return records


CASE = {
    **MEASURED, "element": [{"name": "all", "force": LAW}], "test.file": ["3.csv", "5.csv", "8.csv"],
    "test.excitation": "multisine", "test.time": {"column": "t"}, "test.force": {"samples": "f", "unit": "N"},
    "test.response": {"quantity": "displacement", "samples": "x", "unit": "m"},
    "test.level": {"values": ["3 N", "5 N", "8 N"]}, "identify": {"hold_out": ["5 N"]},
}  # fmt: skip


def test_files_of_other_periods_and_rates_are_read(tmp_path):
    records = histories()
    spectra = from_multisine(records)
    assert spectra.omega0 == pytest.approx(2 * np.pi / np.array(list(PERIODS_BY_LEVEL.values())))
    assert (spectra.periods, spectra.recorded.sum(axis=1).tolist()) == (8, [256, 130, 256])
    steps = [finding["step"] for finding in spectra.findings if finding.code == "multisine-periods"]
    assert sorted(steps) == pytest.approx([0.5, 1 / 1.3])
    for record in records:
        name, time = record.label.split()[0], np.arange(len(record)) / record.rate
        table = np.column_stack([time, record.force, record.response])
        np.savetxt(tmp_path / f"{name}.csv", table, "%.17g", ",", header="t,f,x", comments="")
    path = write_small(tmp_path, "periods", CASE)
    case = rsgen.load_case(path)
    found = rsgen.identify(rsgen.read(case), case.model)
    for name, true in TRUE.items():
        assert abs(found[name].value - true) < 4 * found[name].standard_error
    (held_out,) = rsgen.predict(found).records
    assert held_out.error < 0.01


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("samples", [7999, 8000, 8001])
def test_the_period_of_a_force_with_many_samples_a_cycle_is_exact(samples: int, noise: float):
    draw = np.random.default_rng(samples)
    phase = 2 * np.pi * (np.outer(np.arange(50, 113), np.arange(samples)) / samples + draw.random((63, 1)))
    force = np.tile(np.cos(phase).sum(axis=0), 5)
    assert find_period(force + noise * force.std() * draw.standard_normal(len(force))) == samples
