"""Rows written twice count once; readings of a coarse display, and sweeps that agree, are left alone."""

import numpy as np
import pytest

import rsgen as rs
from rsgen.data.surface import ResponseSurface, without_copies
from rsgen.report.wording import sentence
from tests.samples import cubic_surface

LAW = "k1*x + kn1*x**3 + c1*v"


def noisy_surface() -> ResponseSurface:
    surface, random = cubic_surface(), np.random.default_rng(3)
    noise = 1 + 0.01 * (random.standard_normal((2, len(surface))) * [[1], [1j]]).sum(axis=0)
    return ResponseSurface(surface.level, surface.frequency, surface.force, noise * surface.harmonics[:, 1])


@pytest.mark.parametrize("copied", [np.arange(200), np.full(60, 17)], ids=["many rows", "one row often"])
def test_copies_change_neither_values_nor_intervals(copied):
    surface = noisy_surface()
    rows = np.concatenate([np.arange(len(surface)), copied])
    assert without_copies(surface) is surface
    found, again = rs.identify(surface, LAW), rs.identify(surface.select(rows), LAW)
    assert again.verdict.state == found.verdict.state
    for name in ("k1", "kn1", "c1", "m"):
        assert again[name].value == pytest.approx(found[name].value, rel=1e-9)
        assert again[name].interval == pytest.approx(found[name].interval, rel=1e-6)
    (finding,) = [finding for finding in again.findings if finding.names.get("by") == "copies"]
    assert (finding["rows"], finding["all"]) == (len(copied), len(rows))
    assert "written twice" in sentence(finding)
    assert finding in rs.modal_table(surface.select(rows)).findings


def test_repeated_readings_that_few_digits_make_equal_are_no_copies():
    surface, random = cubic_surface(), np.random.default_rng(4)
    twice = surface.select(np.repeat(np.arange(len(surface)), 2))
    amplitude = np.abs(twice.harmonics[:, 1]) * (1 + 0.005 * random.standard_normal(len(twice)))
    size = 10.0 ** np.floor(np.log10(amplitude) - 2)
    read = ResponseSurface(
        twice.level, twice.frequency, twice.level, size * np.round(amplitude / size), phase_known=False
    )
    alike = read.harmonics[::2, 1] == read.harmonics[1::2, 1]
    assert 0.05 < np.mean(alike) < 0.5
    assert without_copies(read) is read
